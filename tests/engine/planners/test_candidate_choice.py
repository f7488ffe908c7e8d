"""Candidates come by their whole cost, although the dear part of it is computed for few of them."""

from collections.abc import Sequence
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.planning import (
    configuration,
    drive,
    goal_state,
    moving_car,
    problem_for,
    rectangle_at,
    scenario_on,
    straight_road,
)

from plannerforge.engine.planners.frenetix import planner as frenetix
from plannerforge.engine.planners.frenetix.planner import cheapest_first

COSTS = st.integers(0, 6) | st.floats(0.0, 1e9)


@dataclass
class Priced:
    """A candidate whose dear part is added when it is asked for."""

    uniqueId: int  # noqa: N815 - as the core names it
    cost: float
    dear: float
    completed: int = 0


def complete(candidates: Sequence[Priced]) -> None:
    for candidate in candidates:
        candidate.cost += candidate.dear
        candidate.completed += 1


@given(st.lists(st.tuples(COSTS, COSTS), max_size=40), st.integers(1, 7))
def test_the_order_is_that_of_the_whole_costs_and_each_is_completed_once(
    parts: list[tuple[float, float]], at_once: int
) -> None:
    candidates = [Priced(index, quick, dear) for index, (quick, dear) in enumerate(parts)]
    ranked = list(cheapest_first(sorted(candidates, key=lambda one: one.cost), complete, at_once))
    wholes = sorted((quick + dear, index) for index, (quick, dear) in enumerate(parts))
    assert [(candidate.cost, candidate.uniqueId) for candidate in ranked] == wholes
    assert all(candidate.completed == 1 for candidate in candidates)


def test_candidates_that_cannot_be_next_are_not_completed() -> None:
    candidates = [Priced(index, 10.0 * index, 12.0) for index in range(100)]
    ranked = cheapest_first(candidates, complete, at_once=4)
    assert next(ranked).uniqueId == 0
    assert sum(candidate.completed for candidate in candidates) == 4
    assert [next(ranked).uniqueId for _ in range(3)] == [1, 2, 3]
    assert sum(candidate.completed for candidate in candidates) == 8


def test_equal_costs_come_by_number_even_if_the_lower_number_is_completed_later() -> None:
    candidates = [Priced(1, 2.0, 1.0), Priced(0, 3.0, 0.0)]
    assert [candidate.uniqueId for candidate in cheapest_first(candidates, complete, at_once=1)] == [0, 1]


def test_a_run_does_not_depend_on_how_many_candidates_are_completed_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    cars = (moving_car(11, (14.0, 0.0), (3.0, 0.0)), moving_car(12, (60.0, 3.5), (-9.0, 0.0)))
    scenario = scenario_on(straight_road(200.0, lanes=2), *cars)
    problem = problem_for(goal_state((20, 30), rectangle_at(30.0, 0.0)), speed_mps=9.0)
    runs = []
    for at_once in (1, 16, 1000):
        monkeypatch.setattr(frenetix, "COMPLETED_AT_ONCE", at_once)
        runs.append(drive(scenario, problem, configuration("frenetix:Safety-Conservative")))
    told = [([plan.costs for plan in run.plans], run.rejected, run.final) for run in runs]
    assert any(plan.costs["responsibility"] > 0 for plan in runs[0].plans)
    assert told[0] == told[1] == told[2]
