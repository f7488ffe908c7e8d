"""The same edits give the same bytes; one call equals several; ids come from recipes."""

from concurrent.futures import Executor
from pathlib import Path

import pytest
from support.builders import town_road
from support.edits import Apply, apply_to, elements

from plannerforge.engine.commonroad.benchmark_id import derived_benchmark_id
from plannerforge.schemas.modification import Edit

COMPOSITE = (
    {"op": "reroute", "vehicles": ["35"], "turn": "right"},
    {"op": "set_behaviour", "vehicles": ["nearest:2"], "preset": "aggressive"},
    {"op": "add_vehicle", "vehicle_class": "truck", "at": "lead", "offset_m": 25},
    {"op": "set_goal", "to": ["13"], "position": "middle"},
)


def test_the_bytes_depend_neither_on_the_process_nor_on_the_hash_seed(tmp_path: Path, other_process: Executor) -> None:
    base = town_road().write(tmp_path / "base.xml")
    here = apply_to(base, tmp_path / "here", *COMPOSITE)
    there = other_process.submit(apply_to, base, tmp_path / "there", *COMPOSITE).result()
    assert here.xml.read_bytes() == there.xml.read_bytes()
    nets = [tmp_path / name / "scenario.net.xml" for name in ("here", "there")]
    assert nets[0].read_bytes() == nets[1].read_bytes()


def test_a_repetition_in_one_process_gives_the_same_bytes(apply: Apply) -> None:
    first = apply(*COMPOSITE).xml.read_bytes()
    assert apply(*COMPOSITE).xml.read_bytes() == first


def test_only_new_edits_of_a_continued_list_are_reported(apply: Apply) -> None:
    applied = apply(*COMPOSITE, earlier=2)
    assert [(report.index, report.op) for report in applied.outcome.edits] == [(0, "add_vehicle"), (1, "set_goal")]


def test_driven_vehicles_do_not_depend_on_a_goal_off_their_route(apply: Apply) -> None:
    alone, both = apply(*COMPOSITE[:3]).xml, apply(*COMPOSITE).xml
    one, two = elements(alone), elements(both)
    assert all(one[key] == two[key] for key in ("31", "33", "35", "101"))


def test_references_to_own_additions_are_counted_from_the_first_edit() -> None:
    edit = Edit(op="set_behaviour", vehicles=["new:0", "!new:12", "31"], preset="eco")
    assert edit.numbered_after(3).vehicles == ["new:3", "!new:15", "31"]
    goal = Edit(op="set_goal", to=["lanelet_of:new:1"])
    assert goal.numbered_after(2).to == ["lanelet_of:new:3"]


@pytest.mark.parametrize(
    ("base", "head"),
    [
        ("DEU_Muc-4_2_T-1", "DEU_Muc-4_2_T-"),
        ("C-USA_US101-3_1_T-1", "C-USA_US101-3_1_T-"),
        ("ZAM_Static-1", "ZAM_Static-1_1_T-"),
        ("DEU_A-1_2_S-3-4", "DEU_A-1_2_S-"),
        ("my scenario", "ZAM_myscenario-1_1_T-"),
    ],
)
def test_derived_ids_follow_commonroad_s_scheme(base: str, head: str) -> None:
    from commonroad.scenario.scenario import ScenarioID

    derived = derived_benchmark_id(base, "0123456789ab")
    assert derived.startswith(head)
    assert derived != derived_benchmark_id(base, "0123456789ac")
    assert str(ScenarioID.from_benchmark_id(derived, "2020a")) == derived
