"""A described scenario: where vehicles are in words, what lanelets lead to, and what the focus changes."""

from dataclasses import replace
from pathlib import Path

import pytest
from builders import Problem, driving, town_road

from plannerforge.engine.execution.progress import silent
from plannerforge.engine.scenarios.describe import describe
from plannerforge.schemas.errors import UnknownName
from plannerforge.schemas.scenario_text import ego_text
from plannerforge.schemas.scenarios import DescribeRequest, Description, Detail


def described(path: Path, detail: Detail = "vehicles", focus: str | None = None, radius_m: float = 400) -> Description:
    return describe(DescribeRequest(path=path, detail=detail, focus=focus, radius_m=radius_m), silent)


@pytest.fixture
def town(tmp_path: Path) -> Path:
    return town_road().write(tmp_path / "scenario.xml")


def test_vehicles_are_placed_in_words(town: Path) -> None:
    words = {vehicle.vehicle_id: vehicle.where for vehicle in described(town).vehicles}
    assert words == {
        31: "30 m ahead, same lane",
        32: "25 m behind, same lane",
        33: "20 m ahead, left lane",
        34: "240 m ahead, oncoming",
        35: "125 m ahead, same lane",
    }


def test_the_gap_is_bumper_to_bumper(town: Path) -> None:
    lead = next(vehicle for vehicle in described(town).vehicles if vehicle.vehicle_id == 31)
    assert lead.ahead_m == pytest.approx(30.0, abs=0.1)
    assert lead.gap_m == pytest.approx(30.0 - (4.5 + 4.508) / 2, abs=0.1)


def test_a_vehicle_that_comes_later_says_when(tmp_path: Path) -> None:
    later = town_road().with_vehicles(driving(40, (100, 0), 10.0, 50, first_step=20))
    vehicle = described(later.write(tmp_path / "later.xml")).vehicles[0]
    assert vehicle.from_s == pytest.approx(2.0)


def test_lanelets_say_where_they_lead_and_what_lies_beside(town: Path) -> None:
    lanelets = {lanelet.lanelet_id: lanelet for lanelet in described(town, "lanelets").lanelets}
    assert set(lanelets[1].successors) == {"straight 11", "right 12"}
    assert lanelets[1].left == 2
    assert (lanelets[1].edge, lanelets[2].edge, lanelets[13].edge) == ("e1", "e1", "e13")
    assert lanelets[2].opposite == 3
    assert "ego starts here" in lanelets[1].role
    assert lanelets[1].vehicles == (31, 32, 35)


def test_the_focus_moves_the_centre(town: Path) -> None:
    assert described(town, focus="34").vehicles[0].vehicle_id == 34
    assert described(town, focus="class:truck").focus == "vehicle 33"
    assert described(town, "lanelets", focus="13", radius_m=5).lanelets[0].lanelet_id in (1, 13)


def test_the_radius_bounds_what_is_listed(town: Path) -> None:
    found = described(town, radius_m=22)
    assert [vehicle.vehicle_id for vehicle in found.vehicles] == [33]
    assert found.vehicles_total == 5


def test_an_unknown_focus_is_refused(town: Path) -> None:
    with pytest.raises(UnknownName, match="neither"):
        described(town, focus="9999")


def test_without_an_ego_vehicles_are_still_listed(tmp_path: Path) -> None:
    path = replace(town_road(), problems=()).write(tmp_path / "nobody.xml")
    found = described(path)
    assert found.ego is None
    assert len(found.vehicles) == 5


def test_an_ego_beside_the_road_is_on_no_lanelet(tmp_path: Path) -> None:
    path = replace(town_road(), problems=(Problem(start=(40.0, -60.0, 0.0, 0.0)),)).write(tmp_path / "beside.xml")
    ego = described(path).ego
    assert ego is not None
    assert ego_text(ego).startswith("Ego: 0.0 m/s on no lanelet, ")


def test_the_checks_name_problems(tmp_path: Path) -> None:
    path = replace(town_road(), problems=(Problem(start=(70.0, 0.0, 0.0, 10.0)),)).write(tmp_path / "hit.xml")
    checks = described(path, "checks").checks
    assert any(check.startswith("problem: the ego overlaps vehicle 31") for check in checks)
    assert "ok: lanelets lead from the ego's start to its goal" in checks


def test_a_second_description_is_the_same(town: Path) -> None:
    assert described(town) == described(town)
