import re
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from support.elsewhere import generated
from support.generation import make, request_for

from plannerforge.engine.commonroad.document import schema_errors
from plannerforge.engine.commonroad.reader import read_recorded, read_scenario
from plannerforge.engine.commonroad.tracks import recorded_tracks
from plannerforge.engine.execution.executor import silent
from plannerforge.engine.generation import generator as generating
from plannerforge.engine.generation import site_network
from plannerforge.engine.generation.generator import generate_scenario
from plannerforge.engine.generation.site_network import SiteNetwork, build_network
from plannerforge.engine.vehicles import ego_class
from plannerforge.schemas.errors import InvalidRequest, NotPossible, PlannerForgeError, UnknownName
from plannerforge.schemas.generation import VehicleDemand
from plannerforge.schemas.vocabulary import EGO_CLASSES
from plannerforge.workflows.generation.making import summarise


@pytest.mark.parametrize(
    ("place", "kind", "classes"),
    [
        ("Musterstadt", "signalised_intersection", ("bus", "bicycle")),
        ("Kreiselheim", "roundabout", ("truck", "moped")),
        ("Neuland", "ramp", ("trailer", "coach")),
        ("Landmoor", "rural", ("motorcycle",)),
    ],
)
def test_a_scenario_matches_its_request(tmp_path: Path, place: str, kind: str, classes: tuple[str, ...]) -> None:
    wish = [VehicleDemand(vehicle_class=name, least=2) for name in classes]
    made = make(place, tmp_path, scenario_type=kind, vehicles=wish)
    assert made.site.scenario_type == kind
    assert all(made.classes_realised[name] >= 2 for name in classes)
    assert made.vehicles_realised >= 0.8 * made.vehicles_asked
    assert made.checks.schema_valid
    assert made.checks.goal_reachable
    assert made.checks.collisions_at_start == 0
    assert made.checks.recorded_ego_collision_free
    assert made.checks.overlapping_pairs == 0
    assert made.checks.feasible_share >= 0.97
    assert made.checks.centers_on_lanelets > 0.99
    density = made.density
    assert density.at_start_per_lane_km == pytest.approx(made.vehicles_realised / density.lane_km, abs=0.01)


def test_a_goal_may_be_on_a_lanelet_that_a_car_drives_over(tmp_path: Path) -> None:
    wish = {"scenario_type": "intersection", "duration_s": 12.0}
    first = make("Fahrhausen", tmp_path, goal="distance_m:40", **wish)
    made = make("Fahrhausen", tmp_path, goal=f"lanelet:{first.ego.goal_lanelet}:middle:8x3", **wish)
    assert made.ego.goal_lanelet == first.ego.goal_lanelet
    assert made.ego.goal_size_m == (8.0, 3.0)
    assert made.site == first.site
    assert made.checks.goal_reachable
    loaded = read_scenario(tmp_path / "scenario.xml")
    lanelet = loaded.scenario.lanelet_network.find_lanelet_by_id(made.ego.goal_lanelet)
    middle = lanelet.interpolate_position(lanelet.distance[-1] / 2)[0]
    assert np.linalg.norm(loaded.problem().goal.state_list[0].position.center - middle) < 0.01


@pytest.mark.parametrize(("lanelet", "error"), [("99999", UnknownName), ("1:900m", InvalidRequest)])
def test_a_goal_on_a_lanelet_that_is_not_there_is_refused(
    tmp_path: Path, lanelet: str, error: type[PlannerForgeError]
) -> None:
    with pytest.raises(error, match="99999" if lanelet == "99999" else "lanelet"):
        make("Fahrhausen", tmp_path, scenario_type="intersection", goal=f"lanelet:{lanelet}")


def test_a_goal_on_an_undriven_lanelet_names_driven_ones(tmp_path: Path) -> None:
    made = make("Fahrhausen", tmp_path, scenario_type="intersection")
    network = read_scenario(tmp_path / "scenario.xml").scenario.lanelet_network
    refusals = []
    for lanelet in network.lanelets[:12]:
        try:
            make("Fahrhausen", tmp_path, scenario_type="intersection", goal=f"lanelet:{lanelet.lanelet_id}")
        except NotPossible as refusal:
            refusals.append(refusal)
            break
    assert refusals
    assert str(made.ego.goal_lanelet) in refusals[0].text


def test_the_file_is_read_back_with_ego_goal_and_traffic_from_step_0(tmp_path: Path) -> None:
    made = make("Fahrhausen", tmp_path, scenario_type="intersection", goal="distance_m:30")
    path = tmp_path / "scenario.xml"
    assert schema_errors(path) == []
    loaded = read_scenario(path)
    assert loaded.benchmark_id == made.benchmark_id == "ZAM_Fahrhausen-1_1_T-1"
    tracks = recorded_tracks(loaded.scenario)
    assert len(tracks) == made.vehicles_realised - 1
    assert {track.first_step for track in tracks.values()} == {0}
    problem = loaded.problem()
    assert problem.initial_state.velocity == pytest.approx(made.ego.speed_mps, abs=1e-3)
    assert 29 <= made.ego.goal_distance_m <= 33
    assert loaded.scenario.location.gps_latitude == pytest.approx(made.site.latitude, abs=1e-5)
    assert (tmp_path / "scenario.net.xml").is_file()


def test_lights_match_sumo_s(tmp_path: Path) -> None:
    make("Musterstadt", tmp_path, scenario_type="signalised_intersection")
    network = read_scenario(tmp_path / "scenario.xml").scenario.lanelet_network
    assert network.traffic_lights
    states = {str(light.get_state_at_time_step(step).value) for light in network.traffic_lights for step in range(900)}
    assert {"red", "green"} <= states


def test_the_same_request_gives_the_same_bytes_under_another_hash_seed(tmp_path: Path, other_process: Executor) -> None:
    wish = request_for("Kreiselheim", tmp_path, scenario_type="any", density="medium", duration_s=5.0)
    here = generated(wish, tmp_path)
    assert here
    assert other_process.submit(generated, wish, tmp_path).result() == here


@pytest.mark.parametrize("name", EGO_CLASSES)
def test_the_ego_and_one_other_vehicle_have_the_requested_class(name: str, tmp_path: Path) -> None:
    made = make("Fahrhausen", tmp_path, ego=f"type:{name}")
    loaded = read_recorded(tmp_path / "scenario.xml").loaded
    (problem_id,) = loaded.planning_problems.planning_problem_dict
    assert loaded.ego_class(problem_id) == made.ego.vehicle_class == name
    assert made.classes_realised[name] >= 1
    assert made.checks.schema_valid
    assert made.checks.collisions_at_start == 0
    assert made.checks.recorded_ego_collision_free
    assert made.ego.speed_mps <= ego_class(name).vehicle.maximum_speed_mps


@pytest.mark.parametrize("name", ["bicycle", "pedestrian"])
def test_a_class_that_no_ego_has_joins_the_traffic_of_a_car_with_a_note(name: str, tmp_path: Path) -> None:
    made = make("Fahrhausen", tmp_path, ego=f"type:{name}")
    assert made.ego.vehicle_class == "car"
    assert made.classes_realised[name] >= 1
    assert any("so it is a car" in note for note in made.notes)


def test_a_site_that_the_map_lacks_is_refused_with_available_ones(tmp_path: Path) -> None:
    with pytest.raises(NotPossible, match="no roundabout") as caught:
        make("Landmoor", tmp_path, scenario_type="roundabout")
    assert set(caught.value.valid) == {"intersection", "rural"}


def test_a_class_that_no_road_is_open_to_is_refused(tmp_path: Path) -> None:
    bicycle = [VehicleDemand(vehicle_class="bicycle")]
    with pytest.raises(NotPossible, match="bicycle") as caught:
        make("Neuland", tmp_path, scenario_type="highway", vehicles=bicycle, road_classes=["motorway"], most_sites=1)
    assert "truck" in caught.value.valid


@pytest.mark.parametrize(
    "changes",
    [
        {"ego": "second"},
        {"ego": "index:-1"},
        {"goal": "steps:3"},
        {"goal": "lanelet:4:far"},
        {"goal": "lanelet:4:middle:0x3"},
        {"goal": "distance_m:9999"},
    ],
)
def test_an_ego_or_goal_that_cannot_be_read_is_refused(tmp_path: Path, changes: dict[str, object]) -> None:
    with pytest.raises(InvalidRequest) as caught:
        make("Landmoor", tmp_path, **changes)
    assert caught.value.valid


def test_a_ramp_without_link_roads_is_a_contradiction(tmp_path: Path) -> None:
    with pytest.raises(InvalidRequest, match="link"):
        make("Neuland", tmp_path, scenario_type="ramp", road_classes=["motorway"])


def test_an_index_beyond_the_cars_is_refused(tmp_path: Path) -> None:
    with pytest.raises(NotPossible, match="index:99"):
        make("Fahrhausen", tmp_path, ego="index:99", most_sites=1)


def test_a_real_extract_on_the_left_side(shared_data: Path, tmp_path: Path) -> None:
    path = shared_data / "data" / "osm" / "o2s_bristol_sausage_links.osm"
    wish = request_for("Fahrhausen", tmp_path, map_path=str(path), country="GBR", scenario_type="intersection")
    made = generate_scenario(wish, silent)
    assert made.checks.schema_valid
    assert made.checks.centers_on_lanelets > 0.97


def test_a_junction_too_large_to_draw_consists_of_smaller_ones(shared_data: Path, tmp_path: Path) -> None:
    path = shared_data / "data" / "osm" / "o2s_leeds_cycleway.osm"
    wish = request_for("Fahrhausen", tmp_path, map_path=str(path), country="GBR", scenario_type="urban", seed=0)
    made = generate_scenario(wish, silent)
    assert any("were not joined" in note for note in made.notes)
    assert made.checks.schema_valid


@pytest.mark.usefixtures("unknown_sites")
def test_every_different_warning_of_netconvert_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    warned = tuple(f"edge {number} is odd" for number in range(40))

    def built(*given: object) -> SiteNetwork:
        return replace(build_network(*given), warnings=(*warned, *warned))  # type: ignore[arg-type]

    monkeypatch.setattr(site_network, "build_network", built)
    made = make("Fahrhausen", tmp_path, scenario_type="intersection")
    assert made.netconvert_warnings == warned
    told = summarise(made, request_for("Fahrhausen", tmp_path), "any", reused=False).answer().to_text()
    assert "netconvert" not in told


def test_signs_show_the_posted_limits_although_traffic_slows_for_curves(tmp_path: Path) -> None:
    make("Kreiselheim", tmp_path, scenario_type="roundabout")
    network = read_scenario(tmp_path / "scenario.xml").scenario.lanelet_network
    signs = [element for sign in network.traffic_signs for element in sign.traffic_sign_elements]
    posted = {round(float(element.additional_values[0]) * 3.6) for element in signs if element.additional_values}
    assert posted <= {30, 50, 70, 100}
    driven = {float(speed) for speed in re.findall(r'speed="([\d.]+)"', (tmp_path / "scenario.net.xml").read_text())}
    assert min(driven) < 30 / 3.6 - 1


def test_a_request_near_its_time_limit_tries_no_further_site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[object] = []

    def refuses(*given: object) -> None:
        tried.append(given[2])
        raise NotPossible("this site is flooded")

    monkeypatch.setattr(generating, "prepare_site", refuses)
    for sites, expected in ((None, 10), (2, 2)):
        tried.clear()
        with pytest.raises(NotPossible, match="flooded"):
            make("Quadratstadt", tmp_path, scenario_type="intersection", most_sites=sites)
        assert len(tried) == expected


def test_after_the_most_rounds_the_best_scenario_is_returned_with_its_faults(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rounds: list[int] = []
    simulate = generating.generate_traffic

    def noting(*given: Any) -> Any:
        rounds.append(given[4])
        return simulate(*given)

    monkeypatch.setattr(generating, "generate_traffic", noting)
    monkeypatch.setattr(generating, "faults_of", lambda checks: ([], ["it could be better"]))
    made = make("Fahrhausen", tmp_path, scenario_type="intersection", most_rounds=2)
    assert rounds == [0, 1]
    assert "it could be better" in made.notes


@pytest.mark.usefixtures("unknown_sites")
def test_a_scenario_is_the_same_if_its_site_was_built_for_another_one(tmp_path: Path) -> None:
    wishes = [{"seed": 1}, {"seed": 2, "vehicles": (VehicleDemand(vehicle_class="truck"),)}]

    def made(folder: Path, wish: dict[str, Any]) -> list[bytes]:
        folder.mkdir()
        report = make("Kreiselheim", folder, scenario_type="roundabout", duration_s=5.0, **wish)
        files = ((folder / name).read_bytes() for name in ("scenario.xml", "scenario.net.xml"))
        return [*files, report.model_dump_json().encode()]

    one_after_the_other = [made(tmp_path / f"kept {wish['seed']}", wish) for wish in wishes]
    for wish, before in zip(wishes, one_after_the_other, strict=True):
        site_network.forget_sites()
        assert made(tmp_path / f"alone {wish['seed']}", wish) == before


def test_a_fault_of_the_returned_attempt_is_not_repeated_for_dropped_attempts() -> None:
    scenario = SimpleNamespace(notes=("trucks are missing",))
    best = SimpleNamespace(faults=("too few cars",), lacks=False, scenario=scenario)
    other = SimpleNamespace(faults=("too few cars", "vehicles overlap"), lacks=False)
    refusal = SimpleNamespace(message="trucks are missing")
    attempts: Any = SimpleNamespace(made=[best, other], refusals=[refusal], lost=[])
    (note,) = generating._Attempts.notes_besides(attempts, best)  # type: ignore[arg-type]
    assert note.endswith("vehicles overlap")
