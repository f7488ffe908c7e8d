"""The friction of roads: stated by an edit, kept in the file, and held to by all that drives or judges."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lxml import etree
from support.builders import Problem, driving, town_road
from support.edits import Apply, apply_to, schema_errors
from support.generation import make
from support.planning import configuration

from plannerforge.engine.commonroad.reader import kept_recording, read_scenario
from plannerforge.engine.edits.scene_cache import scene_of
from plannerforge.engine.execution.executor import silent
from plannerforge.engine.maps import RoadFile
from plannerforge.engine.maps.foreign.lanelet_map import write_network
from plannerforge.engine.planners.reference_drivers.models import CAR_BRAKES
from plannerforge.engine.planners.runs import run_planner
from plannerforge.engine.scenarios.exchange.openscenario import write_openscenario
from plannerforge.engine.vehicles import BMW_320I, GRAVITY_MPS2, Motion, check_drivability, check_kinematics
from plannerforge.schemas.artifacts import ForeignExportRequest
from plannerforge.schemas.errors import InvalidRequest, UnsafeInput
from plannerforge.schemas.generation import TrafficConditions
from plannerforge.schemas.planning import RunRequest, RunResponse
from plannerforge.schemas.vocabulary import ROAD_FRICTIONS

SLIPPERY = {"op": "set_weather", "params": ["friction=0.2"]}
HELD_MPS2 = 0.2 * GRAVITY_MPS2
STANDING_AHEAD = replace(
    town_road(),
    vehicles=(driving(31, (70.0, 0.0), 0.0, 151),),
    problems=(Problem(start=(20.0, 0.0, 0.0, 13.0), goal=(150.0, 0.0, 8.0, 3.0), steps=(60, 140)),),
)


def test_a_stated_friction_is_read_again_without_other_changes(apply: Apply) -> None:
    applied = apply(SLIPPERY)
    assert read_scenario(applied.xml).friction == 0.2
    assert kept_recording(applied.xml).loaded.friction == 0.2
    assert applied.changed_elements() == set()
    assert schema_errors(applied.xml) <= schema_errors(applied.base)
    assert read_scenario(applied.base).friction is None


@pytest.mark.parametrize(
    ("params", "friction"),
    [
        (["weather=snow"], ROAD_FRICTIONS["snow"]),
        (["rain"], ROAD_FRICTIONS["wet"]),
        (["weather=snow", "friction=0.4"], 0.4),
        (["friction=ice"], ROAD_FRICTIONS["ice"]),
        (["weather=fog"], None),
    ],
)
def test_a_weather_states_the_friction_that_is_known_for_it(
    apply: Apply, params: list[str], friction: float | None
) -> None:
    assert read_scenario(apply({"op": "set_weather", "params": params}).xml).friction == friction


@pytest.mark.parametrize("text", ["friction=5", "friction=0", "friction=-1", "friction=nan", "friction=slick"])
def test_a_friction_that_no_road_has_is_refused(apply: Apply, text: str) -> None:
    with pytest.raises(InvalidRequest) as refused:
        apply({"op": "set_weather", "params": [text]})
    assert any("friction" in word for word in map(str, refused.value.valid))


def test_later_edits_keep_the_friction_and_the_last_statement_counts(apply: Apply, tmp_path: Path) -> None:
    first = apply(SLIPPERY)
    second = apply_to(first.xml, tmp_path / "second", {"op": "remove_vehicle", "vehicles": ["31"]})
    third = apply_to(second.xml, tmp_path / "third", {"op": "set_weather", "params": ["friction=0.6"]})
    assert read_scenario(second.xml).friction == 0.2
    assert read_scenario(third.xml).friction == 0.6
    assert third.xml.read_bytes().count(b"friction=") == 1


def test_driven_traffic_brakes_within_the_road_s_friction(apply: Apply) -> None:
    stop = {"op": "set_speed", "vehicles": ["31"], "speed": "0m/s"}

    def hardest(*edits: dict[str, object]) -> float:
        return float(-np.diff(apply(*edits).tracks()[31].speeds_mps).min() / 0.1)

    assert hardest(stop) > 1.3 * HELD_MPS2
    assert hardest(SLIPPERY, stop) <= 1.1 * HELD_MPS2


def test_a_prescribed_braking_beyond_the_road_is_refused(apply: Apply) -> None:
    brake = {"op": "set_speed", "vehicles": ["31"], "speed": "0m/s", "rate_mps2": 4.0}
    with pytest.raises(InvalidRequest):
        apply(SLIPPERY, brake)


def test_curves_are_driven_slower_on_a_slippery_road(apply: Apply) -> None:
    applied = apply(SLIPPERY)
    dry, slippery = (scene_of(path).scene.lane_speeds_mps for path in (applied.base, applied.xml))
    assert slippery[12] < dry[12]
    assert slippery[1] == dry[1]


def test_both_judges_of_motions_use_the_road_s_friction() -> None:
    speeds = np.arange(20.0, 5.0, -0.4)
    stations = np.concatenate([[0.0], np.cumsum((speeds[1:] + speeds[:-1]) / 2 * 0.1)])
    still = np.zeros(len(speeds))
    motion = Motion(np.column_stack([stations, still]), still, speeds, np.full(len(speeds), -4.0))
    for check in (check_kinematics, check_drivability):
        assert check(motion, 0.1).feasible
        assert not check(motion, 0.1, friction=0.2).feasible


def test_tyres_grip_less_on_a_slippery_road_and_the_power_stays() -> None:
    on_ice = BMW_320I.on_road(0.1)
    assert on_ice.maximum_acceleration_mps2 == pytest.approx(0.981)
    assert on_ice.most_acceleration_mps2(50.0) == pytest.approx(min(0.981, BMW_320I.most_acceleration_mps2(50.0)))
    assert on_ice.hardest_braking_mps2 == pytest.approx(0.981)
    assert BMW_320I.on_road(None) is BMW_320I


def test_reference_drivers_brake_within_the_road_s_friction() -> None:
    brakes = CAR_BRAKES.on_road(0.2)
    assert brakes.full_mps2 == pytest.approx(HELD_MPS2)
    assert brakes.jerk_mps3 == pytest.approx(CAR_BRAKES.jerk_mps3)
    assert CAR_BRAKES.on_road(None) is CAR_BRAKES


def driven(path: Path, planner: str) -> RunResponse:
    return run_planner(
        RunRequest(
            run_id="run_0",
            scenario_path=str(path),
            scenario_id="ZAM_Builder-1_1_T-1",
            configuration=configuration(planner),
        ),
        silent,
    )


@pytest.mark.parametrize("planner", ["frenetix:Default", "mp_rbfn:Default", "idm:Default", "fiss:Default"])
def test_planners_brake_within_the_road_s_friction(apply: Apply, planner: str) -> None:
    record = driven(apply(SLIPPERY, builder=STANDING_AHEAD).xml, planner).record
    assert record.friction == 0.2
    assert record.metrics is not None
    assert record.metrics.maximum_braking_mps2 <= 1.01 * HELD_MPS2
    assert not record.beyond_vehicle


def test_an_unstated_friction_is_not_recorded(tmp_path: Path) -> None:
    record = driven(STANDING_AHEAD.write(tmp_path / "dry.xml"), "idm:Default").record
    assert record.metrics is not None
    assert record.metrics.maximum_braking_mps2 > 1.3 * HELD_MPS2
    assert "friction" not in record.model_dump()


def test_openscenario_carries_the_friction_as_a_share_of_a_dry_road(apply: Apply, tmp_path: Path) -> None:
    target = tmp_path / "scenario.xosc"
    asked = ForeignExportRequest(scenario_path=str(apply(SLIPPERY).xml), target_path=str(target), roads="roads.xodr")
    write_openscenario(asked, silent)
    (road,) = etree.parse(target).getroot().iter("RoadCondition")
    assert float(road.get("frictionScaleFactor", "nan")) == pytest.approx(0.2 / ROAD_FRICTIONS["dry"], abs=1e-3)


@pytest.mark.parametrize("text", ["7", "0.0", "1.2.3"])
def test_a_file_with_a_friction_that_no_road_has_is_refused(apply: Apply, tmp_path: Path, text: str) -> None:
    broken = tmp_path / "broken.xml"
    broken.write_bytes(apply(SLIPPERY).xml.read_bytes().replace(b'friction="0.2"', f'friction="{text}"'.encode()))
    with pytest.raises(UnsafeInput):
        read_scenario(broken)


def test_a_scenario_generated_in_snow_is_driven_within_the_tyres_limits(tmp_path: Path) -> None:
    make("Kreiselheim", tmp_path, conditions=TrafficConditions(weather="snow"), duration_s=8.0, density="medium")
    loaded = read_scenario(tmp_path / "scenario.xml")
    assert loaded.friction == ROAD_FRICTIONS["snow"]
    changes = [np.abs(np.diff(track.speeds_mps)).max() / loaded.step_s for track in loaded.tracks.values()]
    assert max(changes) <= ROAD_FRICTIONS["snow"] * GRAVITY_MPS2 + 0.1


def test_the_network_of_a_scenario_keeps_its_friction_as_a_map(apply: Apply, tmp_path: Path) -> None:
    write_network(apply(SLIPPERY).xml, tmp_path / "map.xml")
    assert RoadFile.read(tmp_path / "map.xml").friction == 0.2
