"""Re-simulates recorded scenarios: SUMO drives some vehicles, and the others replay their recording.

``Behaviour``: the eleven parameters of a driver, by SUMO's names, and the preset that they are based on (or "").
``presets``: returns the six presets: name → parameter → value.
``usual_behaviour``: returns the ``Behaviour`` of an ordinary driver of a class.
``behaviour_from``: returns a ``Behaviour`` changed by a preset and by single parameters.
``own_minimum_gap_m``: returns the gap in m that a class keeps regardless of the preset; None for most classes.
``parameters_set``: returns, for each parameter that an edit sets, whether its new value is independent of the old.
``values_set``: returns single parameters as given, relative ones with the resulting value.
``DrivePlan``: a vehicle that SUMO drives from ``from_step`` on.
``recorded_plan``: returns the ``DrivePlan`` of a recorded vehicle along its recorded route.
``sent_on``: returns the plan of a vehicle that an edit sends somewhere; a vehicle added to stand starts to move.
``Manoeuvre``: an order to a driven vehicle that starts at a step: a speed, or a lane change.
``Halt``: an order to a driven vehicle to stop, from one step up to, but not including, another.
``StopOrder``: an order to stop at a place of the route and to stand there for some time.
``distances_ahead_m``: returns the distance in m from a driven vehicle's front to the start of each lanelet ahead.
``JunctionLaneChange``: a lane change inside a junction.
``Replay``: a road user that moves by a given track, not by SUMO.
``SpeedAct``: part of a script: starting at a step, change speed with a prescribed acceleration.
``LateralAct``: part of a script: starting at a step, move to the side within a prescribed time.
``Act``: a ``SpeedAct`` or ``LateralAct``.
``scripted_track``: returns a track as changed by prescribed acts.
``joined_track``: returns a track up to a step, continued along given positions of the centre.
``beyond``: returns the path of a road user's centre beyond its track.
``line_from``: returns the path from a position along lanelets and then straight ahead.
``Script``: what a road user does in reactive traffic if the ego triggers parts of its motion.
``ScriptPart``: acts of a script, with their step or their trigger.
``Trigger``: what the ego must do before a part of a script starts.
``resized``: returns the same motion with a body of a different size.
``smooth_step``: returns how far to the side a vehicle is after given shares of the manoeuvre's time.
``class_of``: returns the vehicle class for a CommonRoad obstacle type.
``NOT_DRIVABLE``: the reason of a refusal if SUMO cannot drive a recorded vehicle.
``not_drivable``: returns why SUMO cannot drive a recorded vehicle; empty if it can.
``next_speed_mps``: returns the next speed of a vehicle that must slow down within some distance; None if it need not.
``LANE_CHANGE_S``: duration of a lane change, in s.
``PROGRESS_ACROSS``: the share of a junction lane change's distance after which the vehicle is on the other lanelet.
``first_curve_too_tight``: returns why a vehicle cannot brake enough for a curve of a route, or None.
``highest_entry_speed``: returns the speed in m/s from which a driver brakes comfortably for all curves of a route.
``Actor``: a road user of the re-simulation, replayed or driven.
``all_actors``: returns the actors of all road users near a lane, by ascending id.
``driven_actor``: returns the actor that SUMO drives by a plan.
``replayed_actor``: returns an actor that follows its track and is visible to the driven vehicles.
``pedestrian_of``: returns the id of the pedestrian that a proxy represents.
``lane_hint``: returns SUMO's edge and lane index for a lanelet.
``SimulationSetup``: the network, the number of steps and the time step of a simulation.
``open_simulation``: context manager of a simulation by a setup; yields ``traffic.Sumo``.
``TYPES_FILE``: name of the file with the vehicle types that SUMO reads.
``ROUTES_FILE``: name of the file with the routes that the vehicles drove.
``resimulate``: simulates as long as any vehicle is driven; returns each driven vehicle's ``DrivenTrack`` by id.
``DrivenTrack``: SUMO's track of a driven vehicle: its front bumper in m, and its lanes.
``handover_track``: returns a driven track smoothed and joined to its recorded start without a jump.
``HandoverTrack``: the new track of a vehicle, starting at the hand-over, with its accelerations.
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
    from .handover import HandoverTrack, handover_track
    from .manoeuvres import LANE_CHANGE_S, Halt, Manoeuvre, StopOrder
    from .plans import (
        NOT_DRIVABLE,
        PROGRESS_ACROSS,
        DrivePlan,
        JunctionLaneChange,
        Replay,
        class_of,
        distances_ahead_m,
        not_drivable,
        recorded_plan,
        sent_on,
    )
    from .replay import ROUTES_FILE, TYPES_FILE, DrivenTrack, SimulationSetup, open_simulation, resimulate
    from .scripts import beyond, joined_track, line_from, resized, scripted_track, smooth_step
    from .triggers import Act, LateralAct, Script, ScriptPart, SpeedAct, Trigger

__getattr__, __dir__ = lazy_face(__name__, __file__)
