"""Vehicles as bodies: classes, parameters and limits with their sources, and which motions they can drive.

``VehicleClass``: one class of vehicle: its SUMO class, CommonRoad type, size in m and limits in m/s and m/s².
``class_by_size``: returns the class that matches a recorded obstacle's CommonRoad type and length; None if no class
does.
``nearest_class``: returns the class of a CommonRoad type with the length nearest to a recorded length.
``vehicle_classes``: returns all classes by the word used for them in requests.
``vehicle_class_of``: returns the class of road user for a word in any language; None for other words.
``PEDESTRIAN``: a pedestrian as a class of road users, which is not a vehicle class.
``can_be_between``: returns whether a vehicle can be between two distances after n times at m speeds, shape (n, m).
``centers``: returns positions of the centre, shape (n, 2) in m, for positions of the rear axle and headings.
``farthest_m``: returns the longest distance in m that a vehicle covers in a time.
``latest_passing_s``: returns the time by which a vehicle must have covered a distance; infinite if it can stop first.
``least_time_s``: returns the shortest time in which a vehicle covers a distance from a speed.
``rear_axle``: returns the position of the rear axle, shape (2,) in m, for a centre and heading.
``ego_class``: returns the ego class with a name; raises ``UnknownName`` if there is no such class.
``ego_class_of``: returns the ego's class in place of a recorded vehicle; None for types that an ego cannot be.
``fits_together``: returns whether a body of a given length can have the given axles.
``parameter_values``: returns a vehicle's parameters by name, in order.
``BMW_320I``: CommonRoad's vehicle 2, the default ego.
``COMFORTABLE_MPS2``: comfortable braking and lateral acceleration, in m/s².
``GRAVITY_MPS2``: the acceleration of free fall, in m/s².
``HARDEST_BRAKING_MPS2``: the deceleration that tyres allow on a dry road, in m/s².
``MODEL_WORDS``: descriptions of CommonRoad's motion models.
``VEHICLES``: CommonRoad's vehicles by their id.
``VehicleParameters``: size and limits of an ego.
``comfortable_mps2``: returns comfortable braking and lateral acceleration on a road with the given friction.
``commonroad_vehicle``: returns the id of the CommonRoad vehicle for settings and an ego's class; None if there is no
such vehicle.
``hardest_braking_mps2``: returns the acceleration in m/s² that tyres allow on a road with the given friction.
``refused_by_planners``: returns why the built-in planners refuse an ego of a class; empty if they drive it.
``vehicle_of``: returns the vehicle for settings and an ego's class.
``ARC_LENGTH_MPS``: below this speed, derivatives with respect to arc length cannot be computed from those in time.
``CUT_IN_REACTION_S``: the reaction time of a vehicle after another cuts into its lane, from UN Regulation 157.
``HAND_OVER_S``: how long before a collision a vehicle is handed over to SUMO.
``HARD_BRAKING_REACTION_S``: the minimum time after which a driver brakes hard.
``HEADING_MPS``: below this speed, the recorded heading of a vehicle does not count.
``MONITOR_REACTION_S``: the reaction time of CommonRoad's monitor of traffic rules.
``REST_OF_SMOOTHING_MPS``: speeds below this are written as 0.
``STANDING_MPS``: below this speed, a road user stands.
``TIME_GAP_MPS``: below this speed, a follower has no time gap.
``Feasibility``: whether a motion can be driven, the share of its steps that can, and the first that cannot.
``Motion``: positions in m, headings in rad, speeds in m/s and accelerations in m/s² of a centre.
``SMOOTHINGS``: smoothings (steps, metres) of a driven track, from weak to strong, tried until it can be driven.
``center_track``: returns the centre's track, half a vehicle behind the front bumper's along the same path, (n, 2) in m.
``check_drivability``: returns the ``Feasibility`` of a motion by commonroad-drivability-checker; slow.
``check_kinematics``: returns the ``Feasibility`` of a motion by a closed form of the same criterion; fast.
``drivable_motion``: returns the motion of the centre for a track of the front bumper, shape (n, 2), one point per step.
``drivable_steps``: returns which steps of a motion can be driven by the closed form, shape (n − 1,).
``steering_angles``: returns the steering angle in rad that turns each state into the next, shape (n,).
``tractrix``: returns the heading in rad of a rod with its front end on a guide, shape (n,), unwrapped.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .classes import PEDESTRIAN, VehicleClass, class_by_size, nearest_class, vehicle_classes
    from .kinematics import can_be_between, centers, farthest_m, latest_passing_s, least_time_s, rear_axle
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
