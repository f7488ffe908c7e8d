"""What an edit does not touch stays as it was, byte for byte."""

from dataclasses import replace
from pathlib import Path

import pytest
from lxml import etree
from support.builders import driving, town_road
from support.edits import NEW_ID, Apply, schema_errors

from plannerforge.engine.commonroad.reader import read_scenario

EDITS = {
    "T": ({"op": "reroute", "vehicles": ["35"], "turn": "right"}, {"35"}),
    "B": ({"op": "set_behaviour", "vehicles": ["33"], "preset": "cautious"}, {"33"}),
    "P": ({"op": "add_vehicle", "vehicle_class": "car", "at": "3", "position": "middle"}, {"101"}),
    "P-": ({"op": "remove_vehicle", "vehicles": ["34"]}, {"34"}),
    "G": ({"op": "set_goal", "to": ["11"], "position": "middle"}, {"100"}),
}


@pytest.mark.parametrize("version", ["2020a", "2018b"])
@pytest.mark.parametrize("kind", EDITS)
def test_only_the_edited_elements_differ(apply: Apply, kind: str, version: str) -> None:
    edit, touched = EDITS[kind]
    applied = apply(edit, builder=replace(town_road(), version=version))
    handed_over = {str(key) for key in applied.outcome.handed_over}
    assert applied.changed_elements() == touched | handed_over


@pytest.mark.parametrize("kind", EDITS)
def test_the_file_stays_valid_and_gets_the_new_id(apply: Apply, kind: str) -> None:
    applied = apply(EDITS[kind][0])
    assert schema_errors(applied.base) == set()
    assert schema_errors(applied.xml) == set()
    assert read_scenario(applied.xml).benchmark_id == NEW_ID


def test_a_2018b_file_stays_one(apply: Apply) -> None:
    applied = apply(EDITS["P"][0], builder=replace(town_road(), version="2018b"))
    root = etree.parse(applied.xml).getroot()
    assert root.get("commonRoadVersion") == "2018b"
    assert root.find("obstacle[@id='101']/role").text == "dynamic"
    assert read_scenario(applied.xml).scenario.obstacle_by_id(101) is not None


def test_states_before_the_hand_over_are_the_recorded_ones(apply: Apply) -> None:
    applied = apply({"op": "set_behaviour", "vehicles": ["32"], "preset": "speeder"})
    old, new = (
        etree.parse(path).find(".//dynamicObstacle[@id='32']/initialState") for path in (applied.base, applied.xml)
    )
    assert etree.tostring(old) == etree.tostring(new)


def test_parked_vehicles_and_pedestrians_stay(apply: Apply) -> None:
    walker = driving(36, (100, 1), 1.0, 151, kind="pedestrian", size_m=(0.5, 0.5))
    parked = driving(37, (120, -1.0), 0.0, 1, kind="parkedVehicle")
    builder = replace(town_road(), vehicles=(*town_road().vehicles, walker), parked=(parked,))
    applied = apply({"op": "set_behaviour", "vehicles": ["33"], "preset": "eco"}, builder=builder)
    assert {"36", "37"}.isdisjoint(applied.changed_elements())


def test_a_dry_run_reports_and_writes_no_files(apply: Apply, tmp_path: Path) -> None:
    applied = apply(EDITS["B"][0], dry_run=True)
    assert applied.outcome.xml is None
    assert applied.outcome.net is None
    assert applied.outcome.edits[0].done
    assert not (tmp_path / "out").exists()
