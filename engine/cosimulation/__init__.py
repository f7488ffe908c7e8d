"""SUMO drives some vehicles of a recorded scenario among others that replay their recording.

``Hint``: SUMO edge and lane index where a recorded pose lies.
``Actor``: A road user of the re-simulation.
``driven_actor``: A road user that SUMO drives by a plan.
``all_actors``: All road users near a lane, by ascending id.
``replayed_actor``: A road user that moves by its track and that the driven ones see.
``pedestrian_of``: The id of the walker for whom a standing track stands.
``check_curves``: Refuse a way with a bend that the vehicle comes to too fast, even if it brakes as hard as it can.
``first_curve_too_tight``: What is wrong with the first bend of a way that somebody at a position (2,) cannot brake
    enough for.
``highest_entry_speed``: Speed in m/s from which a driver at an arc length of a way's first lanelet brakes with ease
    for all bends ahead.
``Behaviour``: All eleven parameters of one driver, by SUMO's names, and the preset that they began with (or "").
``behaviour_from``: A preset (replacing all parameters but a class's own gap) and then single parameters on top.
``own_minimum_gap_m``: The gap in m that a class keeps by its nature, whatever the preset.
``parameters_set``: The parameters that a preset and single parameters set, each with whether whatever it was before.
``presets``: The six presets.
``usual_behaviour``: An ordinary driver of a class.
``values_set``: Single parameters as given, relative ones with the value that acts, or the smallest and largest of
    several.
``TakenOverTrack``: The new motion of a vehicle from the hand-over on (its first state is the recorded one), and its
    dimensions.
``taken_over_track``: Smooth a driven track and join it to its recorded start without a jump.
``Halt``: An order from a step on until another one.
``LANE_CHANGE_S``: TODO.
``Manoeuvre``: An order from a step on.
``DrivePlan``: A vehicle that SUMO drives from ``from_step`` on.
``PROGRESS_ACROSS``: The share of the way after which it is across.
``Replay``: A road user that moves by a given track and not by SUMO.
``JunctionLaneChange``: A change of lane inside a junction.
``class_of``: The class that stands for a CommonRoad obstacle type.
``drivable_ids``: Recorded vehicles that SUMO can drive, ascending.
``not_drivable``: Why a recorded vehicle cannot be driven by SUMO.
``recorded_plan``: A plan that drives a recorded vehicle along its recorded way from a step on.
``DrivenTrack``: What SUMO made of a driven vehicle.
``ShownState``: What SUMO shows of a vehicle.
``front_of``: The front bumper (2,) in m of a recorded pose.
``replayed_states``: What SUMO shows of everybody after every step, by SUMO's id and step.
``resimulate``: Run as long as anybody is driven.
``ROUTES_FILE``: TODO.
``SimulationSetup``: Where the network is, and how long and how finely is simulated.
``TYPES_FILE``: TODO.
``sumo_running``: The module libsumo with a simulation started in it.
``ShownVehicle``: A road user of the type ``t<key>`` and its present entry in the simulation.
``SumoVehicles``: The vehicles of the simulation in libsumo, which knows front bumpers and degrees clockwise from
    north.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .actors import Actor as Actor
    from .actors import Hint as Hint
    from .actors import all_actors as all_actors
    from .actors import driven_actor as driven_actor
    from .actors import pedestrian_of as pedestrian_of
    from .actors import replayed_actor as replayed_actor
    from .controllers import check_curves as check_curves
    from .controllers import first_curve_too_tight as first_curve_too_tight
    from .controllers import highest_entry_speed as highest_entry_speed
    from .driver import Behaviour as Behaviour
    from .driver import behaviour_from as behaviour_from
    from .driver import own_minimum_gap_m as own_minimum_gap_m
    from .driver import parameters_set as parameters_set
    from .driver import presets as presets
    from .driver import usual_behaviour as usual_behaviour
    from .driver import values_set as values_set
    from .handover import TakenOverTrack as TakenOverTrack
    from .handover import taken_over_track as taken_over_track
    from .manoeuvres import LANE_CHANGE_S as LANE_CHANGE_S
    from .manoeuvres import Halt as Halt
    from .manoeuvres import Manoeuvre as Manoeuvre
    from .plans import PROGRESS_ACROSS as PROGRESS_ACROSS
    from .plans import DrivePlan as DrivePlan
    from .plans import JunctionLaneChange as JunctionLaneChange
    from .plans import Replay as Replay
    from .plans import class_of as class_of
    from .plans import drivable_ids as drivable_ids
    from .plans import not_drivable as not_drivable
    from .plans import recorded_plan as recorded_plan
    from .replay import DrivenTrack as DrivenTrack
    from .replay import ShownState as ShownState
    from .replay import front_of as front_of
    from .replay import replayed_states as replayed_states
    from .replay import resimulate as resimulate
    from .session import ROUTES_FILE as ROUTES_FILE
    from .session import TYPES_FILE as TYPES_FILE
    from .session import SimulationSetup as SimulationSetup
    from .session import sumo_running as sumo_running
    from .vehicles import ShownVehicle as ShownVehicle
    from .vehicles import SumoVehicles as SumoVehicles

__getattr__, __dir__ = lazy_face(__name__, __file__)
