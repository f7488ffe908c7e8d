"""Which weights are said to matter: those whose changes are more than scenarios change by chance."""

import random
from typing import Literal

import pytest

from plannerforge.engine.execution import silent
from plannerforge.engine.tuning import fewest_configurations, sensitivity_design, sensitivity_effects
from plannerforge.schemas.analysis.optimization import DesignRequest, Effect, EffectsRequest

NAMES = ("first", "second", "third")
Method = Literal["morris", "sobol"]


def effects(kind: str, method: Method = "morris", scenarios: int = 20, seed: int = 3) -> dict[str, Effect]:
    """The effects of three weights: the first decides or does not, the second turns scenarios at random."""
    design = DesignRequest(method=method, names=NAMES, most=48, seed=seed)
    points = sensitivity_design(design, silent).points
    draw = random.Random(seed)
    limits = [draw.random() for _ in range(scenarios)]
    turned: dict[tuple[float, int], bool] = {}

    def score(point: tuple[float, ...], scenario: int) -> float:
        reached = point[0] >= limits[scenario] if "decides" in kind else scenario % 3 > 0
        if "chance" in kind:
            reached ^= turned.setdefault((point[1], scenario), draw.random() < 0.15)
        return float(reached)

    scores = tuple(tuple(score(point, scenario) for scenario in range(scenarios)) for point in points)
    request = EffectsRequest(
        design=design,
        values=tuple(sum(row) / len(row) for row in scores),
        scores=scores,
        units=tuple(f"unit {scenario}" for scenario in range(scenarios)),
    )
    return {one.name: one for one in sensitivity_effects(request, silent).effects}


@pytest.mark.parametrize("method", ["morris", "sobol"])
def test_a_decisive_weight_matters_and_an_idle_one_had_no_effect(method: Method) -> None:
    found = effects("decides", method)
    assert [found[name].verdict for name in NAMES] == ["matters", "none", "none"]
    assert found["first"].p is not None
    assert found["first"].p > 0, "a bound, never nothing"


@pytest.mark.parametrize("seed", range(6))
def test_a_weight_that_changes_scenarios_at_random_is_not_reported_to_matter(seed: int) -> None:
    found = effects("chance", seed=seed)
    assert [found[name].verdict for name in NAMES] == ["none", "unclear", "none"]
    assert found["second"].effect > 0, "the mean moved all the same"


def test_few_scenarios_give_no_significance() -> None:
    assert effects("decides", scenarios=4)["first"].verdict == "unclear"


def test_the_largest_change_is_named_by_points_and_scenario() -> None:
    largest = effects("decides")["first"].largest
    assert largest is not None
    first, second, scenario = largest
    assert (abs(first - second), 0 <= scenario < 20) == (1, True)


@pytest.mark.parametrize("method", ["morris", "sobol"])
@pytest.mark.parametrize("most", [16, 17, 40, 41, 100])
def test_a_design_has_no_more_points_than_were_requested(method: Method, most: int) -> None:
    design = DesignRequest(method=method, names=NAMES, most=most, seed=1)
    points = sensitivity_design(design, silent).points
    assert fewest_configurations(method, len(NAMES)) <= len(points) <= most
