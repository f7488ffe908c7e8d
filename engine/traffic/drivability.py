"""The verdict of the drivability checker: a search for inputs of the kinematic single-track model, step by step.

commonroad-drivability-checker with its default tolerances (2 cm, 2 cm, 0.03 rad a step) and the parameters of
CommonRoad's vehicle 2 (BMW 320i), with axles where those of the judged vehicle are. It takes
0.1-0.9 s a trajectory; :mod:`plannerforge.engine.traffic.feasibility` is the closed form of the same criterion.
"""

import copy
import itertools

import numpy as np

from plannerforge.engine.geometry.polyline import wrap_angle
from plannerforge.engine.traffic.feasibility import WHEELBASE_M, Feasibility, steering_angles
from plannerforge.engine.traffic.smoothing import REAR_AXLE_BEHIND_CENTER_M, Motion


def check_drivability(
    motion: Motion,
    step_s: float,
    *,
    wheelbase_m: float = WHEELBASE_M,
    rear_axle_m: float = REAR_AXLE_BEHIND_CENTER_M,
) -> Feasibility:
    """Judge a motion of the centre; every step is looked at, so that the share and the first bad one are known."""
    from commonroad.common.solution import VehicleType
    from commonroad.scenario.state import KSState
    from commonroad_dc.feasibility.feasibility_checker import state_transition_feasibility
    from commonroad_dc.feasibility.vehicle_dynamics import VehicleDynamics

    steering = steering_angles(motion, step_s, wheelbase_m)
    states = [
        KSState(
            time_step=index,
            position=position,
            steering_angle=float(steering[index]),
            velocity=max(float(motion.speeds_mps[index]), 0.0),
            orientation=wrap_angle(float(motion.headings_rad[index])),
        )
        for index, position in enumerate(motion.positions)
    ]
    model = VehicleDynamics.KS(VehicleType.BMW_320i)
    model.parameters = copy.deepcopy(model.parameters)  # the library shares one of them among all models
    model.parameters.a, model.parameters.b = wheelbase_m - rear_axle_m, rear_axle_m
    good = [
        bool(state_transition_feasibility(before, after, model, step_s)[0])
        for before, after in itertools.pairwise(states)
    ]
    bad = np.flatnonzero(~np.array(good, dtype=bool))
    return Feasibility(not len(bad), float(np.mean(good)) if good else 1.0, int(bad[0]) if len(bad) else None)
