"""Every check of the modification bench fails on a fixture that is wrong in just that respect."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from builders import town_road

from plannerforge.engine.edits.apply import apply_edits
from plannerforge.engine.edits.operations import resolve_edits
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.execution.progress import silent
from plannerforge.engine.scenarios.reader import read_scenario
from plannerforge.evals.modification_checks import Written, checks_of, is_untouched_identical, is_valid
from plannerforge.evals.modification_requests import drawn_requests, edit_of
from plannerforge.schemas.modification import ModificationRequest

PRESETS = {"eco": {"tau": 1.8, "accel": 1.2}}
Case = tuple[Written, dict[str, Any]]


@pytest.fixture(scope="module")
def cases(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Case]:
    """What was made of one request of each task, with its ground truth."""
    folder = tmp_path_factory.mktemp("checks")
    base = town_road().cut(80).write(folder / "base.xml")
    scene = Scene.of(read_scenario(base))
    truths = {task: dict(asked[0].truths[0]) for task, asked in drawn_requests(scene, "seed", PRESETS)}
    where = {"relative_to": "ego", "lane": "same", "offset_m": 25.0}
    truths["P"] = {"op": "add_vehicle", "class": "car", "count": 1, "where": where}
    found = {}
    for task, truth in truths.items():
        edits, output = (edit_of(truth),), folder / task
        changes, _ = resolve_edits(edits, scene, 1000)
        request = ModificationRequest(xml=base, edits=edits, benchmark_id="ZAM_Bench-1_1_T-1", output=output)
        found[task] = (Written.of(base, scene, changes, apply_edits(request, silent)), truth)
    return found


def verdicts(case: Case) -> dict[str, bool]:
    return checks_of(case[0], case[1], case[0].outcome.edits[0])


def told(case: Case, **edit: Any) -> Case:
    """The same file with another report of the edit."""
    report = case[0].outcome.edits[0].model_copy(update=edit)
    return replace(case[0], outcome=case[0].outcome.model_copy(update={"edits": (report,)})), case[1]


def asked(case: Case, **truth: Any) -> Case:
    """The same file for another request."""
    return case[0], case[1] | truth


def without_its_vehicle(case: Case) -> Case:
    """The same file as if its edited vehicle had been lost."""
    new = read_scenario(case[0].xml)
    new.scenario.remove_obstacle(new.scenario.obstacle_by_id(case[0].outcome.edits[0].vehicles[0]))
    return replace(case[0], new=new), case[1]


def without_another(case: Case) -> Case:
    """The same file as if a vehicle that no edit names had been lost."""
    new, named = read_scenario(case[0].xml), case[0].outcome.edits[0].vehicles
    other = next(key for key in case[0].scene.tracks if key not in named)
    new.scenario.remove_obstacle(new.scenario.obstacle_by_id(other))
    return replace(case[0], new=new), case[1]


def never_arriving(case: Case) -> Case:
    """The same file with the report of a vehicle that gets nowhere, for no reason."""
    route = case[0].outcome.edits[0].routes[0]
    return told(case, routes=(route.model_copy(update={"arrives": False, "reason": ""}),))


def off_its_route(case: Case) -> Case:
    """The same file with the report of a way that the vehicle does not drive."""
    route = case[0].outcome.edits[0].routes[0]
    driven = set(route.lanelets)
    elsewhere = [key for key in case[0].scene.layout.table.lanes if key not in driven][-1:]
    return told(case, routes=(route.model_copy(update={"lanelets": tuple(elsewhere)}),))


def widened(case: Case) -> Case:
    """The same file as if the edited vehicle had another body."""
    key = case[0].outcome.edits[0].vehicles[0]
    tracks = case[0].scene.tracks | {key: replace(case[0].scene.tracks[key], width_m=9.0)}
    return replace(case[0], scene=replace(case[0].scene, tracks=tracks)), case[1]


def moved_goal(case: Case) -> Case:
    """The same file as if the goal's time had been changed without a word."""
    new = read_scenario(case[0].xml)
    new.problem().goal.state_list[0].time_step = 1
    return replace(case[0], new=new), case[1]


WRONG: list[tuple[str, str, Callable[[Case], Case]]] = [
    ("T", "tgt", without_its_vehicle),
    ("T", "T_ends", never_arriving),
    ("T", "T_ends", off_its_route),
    ("T", "T_preserve", without_another),
    ("T", "T_preserve", widened),
    ("B", "tgt", without_its_vehicle),
    ("B", "B_preset", lambda case: asked(case, expected_params={"tau": 99.0})),
    ("B", "vClass", widened),
    ("P", "P_count", lambda case: asked(case, count=2)),
    ("P", "P_target", lambda case: asked(case, where=case[1]["where"] | {"offset_m": 32.0})),
    ("P", "P_others", without_another),
    ("G", "G_position", lambda case: asked(case, position=_another_word(case[1]["position"]))),
    ("G", "G_preserve", moved_goal),
]


@pytest.mark.parametrize(("task", "check", "spoil"), WRONG, ids=[f"{task}-{check}" for task, check, _ in WRONG])
def test_a_fixture_wrong_in_one_respect_fails_that_check(
    cases: dict[str, Case], task: str, check: str, spoil: Callable[[Case], Case]
) -> None:
    assert verdicts(cases[task])[check]
    assert not verdicts(spoil(cases[task]))[check]


def test_a_goal_on_another_lanelet_is_seen(cases: dict[str, Case]) -> None:
    others = [key for key in cases["G"][0].scene.layout.table.lanes if key != cases["G"][1]["lanelet"]]
    assert verdicts(cases["G"])["G_edge"]
    assert not all(verdicts(asked(cases["G"], lanelet=key))["G_edge"] for key in others)


def test_a_changed_byte_of_somebody_untouched_is_seen(cases: dict[str, Case], tmp_path: Path) -> None:
    written = cases["G"][0]
    spoiled = tmp_path / "spoiled.xml"
    spoiled.write_text(written.xml.read_text(encoding="utf-8").replace("<type>car</type>", "<type>bus</type>", 1))
    assert is_untouched_identical(written)
    assert not is_untouched_identical(replace(written, xml=spoiled))


def test_a_schema_error_that_the_source_does_not_have_is_seen(cases: dict[str, Case], tmp_path: Path) -> None:
    written = cases["G"][0]
    spoiled = tmp_path / "spoiled.xml"
    spoiled.write_text(written.xml.read_text(encoding="utf-8").replace("<type>car</type>", "<type>cow</type>", 1))
    assert is_valid(written)
    assert not is_valid(replace(written, xml=spoiled))


def _another_word(word: str) -> str:
    return "final" if word != "final" else "beginning"
