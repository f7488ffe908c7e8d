"""Numbers of vehicles: as asked, or refused with the number that found room; what is missed is told."""

from pathlib import Path
from typing import Any

import pytest
from support.generation import make

from plannerforge.engine.generation import generator, traffic
from plannerforge.engine.generation.record import density_notes
from plannerforge.engine.traffic.simulation import RawTrack
from plannerforge.engine.traffic.vehicle_counts import Demand, plan_counts
from plannerforge.schemas.errors import InvalidRequest, NotPossible
from plannerforge.schemas.generation import DensityFacts, VehicleDemand


def test_a_counted_class_has_that_many_vehicles_and_no_more(tmp_path: Path) -> None:
    made = make("Kreiselheim", tmp_path, vehicles=[VehicleDemand(vehicle_class="truck", least=1)], density="high")
    assert made.classes_realised["truck"] == 1


def test_more_than_find_room_are_refused_with_the_number_that_does(tmp_path: Path) -> None:
    crowd = [VehicleDemand(vehicle_class="trailer", least=120)]
    with pytest.raises(NotPossible, match="120 trailers requested, but only") as caught:
        make("Landmoor", tmp_path, scenario_type="intersection", vehicles=crowd, most_sites=1)
    (room,) = caught.value.valid
    name, _, count = str(room).partition("=")
    assert name == "trailer"
    assert 0 < int(count) < 120


@pytest.mark.parametrize(("asked_for", "simulations"), [(120, 1), (4, traffic.ATTEMPTS)])
def test_a_full_site_is_not_filled_again_but_one_that_lacks_few_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, asked_for: int, simulations: int
) -> None:
    rounds, made_traffic, filled = list[int](), generator.generate_traffic, list[int]()
    simulate = traffic.simulate_traffic

    def counted_round(request: Any, demand: Any, site: Any, number: int, *rest: Any) -> Any:
        rounds.append(number)
        return made_traffic(request, demand, site, number, *rest)

    def no_trailer(*given: Any, **named: Any) -> tuple[RawTrack, ...]:
        filled.append(len(rounds))
        return tuple(one for one in simulate(*given, **named) if one.vehicle_class.name != "trailer")

    monkeypatch.setattr(generator, "generate_traffic", counted_round)
    monkeypatch.setattr(traffic, "simulate_traffic", no_trailer)
    crowd = [VehicleDemand(vehicle_class="trailer", least=asked_for)]
    with pytest.raises(NotPossible, match=r"but only \d+ trailers? found room"):
        make("Landmoor", tmp_path, scenario_type="intersection", vehicles=crowd)
    assert filled.count(1) == simulations  # of the first round


def test_an_ego_is_found_in_a_crowd_of_trucks_as_spare_cars_may_become_it(shared_data: Path, tmp_path: Path) -> None:
    path = shared_data / "data" / "osm" / "o2s_tempe_light_rail.osm"
    crowd = [VehicleDemand(vehicle_class="truck", least=100)]
    made = make(
        "Fahrhausen",
        tmp_path,
        map_path=str(path),
        country="USA",
        vehicles=crowd,
        duration_s=4.0,
        goal="steps:30",
        seed=0,
    )
    assert made.classes_realised == {"truck": 100}
    assert made.ego.goal_distance_m >= 10


def test_as_many_pedestrians_as_found_room_can_be_requested(shared_data: Path, tmp_path: Path) -> None:
    path = shared_data / "data" / "osm" / "planet_10.068_48.135_10.071_48.137.osm"
    small = {"map_path": str(path), "country": "DEU", "duration_s": 20.0, "seed": 0, "most_sites": 1}
    with pytest.raises(NotPossible) as caught:
        make("Fahrhausen", tmp_path, vehicles=[VehicleDemand(vehicle_class="bus", least=20)], **small)
    room = int(str(caught.value.valid[0]).removeprefix("bus="))
    made = make("Fahrhausen", tmp_path, vehicles=[VehicleDemand(vehicle_class="bus", least=room)], **small)
    assert made.classes_realised["bus"] == room


def test_an_ego_that_cannot_be_and_is_kept_out_of_the_traffic_is_a_contradiction(tmp_path: Path) -> None:
    none = [VehicleDemand(vehicle_class="bicycle", least=0, most=0)]
    with pytest.raises(InvalidRequest, match="vehicles excludes it"):
        make("Fahrhausen", tmp_path, ego="type:bicycle", vehicles=none)


def test_an_ego_of_a_class_that_may_be_absent_is_there_all_the_same(tmp_path: Path) -> None:
    few = [VehicleDemand(vehicle_class="truck", least=0, most=3)]
    made = make("Fahrhausen", tmp_path, ego="type:truck", vehicles=few)
    assert made.ego.vehicle_class == "truck"
    assert made.classes_realised.get("truck", 0) <= 3
    bicycle = [VehicleDemand(vehicle_class="bicycle", least=0, most=3)]
    assert make("Fahrhausen", tmp_path, ego="type:bicycle", vehicles=bicycle).classes_realised["bicycle"] == 1


def density(lane_km: float, target: float, found: float) -> DensityFacts:
    return DensityFacts(
        wish="high",
        paper_trips=100,
        lane_km=lane_km,
        target_per_lane_km=target,
        at_start_per_lane_km=found,
        at_end_per_lane_km=found,
    )


@pytest.mark.parametrize(
    ("facts", "demand", "realised", "reason"),
    [
        (density(0.4, 7, 20), plan_counts("low", [], 0.4), 8, "only 0.4 lane-km"),
        (density(1, 7, 30), Demand({"car": 5, "truck": 25}, {"truck": 25}, {}), 30, "that many"),
        (density(20, 28, 15), plan_counts("high", [], 20.0), 300, "at most 300"),
        (density(4, 28, 20), plan_counts("high", [], 4.0), 80, "no further vehicle found room"),
        (density(4, 28, 1.25), Demand({"car": 5}, {"car": 4}, {"car": 4}), 5, "number of cars was limited"),
    ],
)
def test_a_missed_density_is_reported_with_its_reason(
    facts: DensityFacts, demand: Demand, realised: int, reason: str
) -> None:
    told = density_notes(facts, demand, realised)
    assert f"{facts.at_start_per_lane_km:g} vehicles per lane-km at the start instead of" in told[-1]
    assert reason in told[-1]


def test_a_density_near_its_target_needs_no_words() -> None:
    assert density_notes(density(4, 28, 24), Demand({"car": 96}, {}, {}), 96) == []


def test_more_vehicles_than_a_file_can_have_are_reduced_and_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(traffic, "MOST_STATES", 600)
    made = make("Musterstadt", tmp_path, density="high", vehicles=[VehicleDemand(vehicle_class="truck", least=3)])
    assert made.vehicles_realised <= 600 / 30
    assert made.classes_realised["truck"] == 3
    assert any("600 states of vehicles" in note for note in made.notes)


def test_numbers_beyond_a_file_s_limit_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(traffic, "MOST_STATES", 600)
    with pytest.raises(NotPossible, match="too large"):
        make("Kreiselheim", tmp_path, vehicles=[VehicleDemand(vehicle_class="truck", least=40)], most_sites=1)


def test_a_recording_that_ends_early_is_reported(tmp_path: Path) -> None:
    made = make("Landmoor", tmp_path, scenario_type="rural", duration_s=120.0)
    cut = [note for note in made.notes if "120 s are recorded" in note]
    assert bool(cut) == (made.recorded_s < 119.8)
    assert cut
