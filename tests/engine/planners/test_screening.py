"""What is said of candidates before the core makes them is what the core says of them."""

import math
from dataclasses import dataclass
from typing import Any

import frenetix
import numpy as np
import pytest

from plannerforge.engine.planners.frenetix.core import (
    CONSTRAINTS,
    CurvilinearState,
    FrameKeeper,
    PlanningStep,
    SamplingSettings,
    add_feasibility,
    add_step_functions,
    sampling_matrix,
)
from plannerforge.engine.planners.frenetix.planner import _Feasible
from plannerforge.engine.planners.frenetix.screening import Screening, _Motions
from plannerforge.engine.planners.interface import EgoState, Observation
from plannerforge.engine.vehicles.models import BMW_320I

STEP_S = 0.1
WEIGHTS = dict.fromkeys(("acceleration", "jerk", "orientation_offset", "distance_to_obstacles"), 0.0) | {
    "lateral_jerk": 0.2,
    "longitudinal_jerk": 0.2,
    "velocity_offset": 1.0,
    "distance_to_reference_path": 5.0,
}


@dataclass
class Planned:
    """A planning step, its sampling matrix, and a handler of the core for it."""

    step: PlanningStep
    matrix: Any
    handler: Any

    @classmethod
    def on(cls, radius_m: float, speed_mps: float, drift_mps: float = 0.3) -> "Planned":
        """The ego on a curve of a radius, drifting to the left."""
        station = np.arange(0.0, 300.0)
        turned = station / radius_m
        path = np.stack([radius_m * np.sin(turned), radius_m * (1.0 - np.cos(turned))], axis=1)
        if abs(turned[-1]) > 3.0:
            path = path[: int(3.0 * abs(radius_m))]
        frame = FrameKeeper(path).frame
        settings, low = SamplingSettings(), speed_mps < 2.0
        state = CurvilinearState(np.array([5.0, speed_mps, 0.4]), np.array([0.5, drift_mps, 0.1]), low)
        ego = EgoState(0, np.array(path[5]), math.atan2(*(path[6] - path[5])[::-1]), speed_mps)
        step = PlanningStep(Observation(ego, ()), frame, settings, low, speed_mps + 2.0, STEP_S, 100.0)
        handler = frenetix.TrajectoryHandler(STEP_S)
        add_feasibility(handler, BMW_320I)
        add_step_functions(handler, WEIGHTS, step)
        return cls(step, sampling_matrix(state, speed_mps, settings, BMW_320I), handler)

    def made(self) -> dict[int, Any]:
        """All candidates, as the core makes them, by row."""
        self.handler.generate_trajectories(self.matrix, self.step.low_speed)
        self.handler.evaluate_all_current_functions(False)
        return {sample.uniqueId: sample for sample in self.handler.get_sorted_trajectories()}

    def screened(self) -> Screening:
        """What the screening says of them."""
        return Screening.of(self.matrix, self.step, BMW_320I, WEIGHTS)


ROADS = [(1e6, 14.0), (60.0, 9.0), (-25.0, 6.0), (12.0, 4.0), (200.0, 30.0), (9.0, 2.1)]


@pytest.mark.parametrize(("radius_m", "speed_mps"), ROADS)
def test_a_clear_candidate_breaks_the_same_limits_as_in_the_core(radius_m: float, speed_mps: float) -> None:
    planned = Planned.on(radius_m, speed_mps)
    screening, made = planned.screened(), planned.made()
    for row in np.flatnonzero(screening.is_clear).tolist():
        counts = made[row].feasabilityMap
        assert [counts[name] > 0 for name in CONSTRAINTS] == screening.broken[row].tolist()
        assert made[row].feasible == (not screening.broken[row].any())
    assert screening.is_clear.mean() > 0.5


@pytest.mark.parametrize(("radius_m", "speed_mps"), ROADS)
def test_no_candidate_costs_less_than_its_bound(radius_m: float, speed_mps: float) -> None:
    planned = Planned.on(radius_m, speed_mps)
    screening, made = planned.screened(), planned.made()
    feasible = [row for row, sample in made.items() if sample.feasible]
    assert feasible
    assert all(made[row].cost >= screening.least_cost[row] for row in feasible)
    clear = [row for row in feasible if screening.is_clear[row]]
    close = [made[row].cost - screening.least_cost[row] < 1e-4 for row in clear]
    assert sum(close) > 0.8 * len(clear)  # only those that nearly stop have a loose bound


@pytest.mark.parametrize(("radius_m", "speed_mps"), ROADS)
def test_the_margin_is_a_hundred_times_the_rounding_error(radius_m: float, speed_mps: float) -> None:
    planned = Planned.on(radius_m, speed_mps)
    motions = _Motions.of(planned.matrix, planned.step)
    for row, sample in planned.made().items():
        known = motions.is_checked[row] & (motions.speed[row] > 0.1)
        for ours, its in (
            (motions.curvature, sample.cartesian.kappa),
            (motions.acceleration, sample.cartesian.a),
            (motions.velocity, sample.cartesian.v),
        ):
            theirs = np.array(its)[known]
            error = np.abs(ours[row][known] - theirs) / (1.0 + np.abs(theirs) + 1e-3 / motions.speed[row][known] ** 2)
            assert error.max(initial=0.0) < 1e-8


@pytest.mark.parametrize(("radius_m", "speed_mps"), [*ROADS, (1e6, 1.0)])
def test_candidates_computed_on_demand_match_computing_all(radius_m: float, speed_mps: float) -> None:
    planned = Planned.on(radius_m, speed_mps)
    made = planned.made()
    lazily = _Feasible(planned.handler, planned.matrix, planned.step, planned.screened())
    expected = sorted((sample.cost, row) for row, sample in made.items() if sample.feasible)
    given = [(sample.cost, sample.uniqueId) for sample in lazily]
    assert given == expected
    assert lazily.count == len(expected)
    assert lazily.others.total() == len(made) - len(expected)
    assert [sample.uniqueId for sample in lazily] == [row for _, row in expected]


def test_a_candidate_outlives_the_next_ones() -> None:
    planned = Planned.on(60.0, 9.0)
    candidates = iter(_Feasible(planned.handler, planned.matrix, planned.step, planned.screened()))
    first = next(candidates)
    before = np.array(first.cartesian.x), dict(first.costMap)
    remaining = list(candidates)
    assert len(remaining) > 100
    assert (np.array(first.cartesian.x) == before[0]).all()
    assert dict(first.costMap) == before[1]
