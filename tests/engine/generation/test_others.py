"""A manoeuvre that is asked for of another road user: it is found in the traffic, scripted, or refused."""

from pathlib import Path

import pytest
from support.generation import make

from plannerforge.engine.execution.executor import silent
from plannerforge.engine.generation.others import WantedManoeuvre
from plannerforge.engine.scenarios import Manoeuvre, read_facts
from plannerforge.schemas.errors import NotPossible
from plannerforge.schemas.scenarios import ReadFactsRequest


def manoeuvres_in(folder: Path) -> tuple[str, ...]:
    """The manoeuvres that a search finds in the scenario of a folder."""
    ego = read_facts(ReadFactsRequest(path=folder / "scenario.xml"), silent).ego
    assert ego is not None
    return ego.manoeuvres or ()


def test_a_crossing_vehicle_is_found_in_the_traffic_the_same_twice(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("one", "two")]
    for folder in folders:
        folder.mkdir()
    one, two = (make("Quadratstadt", folder, scenario_type="intersection", others="crossing:car") for folder in folders)
    assert "scripted" not in one.others
    assert one.others == two.others
    assert "crossing:car" in manoeuvres_in(folders[0])
    assert len({(folder / "scenario.xml").read_bytes() for folder in folders}) == 1


def test_a_leader_that_brakes_hard_is_scripted_if_no_traffic_holds_one(tmp_path: Path) -> None:
    made = make("Neuland", tmp_path, scenario_type="highway", others="lead_brakes_hard:truck", most_rounds=1)
    assert "scripted" in made.others
    assert "lead_brakes_hard:truck" in manoeuvres_in(tmp_path)
    assert made.classes_realised["truck"] == 1
    assert "truck" in made.vehicle_classes.values()
    assert made.checks.schema_valid
    assert made.checks.overlapping_pairs == 0


def test_what_nothing_can_make_is_refused_with_sites_that_hold_it(tmp_path: Path) -> None:
    with pytest.raises(NotPossible) as refusal:
        make("Landmoor", tmp_path, scenario_type="rural", others="cut_in", most_rounds=1)
    assert refusal.value.reason == "no_manoeuvre"
    assert "scenario_type=highway" in refusal.value.valid


def test_of_several_the_first_one_by_a_vehicle_of_the_class_counts() -> None:
    met = (Manoeuvre("cut_in", "truck", 40, 3), Manoeuvre("cut_in", "car", 10, 1), Manoeuvre("cut_in", "truck", 20, 2))
    classes = {1: "car", 2: "trailer", 3: "truck"}
    found = [WantedManoeuvre("cut_in", name).first_of(met, classes.__getitem__) for name in (None, "truck", "bus")]
    assert [one.obstacle_id if one else None for one in found] == [1, 3, None]
