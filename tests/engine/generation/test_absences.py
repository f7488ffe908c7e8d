"""Why vehicles that were asked for are not there as asked: kept with the scenario, told, and logged."""

import logging
from pathlib import Path

import numpy as np
import pytest
from support.generation import make
from support.tree import CHECKOUT

from plannerforge.engine.generation.record import absences_of
from plannerforge.engine.generation.traffic import GeneratedTraffic
from plannerforge.engine.traffic.motions import DroppedVehicle, GeneratedVehicle, drop_infeasible
from plannerforge.engine.traffic.vehicle_counts import Demand
from plannerforge.engine.vehicles.classes import vehicle_classes
from plannerforge.engine.vehicles.motion import Motion
from plannerforge.schemas.generation import ABSENCE_REASONS, GeneratedScenario, RequestedEgo, VehicleAbsence

DEMAND = Demand({"car": 6, "truck": 2}, {"truck": 2}, {})


def standing(key: str, x_m: float = 0.0, name: str = "car", *, feasible: bool = True) -> GeneratedVehicle:
    still = np.zeros(5)
    motion = Motion(np.tile([x_m, 0.0], (5, 1)), still, still, still)
    return GeneratedVehicle(key, vehicle_classes()[name], motion, feasible)


def told(
    vehicles: list[GeneratedVehicle], *dropped: DroppedVehicle, demand: Demand = DEMAND, ego: str = "first"
) -> set[tuple[str, str, str, int]]:
    traffic = GeneratedTraffic(tuple(vehicles), demand, (), dropped)
    found = absences_of(RequestedEgo.of(ego), DEMAND, traffic, vehicles, stands_in=ego.startswith("index"))
    return {(one.fate, one.code, one.vehicle_class, one.count) for one in found}


def cars(count: int) -> list[GeneratedVehicle]:
    return [standing(str(number)) for number in range(count)]


TRUCKS = [standing("t1", name="truck"), standing("t2", name="truck")]


def test_no_absence_is_reported_if_all_vehicles_are_present() -> None:
    assert told([*cars(6), *TRUCKS]) == set()


def test_absences_without_room_and_omissions_add_up_to_the_missing_vehicles() -> None:
    gone = [DroppedVehicle(standing("x"), "overlap"), DroppedVehicle(standing("y"), "not_drivable")]
    assert told([*cars(3), *TRUCKS], *gone) == {
        ("left_out", "overlap", "car", 1),
        ("left_out", "not_drivable", "car", 1),
        ("never_there", "no_room", "car", 1),
    }


def test_a_vehicle_with_a_spare_in_its_place_counts_as_replaced() -> None:
    assert told([*cars(6), *TRUCKS], DroppedVehicle(standing("x"), "overlap")) == {("replaced", "overlap", "car", 1)}


def test_vehicles_beyond_a_file_s_limit_are_reported() -> None:
    fewer = Demand({"car": 4, "truck": 2}, {"truck": 2}, {})
    assert told([*cars(4), *TRUCKS], demand=fewer) == {("never_there", "file_too_large", "car", 2)}


@pytest.mark.parametrize(
    ("ego", "absence"),
    [("index:2", ("replaced", "no_such_goal", "car", 1)), ("type:bicycle", ("replaced", "no_ego_class", "bicycle", 1))],
)
def test_an_ego_that_another_vehicle_replaced_is_reported(ego: str, absence: tuple[str, str, str, int]) -> None:
    assert told([*cars(6), *TRUCKS], ego=ego) == {absence}


def test_overlapping_and_undrivable_vehicles_are_distinguished() -> None:
    row = [standing("a", 0), standing("b", 4), standing("c", 8), standing("d", 30, feasible=False)]
    _, dropped = drop_infeasible(row, {})
    assert {(one.vehicle.vehicle_id, one.code) for one in dropped} == {("b", "overlap"), ("d", "not_drivable")}


def test_every_code_is_in_the_docs() -> None:
    page = (CHECKOUT / "docs" / "generation.md").read_text(encoding="utf-8")
    assert [code for code in ABSENCE_REASONS if f"| `{code}` |" not in page] == []


def test_a_scenario_keeps_why_vehicles_are_missing_and_the_engine_logs_it(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.DEBUG, logger="plannerforge.engine"):
        made = make("Fahrhausen", tmp_path, ego="type:bicycle", density="medium", scenario_type="intersection")
    missing = sum(one.count for one in made.absences if one.fate != "replaced")
    assert missing == made.vehicles_asked - made.vehicles_realised
    assert "no_ego_class" in {one.code for one in made.absences}
    events = [record.getMessage() for record in caplog.records]
    assert sum(event.startswith("vehicles_absent fate=") for event in events) == len(made.absences)
    assert GeneratedScenario.model_validate_json(made.model_dump_json()) == made


def test_the_engine_does_not_log_unless_requested(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    make("Landmoor", tmp_path, scenario_type="rural")
    assert [record for record in caplog.records if record.name.startswith("plannerforge.engine")] == []


def test_a_record_of_before_is_read(tmp_path: Path) -> None:
    made = make("Landmoor", tmp_path, scenario_type="rural").model_copy(update={"absences": ()})
    assert "absences" not in made.model_dump(mode="json")
    assert GeneratedScenario.model_validate_json(made.model_dump_json()).absences == ()


def test_only_vehicles_without_a_replacement_are_missing_in_the_text() -> None:
    absence = VehicleAbsence(fate="never_there", code="no_room", vehicle_class="car", count=2, reason="full")
    assert absence.in_words() == "2 cars (no_room: full)"
