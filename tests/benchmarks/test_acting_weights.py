"""A weight acts if raising it changes the choice, whatever is declared of it."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from support.builders import Problem, Vehicle, driving, town_road
from support.planning import configuration

from benchmarks.planners.acting_weights import acting_weights
from plannerforge.engine.commonroad.reader import LoadedScenario, read_scenario
from plannerforge.engine.planners.frenetix import planner as frenetix
from plannerforge.engine.tuning import tuning_of


def situation(folder: Path, *cars: Vehicle, **problem: Any) -> LoadedScenario:
    road = replace(town_road(), problems=(Problem(**problem),))
    return read_scenario((road.with_vehicles(*cars) if cars else road).write(folder / "scenario.xml"))


@pytest.fixture
def aside(tmp_path: Path) -> LoadedScenario:
    """The ego begins beside its lane's centre, turned, and nobody is near."""
    return situation(tmp_path, start=(0.0, 0.3, 0.05, 9.0), goal=(75.0, 0.0, 8.0, 3.0), steps=(60, 80))


@pytest.fixture
def crowded(tmp_path: Path) -> LoadedScenario:
    """The ego begins behind a slower car and with another beside it."""
    cars = driving(31, (54, 0.8), 9.0, 60), driving(33, (40, 3.3), 12.0, 60)
    return situation(tmp_path, *cars, start=(40.0, 0.0, 0.0, 12.0), goal=(75.0, 0.0, 8.0, 3.0), steps=(20, 30))


def test_the_thirteen_weights_act_and_weights_of_absent_modules_do_not(
    aside: LoadedScenario, crowded: LoadedScenario
) -> None:
    acting = acting_weights(configuration(), [aside, crowded])
    assert acting == set(tuning_of("frenetix").weights)
    assert not acting & set(tuning_of("frenetix").external)


def test_the_seven_channels_of_the_learned_planner_act(aside: LoadedScenario, crowded: LoadedScenario) -> None:
    assert acting_weights(configuration("mp_rbfn"), [aside, crowded]) == set(tuning_of("mp_rbfn").weights)


def test_a_weight_of_a_term_that_is_not_computed_does_not_act(
    aside: LoadedScenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    remaining = {name: term for name, term in frenetix.OWN_TERMS.items() if name != "path_length"}
    monkeypatch.setattr(frenetix, "OWN_TERMS", remaining)
    assert "path_length" not in acting_weights(configuration(), [aside])
