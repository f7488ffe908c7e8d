"""Runs CriMe in its own environment: ``python -P crime_driver.py``, started only by ``measures.py``.

Each input line is a JSON object with a situation, and each output line holds CriMe's measures of it (``measures.py``
defines the fields). Output of its libraries goes to standard error. This file imports nothing of the project.

The driver works around limits of CriMe. Given both velocity components, as in trajectories of files, CriMe takes the
speed for the x component, so the driver omits the components. CriMe measures speeds along a lanelet by the angle to the
x axis, adds half a length to both coordinates, treats an angle of 0 as missing, and averages angles around 0 wrongly.
The driver therefore turns each situation until the lane is 1° off that axis, and shortens the bodies by the amount that
this adds to half a length. It sets the accelerations that CriMe derives to 0 if our measure assumes constant speed.
Values keep CriMe's rounding.
"""

import copy
import json
import logging
import math
import os
import sys
from functools import lru_cache
from typing import Any

_TILT_RAD = math.radians(1.0)


@lru_cache(maxsize=2)
def _read(path: str) -> Any:
    from commonroad.common.file_reader import CommonRoadFileReader

    return CommonRoadFileReader(path).open(lanelet_assignment=False)[0]


def _work(asked: dict[str, Any]) -> dict[str, Any]:
    """Return CriMe's measures between two recorded vehicles at a step, for one of the three kinds of requests."""
    from commonroad.scenario.scenario import Scenario

    whole = _read(asked["file"])
    scenario = Scenario(whole.dt, whole.scenario_id)
    for key in (asked["ego"], asked["other"]):
        scenario.add_objects(_plain(copy.deepcopy(whole.obstacle_by_id(key))))
    if asked["kind"] == "worst":
        return _worst(scenario, asked)
    scenario.add_objects(copy.deepcopy(whole.lanelet_network))
    return _closest(scenario, asked) if asked["kind"] == "closest" else _leader(scenario, asked)


def _plain(obstacle: Any) -> Any:
    """Return the obstacle with states of position, heading and speed only."""
    from commonroad.prediction.prediction import TrajectoryPrediction
    from commonroad.scenario.state import CustomState
    from commonroad.scenario.trajectory import Trajectory

    names = ("time_step", "position", "orientation", "velocity")
    states = [CustomState(**{n: getattr(s, n) for n in names}) for s in obstacle.prediction.trajectory.state_list]
    obstacle.prediction = TrajectoryPrediction(Trajectory(states[0].time_step, states), obstacle.obstacle_shape)
    return obstacle


def _worst(scenario: Any, asked: dict[str, Any]) -> dict[str, Any]:
    """Return the worst time to collision, unrounded, for bodies so short that all discs of a body coincide."""
    import numpy as np
    from commonroad.geometry.shape import Rectangle
    from commonroad_crime.utility import general, solver

    vehicles = [scenario.obstacle_by_id(asked[key]) for key in ("ego", "other")]
    for one in vehicles:
        one._obstacle_shape = Rectangle(asked["short_m"], one.obstacle_shape.width)
        states = [one.initial_state, *one.prediction.trajectory.state_list]
        general.check_elements_state_list(states, scenario.dt)
    roots = solver.solver_wttc(*vehicles, asked["step"], asked["braking_mps2"])
    real = [float(np.real(root)) for root in roots if abs(np.imag(root)) < 1e-6 and np.real(root) > 0]
    return {"worst_s": min(real, default=None)}


def _closest(scenario: Any, asked: dict[str, Any]) -> dict[str, Any]:
    """Return the distance of closest encounter over the recording."""
    from commonroad_crime.data_structure.configuration import CriMeConfiguration
    from commonroad_crime.measure.distance.dce import DCE

    ego, other = (scenario.obstacle_by_id(asked[key]) for key in ("ego", "other"))
    first = ego.initial_state.time_step
    ego.prediction.center_lanelet_assignment = {first: {_lanelet(scenario, ego.initial_state)}}
    config = CriMeConfiguration()
    config.update(ego_id=asked["ego"], sce=scenario)
    begin = max(first, other.initial_state.time_step)
    closest = DCE(config).compute(vehicle_id=asked["other"], time_step=begin, verbose=False)
    return {"closest_m": _finite(closest)}


def _leader(scenario: Any, asked: dict[str, Any]) -> dict[str, Any]:
    """Return gap, time to collision, deceleration and brake threat number, and the lane's direction at both."""
    import numpy as np
    from commonroad.geometry.shape import Rectangle
    from commonroad.scenario.lanelet import LaneletNetwork
    from commonroad_clcs.pycrccosy import CurvilinearCoordinateSystem
    from commonroad_crime.data_structure.configuration import CriMeConfiguration
    from commonroad_crime.measure.acceleration.a_long_req import ALongReq
    from commonroad_crime.measure.distance.hw import HW
    from commonroad_crime.measure.index.btn import BTN
    from commonroad_crime.measure.time.ttc import TTC
    from commonroad_crime.utility import general

    step, network = asked["step"], scenario.lanelet_network
    ego, other = (scenario.obstacle_by_id(asked[key]) for key in ("ego", "other"))
    place = ego.state_at_time(step)
    lane, beside = _lanelet(scenario, place), _lanelet(scenario, other.state_at_time(step))
    scenario.translate_rotate(-np.asarray(place.position), 0.0)
    scenario.translate_rotate(np.zeros(2), _TILT_RAD - _heading(network.find_lanelet_by_id(lane), np.zeros(2)))
    for one in (ego, other):
        length_m = one.obstacle_shape.length / (math.cos(_TILT_RAD) + math.sin(_TILT_RAD))
        one._obstacle_shape = Rectangle(length_m, one.obstacle_shape.width)
    network = LaneletNetwork.create_from_lanelet_list(network.lanelets)  # its index of places does not turn with it
    scenario.replace_lanelet_network(network)
    there = ego.state_at_time(step), other.state_at_time(step)
    angles = [state.orientation for state in there]
    angles.append(_heading(network.find_lanelet_by_id(beside), there[1].position))
    ego.prediction.center_lanelet_assignment = {ego.initial_state.time_step: {lane}}
    config = CriMeConfiguration()
    config.update(ego_id=asked["ego"], sce=scenario)
    config.vehicle.curvilinear.a_lon_max = asked["braking_mps2"]
    path = CurvilinearCoordinateSystem(general.generate_reference_path(lane, network))

    def made(measure: Any, *, still: bool = False) -> Any:
        one = measure(config)
        config.update(CLCS=path)
        one.set_other_vehicles(asked["other"])
        parts = [one, *(part for part in vars(one).values() if hasattr(part, "set_other_vehicles"))]
        for part in parts:
            part.set_other_vehicles(asked["other"])
            for vehicle in (part.ego_vehicle, part.other_vehicle) if still else ():
                for state in [vehicle.initial_state, *vehicle.prediction.trajectory.state_list]:
                    state.acceleration = state.acceleration_y = 0.0
        return one

    def figure(one: Any) -> float | None:
        return _finite(one.compute(vehicle_id=asked["other"], time_step=step, verbose=False))

    threat = made(BTN)
    leader = threat.other_vehicle.state_at_time(step).acceleration
    return {
        "turned_rad": max(abs(_wrapped(angle - _TILT_RAD)) for angle in angles),
        "one_lane": general.check_in_same_lanelet(network, ego, other, step),
        "leader_mps2": leader,
        "threat": figure(threat),
        "gap_m": figure(made(HW)),
        "collision_s": figure(made(TTC, still=True)),
        "needed_mps2": figure(made(ALongReq, still=True)),
    }


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _lanelet(scenario: Any, state: Any) -> int:
    """Return the lanelet at a state with the direction nearest to its heading."""
    network = scenario.lanelet_network
    there = network.find_lanelet_by_position([state.position])[0]
    if not there:
        raise ValueError("the position is on no lanelet")
    position = state.position
    return int(
        min(
            there,
            key=lambda key: abs(_wrapped(_heading(network.find_lanelet_by_id(key), position) - state.orientation)),
        )
    )


def _heading(lanelet: Any, position: Any) -> float:
    """Return the direction of a lanelet's centre line at the segment nearest to a place."""
    import numpy as np

    vertices = lanelet.center_vertices
    middles = (vertices[1:] + vertices[:-1]) / 2
    nearest = int(np.linalg.norm(middles - np.asarray(position), axis=1).argmin())
    along = vertices[nearest + 1] - vertices[nearest]
    return math.atan2(along[1], along[0])


def _wrapped(angle: float) -> float:
    return (angle + math.pi) % (2 * math.pi) - math.pi


def _main() -> None:
    """Answer line by line; if CriMe cannot judge a situation, answer with the reason."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # native libraries print past sys.stdout
    sys.stdout = sys.stderr
    logging.disable(logging.CRITICAL)
    for line in sys.stdin:
        try:
            found = _work(json.loads(line))
        except Exception as error:  # noqa: BLE001 - whatever fails there is the answer for this moment
            found = {"fault": f"{type(error).__name__}: {error}"[:200]}
        answers.write(json.dumps(found) + "\n")
        answers.flush()


if __name__ == "__main__":
    _main()
