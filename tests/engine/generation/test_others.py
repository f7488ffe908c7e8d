"""A manoeuvre that is asked for of another road user: it is found in the traffic, scripted, or refused."""

import math
from pathlib import Path

import numpy as np
import pytest
from support.builders import driving, town_road
from support.generation import make

from plannerforge.engine.commonroad import Track
from plannerforge.engine.execution.executor import silent
from plannerforge.engine.generation import generator, others
from plannerforge.engine.generation.others import first_of, nearest_at
from plannerforge.engine.generation.record import with_scripted
from plannerforge.engine.scenarios import Manoeuvre, read_facts
from plannerforge.schemas.errors import NotPossible
from plannerforge.schemas.generation import DensityFacts, GeneratedScenario, RequestedManoeuvre
from plannerforge.schemas.modification import ModificationRequest
from plannerforge.schemas.scenarios import ReadFactsRequest
from plannerforge.workflows.generation.record import verdicts


def manoeuvres_in(folder: Path) -> tuple[str, ...]:
    """The manoeuvres that a search finds in the scenario of a folder."""
    ego = read_facts(ReadFactsRequest(path=folder / "scenario.xml"), silent).ego
    assert ego is not None
    return ego.manoeuvres or ()


def test_a_crossing_vehicle_is_found_in_the_traffic_the_same_twice(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("one", "two")]
    for folder in folders:
        folder.mkdir()
    wish = {"scenario_type": "intersection", "others": "crossing:car", "seed": 6}
    one, two = (make("Quadratstadt", folder, **wish) for folder in folders)
    assert "scripted" not in one.others
    assert one.others == two.others
    assert "crossing:car" in manoeuvres_in(folders[0])
    assert len({(folder / "scenario.xml").read_bytes() for folder in folders}) == 1


def test_a_leader_that_brakes_hard_is_scripted_if_the_traffic_lacks_one(tmp_path: Path) -> None:
    made = make("Neuland", tmp_path, scenario_type="highway", others="lead_brakes_hard:truck", most_rounds=1)
    assert "scripted" in made.others
    assert "lead_brakes_hard:truck" in manoeuvres_in(tmp_path)
    assert made.classes_realised["truck"] == 1
    assert "truck" in made.vehicle_classes.values()
    assert made.checks.schema_valid
    assert made.checks.overlapping_pairs == 0
    assert made.checks.recorded_ego_collision_free is None
    assert "recorded ego free of collisions" not in {*verdicts(made.checks)[0], *verdicts(made.checks)[1]}
    assert "ordinary driver" in made.others


def test_a_replaced_vehicle_changes_its_class_and_counts_once(tmp_path: Path) -> None:
    path = town_road().write(tmp_path / "scenario.xml")
    before = GeneratedScenario.model_construct(
        vehicles_realised=6,
        classes_realised={"car": 3, "truck": 1, "motorcycle": 1},
        vehicle_classes={31: "car", 32: "car", 33: "truck", 34: "motorcycle", 35: "car"},
        density=DensityFacts.model_construct(lane_km=0.5, at_start_per_lane_km=12.0, at_end_per_lane_km=12.0),
        duration_s=6.0,
    )
    added = {34: "bus", 101: "truck", 102: "pedestrian"}
    after = with_scripted(before, path, path, added)
    assert after.vehicles_realised == 7
    assert after.classes_realised == {"car": 3, "truck": 2, "bus": 1, "pedestrian": 1}
    assert (after.vehicle_classes[34], after.vehicle_classes[101]) == ("bus", "truck")
    assert 102 not in after.vehicle_classes
    assert (after.density.at_start_per_lane_km, after.density.at_end_per_lane_km) == (14.0, 12.0)


def test_vehicles_are_ranked_by_where_they_are_at_the_egos_start() -> None:
    def driving_from(key: int, first_step: int, x_m: float) -> Track:
        positions = np.column_stack([x_m + np.arange(30.0), np.zeros(30)])
        return Track(key, "car", 4.5, 1.8, first_step, positions, np.zeros(30), np.full(30, 10.0))

    tracks = {1: driving_from(1, 20, 0.0), 2: driving_from(2, 0, 30.0), 3: driving_from(3, 0, -5.0)}
    assert nearest_at(np.zeros(2), 0, tracks) == [3, 2]
    assert nearest_at(np.zeros(2), 20, tracks) == [1, 3, 2]


def test_an_impossible_manoeuvre_is_refused_with_sites_that_have_it(tmp_path: Path) -> None:
    with pytest.raises(NotPossible) as refusal:
        make("Landmoor", tmp_path, scenario_type="rural", others="cut_in", most_rounds=1)
    assert refusal.value.reason == "no_manoeuvre"
    assert "scenario_type=highway" in refusal.value.valid


def test_the_search_for_an_impossible_manoeuvre_is_bounded_by_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked: list[int] = []
    tried: list[ModificationRequest] = []

    def nothing_met(*_: object) -> tuple[Manoeuvre, ...]:
        looked.append(1)
        return ()

    def refused(request: ModificationRequest, _: object) -> None:
        tried.append(request)
        raise NotPossible("no room")

    monkeypatch.setattr(others, "manoeuvres_met", nothing_met)
    monkeypatch.setattr(others, "apply_edits", refused)
    monkeypatch.setattr(others, "MOST_PAIRS", 1)
    monkeypatch.setattr(generator, "MOST_TRIES", 5)
    with pytest.raises(NotPossible) as refusal:
        make("Neuland", tmp_path, scenario_type="highway", others="cut_in:truck", most_rounds=2)
    assert refusal.value.reason == "no_manoeuvre"
    assert len(tried) == 5
    written = 2 * 2  # in each draw, the written file is searched once by the generator and once before it is scripted
    assert 2 <= len(looked) <= 2 + written


def test_vehicles_that_merge_from_an_acceleration_lane_are_found_in_the_traffic(tmp_path: Path) -> None:
    made = make("Neuland", tmp_path, scenario_type="ramp", density="medium", others="merging", seed=1)
    assert made.others
    assert any(name.startswith("merging:") for name in manoeuvres_in(tmp_path))


def test_of_several_vehicles_the_first_of_the_class_counts() -> None:
    met = (Manoeuvre("cut_in", "truck", 40, 3), Manoeuvre("cut_in", "car", 10, 1), Manoeuvre("cut_in", "truck", 20, 2))
    classes = {1: "car", 2: "trailer", 3: "truck"}
    found = [first_of(RequestedManoeuvre("cut_in", name), met, classes.__getitem__) for name in (None, "truck", "bus")]
    assert [one.obstacle_id if one else None for one in found] == [1, 3, None]


def test_a_vehicle_that_the_request_needs_is_not_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = (
        town_road().with_vehicles(driving(77, (110, -20), 8.0, 60, heading_rad=math.pi / 2)).write(tmp_path / "s.xml")
    )
    tried: list[str] = []

    def refused(request: ModificationRequest, _: object) -> None:
        tried.extend(edit.op for edit in request.edits)
        raise NotPossible("no room")

    monkeypatch.setattr(others, "apply_edits", refused)
    wanted = RequestedManoeuvre("crossing", "truck")
    ops = []
    for needed in ((), ("car",)):
        tried.clear()
        assert others.scripted(path, "ZAM_A-1_1_T-1", wanted, {77: "car"}, tmp_path, 1, iter(range(9)), needed) is None
        ops.append(list(tried))
    assert ops == [["replace"], []]
