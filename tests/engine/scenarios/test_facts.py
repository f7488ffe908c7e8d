"""The facts of a scenario: metadata layers and computed features, on hand-made and on real files."""

from dataclasses import replace
from pathlib import Path

import pytest
from support.builders import Problem, ScenarioBuilder, Vehicle, driving, town_road

from plannerforge.engine.execution.executor import silent
from plannerforge.engine.scenarios.facts import read_facts
from plannerforge.schemas.scenarios import ReadFactsRequest, ScenarioFacts

PARKED = Vehicle(50, ((100.0, -4.0, 0.0, 0.0),), kind="parkedVehicle")


def facts_of(builder: ScenarioBuilder, folder: Path) -> ScenarioFacts:
    return read_facts(ReadFactsRequest(path=builder.write(folder / "scenario.xml")), silent)


def test_participants_are_counted_by_type_moving_and_standing(tmp_path: Path) -> None:
    found = facts_of(replace(town_road(), parked=(PARKED,)), tmp_path)
    assert found.participants.dynamic == {"car": 3, "motorcycle": 1, "truck": 1}
    assert found.participants.static == {"parkedVehicle": 1}
    assert found.participants.total == 6


def test_the_ego_its_lanes_and_its_goal(tmp_path: Path) -> None:
    ego = facts_of(town_road(), tmp_path).ego
    assert ego is not None
    assert (ego.problem_id, ego.speed_mps, ego.lanes, ego.lanelets) == (100, 10.0, 2, (1,))
    assert ego.route == (1,)
    assert "time" in ego.goal_forms
    assert (ego.goal_first_step, ego.goal_last_step) == (60, 150)


@pytest.mark.parametrize(
    ("goal", "feature"),
    [
        ((150.0, 0.0, 8.0, 3.0), "ego_goes_straight"),
        ((220.0, -60.0, 3.0, 8.0), "ego_turns_right"),
        ((250.0, 3.5, 8.0, 3.0), "ego_changes_lane"),
    ],
)
def test_the_route_to_the_goal_is_a_feature(
    tmp_path: Path, goal: tuple[float, float, float, float], feature: str
) -> None:
    features = facts_of(replace(town_road(), problems=(Problem(goal=goal),)), tmp_path).features
    ways = {"ego_goes_straight", "ego_turns_left", "ego_turns_right", "ego_changes_lane"}
    assert ways & set(features) == {feature}


def test_a_goal_without_a_place_has_no_way(tmp_path: Path) -> None:
    found = facts_of(replace(town_road(), problems=(Problem(goal=None),)), tmp_path)
    assert not [feature for feature in found.features if feature.startswith(("ego_goes", "ego_turns", "ego_changes"))]


def test_traffic_around_the_ego_is_seen(tmp_path: Path) -> None:
    assert {"lead_vehicle", "oncoming_traffic", "multi_lane"} <= set(facts_of(town_road(), tmp_path).features)
    behind = town_road().with_vehicles(driving(32, (15, 0), 10.0, 50))
    assert not {"lead_vehicle", "oncoming_traffic"} & set(facts_of(behind, tmp_path).features)


def test_tags_of_the_file_stay_apart_from_features(tmp_path: Path) -> None:
    found = facts_of(replace(town_road(), tags=("roundabout", "urban")), tmp_path)
    assert found.tags == ("roundabout", "urban")
    assert "roundabout" not in found.features


def test_several_planning_problems_are_all_listed_the_lowest_id_first(tmp_path: Path) -> None:
    problems = (Problem(102, start=(60.0, 3.5, 0.0, 20.0)), Problem(101))
    found = facts_of(replace(town_road(), problems=problems), tmp_path)
    assert [ego.problem_id for ego in found.egos] == [101, 102]
    assert found.ego is not None
    assert found.ego.speed_mps == 10.0


def test_a_scenario_without_a_planning_problem_has_facts(tmp_path: Path) -> None:
    found = facts_of(replace(town_road(), problems=()), tmp_path)
    assert found.ego is None
    assert found.features == ()


def test_old_files_are_read(tmp_path: Path) -> None:
    found = facts_of(replace(town_road(), version="2018b"), tmp_path)
    assert found.tags == ("urban",)
    assert found.participants.total == 5


@pytest.mark.shared_data
def test_real_signs_lights_and_limits(shared_data: Path) -> None:
    def read(name: str) -> ScenarioFacts:
        return read_facts(ReadFactsRequest(path=shared_data / "data/commonroad" / f"{name}.xml"), silent)

    lanker = read("USA_Lanker-1_11_T-1").roads
    assert 48.3 in lanker.limits_map_kmh
    assert "no_u_turn" in lanker.signs_map
    spain = read("ESP_Barcelona-38_52_T-1").roads
    assert spain.limits_ego_kmh == (50.0,)
    assert read("ZAM_Zip-2_1_T-1").egos[0].goal_forms == ()
    assert read("ZAM_test_0-1").scenario_id == "ZAM_test_0-1"


def test_a_phantom_obstacle_has_no_size_to_refuse(tmp_path: Path) -> None:
    phantom = (
        '  <phantomObstacle id="77"><occupancySet><occupancy><shape><rectangle><length>5</length><width>2</width>'
        "<center><x>50</x><y>0</y></center></rectangle></shape><time><exact>1</exact></time></occupancy></occupancySet>"
        "</phantomObstacle>\n"
    )
    path = tmp_path / "phantom.xml"
    path.write_text(town_road().xml().replace("  <planningProblem", phantom + "  <planningProblem", 1), "utf-8")
    found = read_facts(ReadFactsRequest(path=path), silent)
    assert found.participants.total == 5


def test_a_scenario_that_begins_later_has_the_same_traffic(tmp_path: Path) -> None:
    road = town_road()
    later = replace(
        road.with_vehicles(*(replace(vehicle, first_step=vehicle.first_step + 20) for vehicle in road.vehicles)),
        problems=(Problem(start_step=20, steps=(80, 170)),),
    )
    found, expected = facts_of(later, tmp_path), facts_of(road, tmp_path)
    assert found.features == expected.features
    assert "lead_vehicle" in found.features
    assert found.density_per_km == expected.density_per_km


@pytest.mark.parametrize(
    ("time_of_day", "time", "weather", "expected"),
    [
        ("night", "23:15:00", "snow", ("night", "snow")),
        ("unknown", "17:30:00", "light_rain", ("rush_hour", "light_rain")),
        ("unknown", "02:00:00", "fog", ("fog",)),
    ],
)
def test_weather_and_time_come_from_the_environment_of_a_file(
    tmp_path: Path, time_of_day: str, time: str, weather: str, expected: tuple[str, ...]
) -> None:
    path = town_road().write(tmp_path / "scenario.xml")
    environment = (
        f"<environment><time>{time}</time><timeOfDay>{time_of_day}</timeOfDay><weather>{weather}</weather>"
        "<underground>wet</underground></environment></location>"
    )
    path.write_text(path.read_text().replace("</location>", environment, 1))
    assert read_facts(ReadFactsRequest(path=path), silent).circumstances == expected


def test_an_imported_file_states_who_overlaps_the_ego_and_that_it_violates_the_schema(tmp_path: Path) -> None:
    on_the_ego = replace(PARKED, poses=((41.0, 0.0, 0.0, 0.0),))
    path = replace(town_road(), parked=(on_the_ego,)).write(tmp_path / "scenario.xml")
    (overlap,) = read_facts(ReadFactsRequest(path=path, checks=True), silent).faults
    assert "50" in overlap
    assert not read_facts(ReadFactsRequest(path=path), silent).faults
    path.write_text(
        path.read_text(encoding="utf-8").replace("</commonRoad>", "<colours/></commonRoad>"), encoding="utf-8"
    )
    assert len(read_facts(ReadFactsRequest(path=path, checks=True), silent).faults) == 2


def test_a_sound_file_states_no_fault(tmp_path: Path) -> None:
    path = town_road().write(tmp_path / "scenario.xml")
    assert read_facts(ReadFactsRequest(path=path, checks=True), silent).faults == ()
