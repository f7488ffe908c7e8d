"""Raising a weight never raises its own term: exact, for one state and one set of candidates.

With total costs ``w·r + rest`` over the same candidates, a candidate with a larger raw term ``r`` loses by more at a
larger ``w``. Sums are taken in integers, so that no rounding decides between candidates.
"""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.planning import configuration, drive, goal_state, moving_car, problem_for, rectangle_at, scenario_on
from support.planning import straight_road as road

from plannerforge.engine.planners.frenetix.core import copied_trajectory
from plannerforge.engine.planners.frenetix.planner import Frenetix, cheapest_first, first_feasible
from plannerforge.engine.planners.safety import SafetyCheck
from plannerforge.engine.tuning import tuning_of

WEIGHTS = sorted(tuning_of("frenetix").weights)


@dataclass(frozen=True)
class Stored:
    """What the planner's choice looks at, and the raw terms behind the cost, also as integers of one scale."""

    cost: Any
    uniqueId: int  # noqa: N815 - as the core names it
    raw: Mapping[str, float]
    exact: Mapping[str, int]
    objection: str | None


@dataclass(slots=True)
class Priced:
    """A stored candidate with its cost under other weights."""

    cost: int
    uniqueId: int  # noqa: N815 - as the core names it
    stored: Stored


class Keeping(Frenetix):
    """Frenetix that stores the candidates of its first step."""

    stored: tuple[Stored, ...] = ()

    def _ranked(self, feasible: Any, step: Any) -> Any:
        found = list(super()._ranked(feasible, step))
        if not self.stored:
            check = SafetyCheck(self._task, step.observation)
            self.stored = tuple(self._copied(sample, step, check) for sample in found)
        return iter(found)

    def _copied(self, sample: Any, step: Any, check: SafetyCheck) -> Stored:
        raw = {name: float(pair[0]) for name, pair in sample.costMap.items()}
        trajectory = copied_trajectory(sample, step.frame, step.ego, self._task.vehicle)
        return Stored(float(sample.cost), int(sample.uniqueId), raw, {}, check.objection(trajectory))


@pytest.fixture(scope="module")
def stored() -> tuple[Stored, ...]:
    cars = (moving_car(11, (22.0, 0.0), (4.0, 0.0)), moving_car(12, (60.0, 3.5), (-9.0, 0.0)))
    goal = goal_state((20, 30), rectangle_at(30.0, 1.0))
    planner = Keeping()
    config = configuration("frenetix:Default", *(f"{name}=0.7" for name in WEIGHTS))
    drive(scenario_on(road(200.0, lanes=2), *cars), problem_for(goal, speed_mps=9.0), config, planner=planner)
    terms = {value for candidate in planner.stored for value in candidate.raw.values()}
    scale = math.lcm(*(Fraction(value).denominator for value in terms))
    exact = {value: int(Fraction(value) * scale) for value in terms}
    return tuple(
        replace(candidate, exact={name: exact[value] for name, value in candidate.raw.items()})
        for candidate in planner.stored
    )


def chosen(candidates: tuple[Stored, ...], weights: Mapping[str, int]) -> Stored:
    """The planner's own choice among the candidates under other weights."""
    counted = [name for name in WEIGHTS if weights[name]]
    priced = [Priced(sum(weights[name] * c.exact[name] for name in counted), c.uniqueId, c) for c in candidates]
    ordered = sorted(priced, key=lambda one: one.cost)
    ranked = cheapest_first(ordered, lambda _: None, at_once=len(priced))
    found = first_feasible(ranked, lambda one: one.stored.objection, Counter())
    assert found is not None
    return found.stored


def test_the_stored_set_is_real_and_its_costs_are_the_sums_of_the_terms(stored: tuple[Stored, ...]) -> None:
    assert len(stored) > 100
    assert {name for candidate in stored for name in candidate.raw} == set(WEIGHTS)
    assert any(candidate.objection for candidate in stored)
    for candidate in stored:
        assert candidate.cost == pytest.approx(sum(0.7 * value for value in candidate.raw.values()))


def test_every_term_tells_candidates_apart(stored: tuple[Stored, ...]) -> None:
    assert [name for name in WEIGHTS if len({candidate.raw[name] for candidate in stored}) < 2] == []


@pytest.mark.parametrize("name", WEIGHTS)
@settings(max_examples=15, deadline=None)
@given(data=st.data())
def test_the_own_term_of_the_choice_never_rises_with_its_weight(
    name: str, data: st.DataObject, stored: tuple[Stored, ...]
) -> None:
    weights = {other: data.draw(st.integers(0, 200), label=other) for other in WEIGHTS}
    low, high = sorted(data.draw(st.tuples(st.integers(0, 10**4), st.integers(0, 10**4)), label="low and high"))
    before, after = chosen(stored, weights | {name: low}), chosen(stored, weights | {name: high})
    assert after.exact[name] <= before.exact[name]


@pytest.mark.parametrize("name", WEIGHTS)
def test_a_weight_that_outweighs_all_gives_the_smallest_own_term(name: str, stored: tuple[Stored, ...]) -> None:
    alone = chosen(stored, dict.fromkeys(WEIGHTS, 0) | {name: 1})
    assert alone.exact[name] == min(candidate.exact[name] for candidate in stored if candidate.objection is None)
