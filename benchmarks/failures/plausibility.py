"""Judge the plausibility of a scenario from its file alone, apart from the code that made it.

No two others overlap before the failure, no added road user would be reached by the ego within 2 s of the start if both
kept their speed, and the accelerations of added vehicles stay below 9 m/s².
"""

from itertools import combinations
from pathlib import Path

import numpy as np
import shapely
from commonroad.common.file_reader import CommonRoadFileReader

_LEAST_TTC_S, _HARDEST_MPS2 = 2.0, 9.0
_OVERLAP_M2 = 0.05


def problem_of(base: Path, changed: Path, until_s: float) -> str:
    """Return why a changed scenario is implausible up to a time after its start, or an empty text.

    Overlaps and accelerations of the base itself do not count.
    """
    scenario, problems = CommonRoadFileReader(str(changed)).open()
    before, _ = CommonRoadFileReader(str(base)).open()
    start = next(iter(problems.planning_problem_dict.values())).initial_state
    first, step_s = int(start.time_step), float(scenario.dt)
    last = first + round(until_s / step_s)
    known = {one.obstacle_id for one in before.dynamic_obstacles}
    for step in range(first, last + 1):
        shapes = _bodies(scenario, step)
        recorded = _bodies(before, step)
        for one, other in combinations(sorted(shapes), 2):
            if shapes[one].intersection(shapes[other]).area > _OVERLAP_M2:
                was = one in recorded and other in recorded and recorded[one].intersects(recorded[other])
                if not was:
                    return f"{one} and {other} overlap at step {step}"
    ego = np.asarray(start.position), float(start.orientation), float(start.velocity)
    for obstacle in scenario.dynamic_obstacles:
        if obstacle.obstacle_id in known:
            continue
        states = [obstacle.initial_state, *obstacle.prediction.trajectory.state_list]
        speeds = np.array([float(state.velocity) for state in states])
        if len(speeds) > 1 and obstacle.obstacle_type.value != "pedestrian":
            hardest = float(np.abs(np.diff(speeds)).max()) / step_s
            if hardest > _HARDEST_MPS2:
                return f"{obstacle.obstacle_id} accelerates by {hardest:.1f} m/s²"
        seconds = _reached_after(ego, states[0], float(obstacle.obstacle_shape.length))
        if seconds < _LEAST_TTC_S:
            return f"{obstacle.obstacle_id} begins {seconds:.1f} s from the ego"
    return ""


def _bodies(scenario: object, step: int) -> dict[int, shapely.Polygon]:
    found = {}
    for obstacle in scenario.obstacles:  # type: ignore[attr-defined] # commonroad-io has no types
        occupancy = obstacle.occupancy_at_time(step)
        if occupancy is not None and hasattr(occupancy.shape, "vertices"):
            found[int(obstacle.obstacle_id)] = shapely.Polygon(occupancy.shape.vertices)
    return found


def _reached_after(ego: tuple[np.ndarray, float, float], state: object, length_m: float) -> float:
    """Return the time in which an ego that keeps lane and speed reaches a road user's first place, or infinity."""
    position, heading, speed = ego
    away = np.asarray(state.position) - position  # type: ignore[attr-defined]
    ahead = float(away[0] * np.cos(heading) + away[1] * np.sin(heading)) - 2.3 - length_m / 2
    aside = abs(float(away[1] * np.cos(heading) - away[0] * np.sin(heading)))
    turned = float(state.orientation) - heading  # type: ignore[attr-defined]
    closing = speed - float(state.velocity) * float(np.cos(turned))  # type: ignore[attr-defined]
    return ahead / closing if aside < 1.5 and ahead > 0.0 and closing > 0.0 else float("inf")
