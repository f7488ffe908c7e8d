"""SUMO drives some vehicles of a recorded scenario among others that replay their recording.

``Behaviour``: All eleven parameters of one driver, by SUMO's names, and the preset that they began with (or "").
``presets``: The six presets: name → parameter → value.
``usual_behaviour``: The ``Behaviour`` of an ordinary driver of a class.
``behaviour_from``: A ``Behaviour`` changed by a preset and by single parameters.
``own_minimum_gap_m``: The gap in m that a class keeps by its nature, whatever the preset; None for most.
``parameters_set``: The parameters that a preset and single parameters set, each with whether whatever it was before.
``values_set``: Single parameters as given, relative ones with the value that acts.
``DrivePlan``: A vehicle that SUMO drives from ``from_step`` on.
``recorded_plan``: The ``DrivePlan`` of a recorded vehicle along its recorded route.
``sent_on``: The plan of a vehicle that an edit sends somewhere, which does not stand any more.
``Manoeuvre``: An order to a driven vehicle from a step on: a speed, or a change of lanes.
``Halt``: An order to a driven vehicle to stand, from one step to before another.
``JunctionLaneChange``: A change of lane inside a junction.
``Replay``: A road user that moves by a given track and not by SUMO.
``SpeedAct``: Of a script: speed up or slow down by a prescribed acceleration from a step on.
``LateralAct``: Of a script: move aside within a prescribed time from a step on.
``Act``: Either of them.
``scripted_track``: A track as prescribed acts change it.
``joined_track``: A track up to a step, and from there on the motion along a given track of the front.
``beyond``: The path of a road user's centre beyond its track.
``line_from``: The path from a place along lanelets and then straight on.
``Script``: What a road user does in reactive traffic, where the ego sets off parts of its motion.
``ScriptPart``: Acts of a script, with their step or their trigger.
``Trigger``: What the ego has to do before a part of a script begins.
``resized``: The same motion with another body.
``smooth_step``: How far aside a vehicle is after shares of the time that it takes.
``class_of``: The vehicle class that stands for a CommonRoad obstacle type.
``not_drivable``: Why a recorded vehicle cannot be driven by SUMO; empty if it can.
``next_speed_mps``: The next step's speed of a vehicle that shall be slow within some room; None while it may drive.
``LANE_CHANGE_S``: How long a change of lane takes, in s.
``PROGRESS_ACROSS``: The share of a junction lane change's distance after which the vehicle is on the other lanelet.
``first_curve_too_tight``: Why a vehicle cannot brake enough for the first too tight curve of a route, or None.
``highest_entry_speed``: Speed in m/s from which a driver brakes with ease for all curves of a route.
``Actor``: A road user of the re-simulation, replayed or driven.
``all_actors``: The actors of all road users near a lane, by ascending id.
``driven_actor``: The actor that SUMO drives by a plan.
``replayed_actor``: The actor that moves by its track and that the driven ones see.
``pedestrian_of``: The id of the pedestrian that a proxy stands for.
``lane_hint``: SUMO's edge and lane index for a lanelet.
``SimulationSetup``: Where the network is, and how long (steps) and how finely (s) is simulated.
``open_simulation``: A simulation by a setup, as a context manager; yields ``traffic.Sumo``.
``TYPES_FILE``: Name of the file of the vehicle types that SUMO read.
``ROUTES_FILE``: Name of the file of the routes that the vehicles drove.
``resimulate``: Simulate as long as any vehicle is driven; the ``DrivenTrack`` of each by id.
``DrivenTrack``: What SUMO made of a driven vehicle: its front bumper in m, and its lanes.
``taken_over_track``: A driven track smoothed and joined to its recorded start without a jump.
``TakenOverTrack``: The new track of a vehicle from the hand-over on, with its accelerations.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .actors import Actor, all_actors, driven_actor, lane_hint, pedestrian_of, replayed_actor
    from .controllers import next_speed_mps
    from .curve_speeds import first_curve_too_tight, highest_entry_speed
    from .driver import (
        Behaviour,
        behaviour_from,
        own_minimum_gap_m,
        parameters_set,
        presets,
        usual_behaviour,
        values_set,
    )
    from .handover import TakenOverTrack, taken_over_track
    from .manoeuvres import LANE_CHANGE_S, Halt, Manoeuvre
    from .plans import (
        PROGRESS_ACROSS,
        DrivePlan,
        JunctionLaneChange,
        Replay,
        class_of,
        not_drivable,
        recorded_plan,
        sent_on,
    )
    from .replay import ROUTES_FILE, TYPES_FILE, DrivenTrack, SimulationSetup, open_simulation, resimulate
    from .scripts import beyond, joined_track, line_from, resized, scripted_track, smooth_step
    from .triggers import Act, LateralAct, Script, ScriptPart, SpeedAct, Trigger

__getattr__, __dir__ = lazy_face(__name__, __file__)
