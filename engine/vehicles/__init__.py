"""Vehicles as bodies: classes, parameters and limits with their sources, and which motions they can drive.

``VehicleClass``: One class of vehicle: its SUMO class, CommonRoad type, size in m and limits in m/s and m/s².
``class_by_size``: The class that a recorded obstacle of a CommonRoad type and length can be; None for other sizes.
``nearest_class``: The class of a CommonRoad type whose length is nearest to a recorded one.
``vehicle_classes``: All classes by the word used for them in requests.
``vehicle_class_of``: The class of road user that a word of any language means; None for other words.
``PEDESTRIAN``: A person on foot as a class of road users, which is none of the vehicle classes.
``can_be_there``: Whether a vehicle can be between two distances ahead after n times at m speeds, shape (n, m).
``centers``: Positions of the centre, shape (n, 2) in m, for positions of the rear axle and headings.
``farthest_m``: The longest distance in m that a vehicle covers in a time.
``latest_passing_s``: The time after which a vehicle has certainly driven a distance; infinite if it can stop before.
``least_time_s``: The shortest time in which a car covers a distance from a speed.
``rear_axle``: The position of the rear axle, shape (2,) in m, for a centre and heading.
``ego_class``: The class of an ego by its word; ``UnknownName`` for another.
``ego_class_of``: What the ego is in the place of a recorded vehicle of a CommonRoad type and length; None for others.
``fits_together``: Whether a body of a length can have such axles.
``parameter_values``: A vehicle's parameters by name, in their order.
``BMW_320I``: CommonRoad's vehicle 2, the ego where nothing states another.
``COMFORTABLE_MPS2``: Braking and lateral acceleration of a driver who is in no trouble, in m/s².
``GRAVITY_MPS2``: The acceleration of free fall, in m/s².
``HARDEST_BRAKING_MPS2``: The deceleration that tyres hold on a dry road, in m/s².
``MODEL_WORDS``: CommonRoad's names of motion models, in words.
``VEHICLES``: CommonRoad's vehicles by their id.
``VehicleParameters``: Size and limits of an ego.
``comfortable_mps2``: Braking and lateral acceleration of a driver who is in no trouble on a road of some friction.
``commonroad_vehicle``: The id of the CommonRoad vehicle of some settings and an ego's class; None for any other.
``hardest_braking_mps2``: What tyres hold, along and across, on a road of some friction, in m/s².
``refused_by_planners``: Why the built-in planners refuse an ego of a class; empty if they drive it.
``vehicle_of``: The vehicle of some settings and an ego's class.
``ARC_LENGTH_MPS``: Slower, derivatives by time say nothing about those by arc length.
``CUT_IN_REACTION_S``: The reaction time of a vehicle that is cut in on, as UN Regulation 157 has it.
``HAND_OVER_S``: How long before a collision a vehicle is handed over to SUMO.
``HARD_BRAKING_REACTION_S``: The least time after which a driver brakes hard.
``HEADING_MPS``: The recorded heading of a slower vehicle does not count.
``MONITOR_REACTION_S``: The reaction time of CommonRoad's monitor of traffic rules.
``REST_OF_SMOOTHING_MPS``: Speeds below this are written as 0.
``STANDING_MPS``: A slower road user stands.
``TIME_GAP_MPS``: A slower follower has no time gap.
``Feasibility``: Whether a motion can be driven, the share of its steps that can, and the first that cannot.
``Motion``: Positions in m, headings in rad, speeds in m/s and accelerations in m/s² of a centre.
``SMOOTHINGS``: Smoothings (steps, metres) of a driven track, the stronger the later, tried until it can be driven.
``center_track``: The centre's track, half a vehicle behind the front bumper's along the same path, shape (n, 2) in m.
``check_drivability``: The ``Feasibility`` of a motion by commonroad-drivability-checker; slow.
``check_kinematics``: The ``Feasibility`` of a motion by a closed form of the same criterion; fast.
``drivable_motion``: The motion of the centre for a track of the front bumper, shape (n, 2), one point a step.
``drivable_steps``: Which steps of a motion can be driven by the closed form, shape (n − 1,).
``steering_angles``: The steering angle in rad that turns each state into the next, shape (n,).
``tractrix``: The heading in rad of a rod whose front end follows a guide, shape (n,), unwrapped.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .classes import PEDESTRIAN, VehicleClass, class_by_size, nearest_class, vehicle_classes
    from .kinematics import can_be_there, centers, farthest_m, latest_passing_s, least_time_s, rear_axle
    from .models import (
        BMW_320I,
        COMFORTABLE_MPS2,
        GRAVITY_MPS2,
        HARDEST_BRAKING_MPS2,
        MODEL_WORDS,
        VEHICLES,
        VehicleParameters,
        comfortable_mps2,
        commonroad_vehicle,
        ego_class,
        ego_class_of,
        fits_together,
        hardest_braking_mps2,
        parameter_values,
        refused_by_planners,
        vehicle_of,
    )
    from .motion import (
        SMOOTHINGS,
        Feasibility,
        Motion,
        center_track,
        check_drivability,
        check_kinematics,
        drivable_motion,
        drivable_steps,
        steering_angles,
        tractrix,
    )
    from .motion_thresholds import (
        ARC_LENGTH_MPS,
        CUT_IN_REACTION_S,
        HAND_OVER_S,
        HARD_BRAKING_REACTION_S,
        HEADING_MPS,
        MONITOR_REACTION_S,
        REST_OF_SMOOTHING_MPS,
        STANDING_MPS,
        TIME_GAP_MPS,
    )
    from .words import vehicle_class_of

__getattr__, __dir__ = lazy_face(__name__, __file__)
