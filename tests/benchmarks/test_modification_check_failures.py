"""Every check of the modification bench fails on a fixture that is wrong in just that respect."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.builders import town_road
from support.modification_bench import (
    GOAL_TIME,
    TRUTHS,
    asked,
    carried_out,
    moving,
    respelt,
    told,
    typed,
    verdicts,
    without,
)

from benchmarks.modification.judges import is_untouched_identical
from benchmarks.modification.written import Written
from plannerforge.engine.commonroad.tracks import Track

ADDED = 101
GOAL_CENTER = "planningProblem/goalState/position/rectangle/center"


@pytest.fixture(scope="module")
def cases(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Written]:
    """What was made of one request of each kind."""
    found = {}
    for task, truth in TRUTHS.items():
        base = town_road().cut(100).write(tmp_path_factory.mktemp(task) / "base.xml")
        found[task] = carried_out(base, truth)
    return found


def elsewhere(track: Track) -> Track:
    away = track.positions.copy()
    away[20:, 1] += 40.0
    return replace(track, positions=away)


def never_arriving(written: Written) -> Written:
    """The same file with the report of a vehicle that does not arrive."""
    route = written.outcome.edits[0].routes[0]
    return told(written, routes=(route.model_copy(update={"arrives": not route.arrives, "reason": "traffic"}),))


def routed_past(written: Written) -> Written:
    """The same file as if SUMO had had the vehicle on its recorded way."""
    straight = written.sumo.routes[34][-1:]
    return replace(written, sumo=replace(written.sumo, routes={**written.sumo.routes, 31: straight}))


def at_last(track: Track) -> Track:
    """The same motion, nothing of it before 3 s."""
    return replace(track, first_step=30)


WRONG: list[tuple[str, str, Callable[[Written], Written]]] = [
    ("T", "tgt", lambda one: without(one, 31)),
    ("T", "T_ends", never_arriving),
    ("T", "T_ends", lambda one: told(one, routes=())),
    ("T", "T_ends", routed_past),
    ("T", "T_ends", lambda one: moving(one, 31, elsewhere)),
    ("T", "T_ends", lambda one: asked(one, target_lanelets=[3])),
    ("T", "T_ends", lambda one: asked(one, via=[21])),
    ("T", "T_preserve", lambda one: without(one, 33)),
    ("T", "T_preserve", lambda one: moving(one, 31, lambda track: replace(track, width_m=9.0))),
    ("T", "T_preserve", lambda one: told(one, vehicles=(31, 32))),
    ("B", "tgt", lambda one: without(one, 31)),
    ("B", "tgt", lambda one: asked(one, vehicle_ids=[31, 32])),
    ("B", "B_preset", lambda one: asked(one, expected_params={"tau": 99.0})),
    ("B", "B_preset", lambda one: asked(one, vehicle_ids=[31, 32])),
    ("B", "B_preset", lambda one: typed(one, 31, accel="2.6")),
    ("B", "vClass", lambda one: typed(one, 31, vClass="truck")),
    ("B", "vClass", lambda one: moving(one, 31, lambda track: replace(track, kind="truck"))),
    ("P", "P_count", lambda one: asked(one, count=2)),
    ("P", "P_count", lambda one: replace(one, new={**one.new, 999: one.new[31]})),
    ("P", "P_class", lambda one: asked(one, **{"class": "car"})),
    ("P", "P_class", lambda one: moving(one, ADDED, lambda track: replace(track, length_m=4.5, width_m=1.8))),
    ("P", "P_class", lambda one: typed(one, ADDED, vClass="passenger")),
    ("P", "P_target", lambda one: asked(one, where={"lanelet": 2, "position": "quarter"})),
    ("P", "P_speed", lambda one: asked(one, speed_mps=0.0)),
    ("P", "P_departure", lambda one: asked(one, depart_s=0.0)),
    ("P", "P_departure", lambda one: asked(one, depart_s=2.0)),
    ("P", "P_departure", lambda one: moving(one, ADDED, at_last)),
    ("P", "P_destination", lambda one: asked(one, destination_lanelet=13)),
    ("P", "P_others", lambda one: without(one, 33)),
    ("R", "P_count", lambda one: asked(one, vehicle_ids=[33])),
    ("R", "P_target", lambda one: asked(one, vehicle_ids=[32])),
    ("R", "P_others", lambda one: asked(one, vehicle_ids=[33])),
    ("G", "G_edge", lambda one: asked(one, lanelet=3)),
    ("G", "G_edge", lambda one: respelt(one, f"{GOAL_CENTER}/y", "1.85")),
    ("G", "G_position", lambda one: asked(one, position="final")),
    ("G", "G_rectangle", lambda one: asked(one, rectangle={"length_m": 50.0, "width_m": 50.0})),
    ("G", "G_rectangle", lambda one: asked(one, rectangle=None)),
    ("G", "G_time", lambda one: asked(one, time=GOAL_TIME | {"end_s": 7.4})),
    ("G", "G_time", lambda one: asked(one, time=None)),
    ("G", "G_time", lambda one: respelt(one, "planningProblem/goalState/time/intervalEnd", "99")),
]


@pytest.mark.parametrize(
    ("task", "check", "spoil"), WRONG, ids=[f"{task}-{check}-{row}" for row, (task, check, _) in enumerate(WRONG)]
)
def test_a_fixture_wrong_in_one_respect_fails_that_check(
    cases: dict[str, Written], task: str, check: str, spoil: Callable[[Written], Written]
) -> None:
    assert verdicts(cases[task])[check]
    assert not verdicts(spoil(cases[task]))[check]


def test_a_goal_velocity_that_no_edit_names_is_kept(cases: dict[str, Written], tmp_path: Path) -> None:
    interval = "<velocity><intervalStart>0</intervalStart><intervalEnd>9</intervalEnd></velocity>"
    text = town_road().cut(100).xml().replace("</goalState>", f"{interval}</goalState>")
    base = tmp_path / "base.xml"
    base.write_text(text)
    kept = carried_out(base, TRUTHS["G"])
    assert verdicts(kept)["G_preserve"]
    assert not verdicts(replace(cases["G"], base=base))["G_preserve"]
    assert not verdicts(respelt(kept, "planningProblem/goalState/velocity/intervalEnd", "8"))["G_preserve"]


def test_everything_right_passes_every_check(cases: dict[str, Written]) -> None:
    assert {name for written in cases.values() for name, passed in verdicts(written).items() if not passed} == set()


def test_a_vehicle_that_enters_as_soon_as_its_place_is_free_departs_right(cases: dict[str, Written]) -> None:
    track = cases["P"].new[ADDED]
    standing = replace(track, obstacle_id=7, first_step=0, positions=np.repeat(track.positions[:1], 30, axis=0))
    standing = replace(standing, headings_rad=np.zeros(30), speeds_mps=np.zeros(30))
    late = moving(cases["P"], ADDED, at_last)
    assert verdicts(replace(late, new={**late.new, 7: standing}))["P_departure"]


def test_a_changed_byte_of_an_untouched_vehicle_is_seen(cases: dict[str, Written], tmp_path: Path) -> None:
    spoiled = tmp_path / "spoiled.xml"
    spoiled.write_text(cases["G"].xml.read_text(encoding="utf-8").replace("<type>car</type>", "<type>bus</type>", 1))
    assert is_untouched_identical(cases["G"])
    assert not is_untouched_identical(replace(cases["G"], xml=spoiled))


def test_a_vehicle_that_is_touched_although_no_edit_names_it_is_seen(cases: dict[str, Written]) -> None:
    written = cases["B"]
    assert is_untouched_identical(written)
    assert not is_untouched_identical(asked(written, vehicle_ids=[32]))


def test_a_problem_without_a_goal_gets_some_time_for_its_first_one(cases: dict[str, Written], tmp_path: Path) -> None:
    base = tmp_path / "base.xml"
    base.write_text(re.sub(r"<goalState>.*?</goalState>", "", town_road().cut(100).xml(), flags=re.DOTALL))
    first = carried_out(base, TRUTHS["G"] | {"rectangle": None, "time": None})
    assert verdicts(first)["G_time"]
    assert not verdicts(respelt(first, "planningProblem/goalState/time/intervalEnd", "0"))["G_time"]
