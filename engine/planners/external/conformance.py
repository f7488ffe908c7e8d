"""The executable contract of planners, which checks a planner before it drives in the loop."""

from collections.abc import Callable, Mapping

import numpy as np

from ....schemas.planning import LONGEST_NAME, MOST_TERMS
from ....schemas.text import one_line, quoted
from ..driving.drivability import excesses_of
from ..interface import DebugValues, EgoState, Observation, Plan, PlannedTrajectory, Planner, PlanningTask

_SHORTEST_PLAN_S = 1.0
"""By the contract: with the longest time between plans, 10 steps of 0.1 s, the current plan never ends."""
_START_TOLERANCE_M = 0.05
"""Largest distance of a plan's start from the ego's centre (chosen)."""
_STEP_TOLERANCE_M = 0.5
"""Largest excess of a step over what its speeds allow, since the centre swings out in curves (chosen)."""


def check_planner(make: Callable[[], Planner], task: PlanningTask, observation: Observation) -> tuple[str, ...]:
    """Return a planner's breaches of the contract on one task; empty if it keeps the contract.

    The planner must start at the observed state, plan at least one second of connected finite states within the limits
    of the task's vehicle, and give finite costs and non-negative counts. After a reset and in a new instance, it must
    give the same plan again.
    """
    planner = make()
    planner.reset(task)
    first: object = planner.plan(observation)
    breaches = plan_breaches(first, observation, task.step_s)
    if not isinstance(first, Plan):
        return tuple(breaches)
    if first.trajectory is not None and not breaches:
        excesses = excesses_of(first.trajectory, task.vehicle, task.step_s)
        breaches += [f"plans a motion that its vehicle cannot drive: {excess.in_words()}" for excess in excesses]
    planner.reset(task)
    other = make()
    other.reset(task)
    for name, again in (("after a reset", planner.plan(observation)), ("in a new instance", other.plan(observation))):
        if not same_plan(first, again):
            breaches.append(f"gives a different plan {name}")
    return tuple(breaches)


def plan_breaches(plan: object, observation: Observation, step_s: float) -> list[str]:
    """Return the breaches of the contract in one answer, which may be of any type if the planner is a user's."""
    if not isinstance(plan, Plan):
        return [f"plan() returned {type(plan).__name__}, not a Plan"]
    breaches = _figure_breaches(plan)
    trajectory: object = plan.trajectory
    if isinstance(trajectory, PlannedTrajectory):
        breaches += trajectory_breaches(trajectory, observation.ego, step_s)
    elif trajectory is not None:
        breaches.append(f"trajectory is {type(trajectory).__name__}, not a PlannedTrajectory or None")
    return breaches


def _figure_breaches(plan: Plan) -> list[str]:
    for kind, named in (("cost", plan.costs), ("constraint", plan.rejected)):
        if len(named) > MOST_TERMS:
            return [f"it has {len(named):,} {kind}s, more than {MOST_TERMS}"]
        for name in named:
            if not name or one_line(name, LONGEST_NAME) != name:
                return [f"{kind} {quoted(name, LONGEST_NAME)} must be printable and at most {LONGEST_NAME} characters"]
    breaches = [f"cost {name} is {value}" for name, value in sorted(plan.costs.items()) if not np.isfinite(value)]
    breaches += [f"rejected {name} is {count}" for name, count in sorted(plan.rejected.items()) if count < 0]
    if plan.candidates < 0:
        breaches.append(f"candidates is {plan.candidates}")
    return breaches + _debug_breaches(plan.debug)


def _debug_breaches(debug: object) -> list[str]:
    """Return the debug values that cannot be stored; values beyond the bounds are dropped without a breach."""
    if not isinstance(debug, DebugValues):
        return [f"debug is {type(debug).__name__}, not DebugValues"]
    wrong = [name for name, values in vars(debug).items() if not isinstance(values, Mapping)]
    if wrong:
        return [f"debug {wrong[0]} is {type(getattr(debug, wrong[0])).__name__}, not a mapping"]
    shapes = {name: np.shape(outline) for name, outline in debug.polygons.items() if isinstance(outline, np.ndarray)}
    unfit = [name for name in debug.polygons if len(shapes.get(name, ())) != 2 or shapes[name][1] != 2]
    return [f"debug polygon {one_line(str(name))} is not an array of shape (n, 2)" for name in unfit]


def trajectory_breaches(trajectory: PlannedTrajectory, ego: EgoState, step_s: float) -> list[str]:
    """Return the breaches of the contract in a trajectory that starts at the ego."""
    arrays = vars(trajectory).items()
    wrong = [name for name, values in arrays if name != "steering_rad" and not isinstance(values, np.ndarray)]
    if wrong:
        return [f"{wrong[0]} of the trajectory is {type(getattr(trajectory, wrong[0])).__name__}, not a numpy array"]
    count = len(trajectory.positions)
    others = (trajectory.headings_rad, trajectory.speeds_mps, trajectory.accelerations_mps2)
    if trajectory.positions.shape != (count, 2) or any(values.shape != (count,) for values in others):
        return ["the arrays of the trajectory have different lengths"]
    if not all(np.isfinite(values).all() for values in (trajectory.positions, *others)):
        return ["the trajectory has numbers that are not finite"]
    breaches = []
    if (count - 1) * step_s < _SHORTEST_PLAN_S - 1e-9:
        breaches.append(f"plans only {(count - 1) * step_s:.2f} s")
    away = float(np.linalg.norm(trajectory.positions[0] - ego.position))
    if away > _START_TOLERANCE_M:
        breaches.append(f"starts {away:.2f} m from the ego")
    moved = np.linalg.norm(np.diff(trajectory.positions, axis=0), axis=1)
    fastest = np.maximum(trajectory.speeds_mps[:-1], trajectory.speeds_mps[1:]) * step_s
    if (moved > fastest + _STEP_TOLERANCE_M).any():
        breaches.append("moves farther in a step than its speed allows")
    if (trajectory.speeds_mps < -1e-6).any():
        breaches.append("drives backwards")
    return breaches


def same_plan(first: Plan, second: Plan) -> bool:
    """Return True if two plans are equal in everything but the computation time."""
    content = [(dict(p.costs), dict(p.rejected), p.candidates, p.kind, p.trajectory is None) for p in (first, second)]
    if content[0] != content[1]:
        return False
    if first.trajectory is None or second.trajectory is None:
        return True
    pairs = zip(vars(first.trajectory).values(), vars(second.trajectory).values(), strict=True)
    return all(np.array_equal(mine, theirs) for mine, theirs in pairs)
