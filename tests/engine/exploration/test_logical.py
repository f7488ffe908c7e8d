"""The catalogue of logical scenarios: each stands on its road, and its ordinary encounter is mastered."""

import json
from pathlib import Path
from typing import Any

import pytest

from plannerforge.engine.commonroad.document import schema_errors
from plannerforge.engine.exploration.concrete import concrete_edits
from plannerforge.engine.exploration.evaluation import Evaluator
from plannerforge.engine.exploration.logical import (
    catalogue,
    logical_scenario,
    logical_scenario_in,
    pre_crash_type,
    pre_crash_types,
)
from plannerforge.engine.exploration.roads import ROADS, write_road
from plannerforge.engine.tuning.configurations import preset_configuration
from plannerforge.schemas.errors import InvalidRequest, NotPossible, UnknownName
from plannerforge.schemas.exploration import Distribution, EncounterSetting, Parameter


@pytest.fixture(scope="module")
def roads(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("roads")
    return {name: write_road(name, folder / f"{name}.xml") for name in ROADS}


def test_roads_follow_commonroads_schema(roads: dict[str, Path]) -> None:
    assert {name: schema_errors(path) for name, path in roads.items()} == {name: [] for name in ROADS}


def test_a_road_has_the_same_bytes_each_time(roads: dict[str, Path], tmp_path: Path) -> None:
    assert write_road("merge", tmp_path / "again.xml").read_bytes() == roads["merge"].read_bytes()


@pytest.mark.parametrize("name", catalogue())
def test_the_ordinary_encounter_is_plausible_and_mastered(name: str, roads: dict[str, Path]) -> None:
    logical = catalogue()[name]
    setting = EncounterSetting(
        xml=roads[logical.base],
        configuration=preset_configuration("idm"),
        traffic=logical.traffic,
        horizon_s=logical.horizon_s,
    )
    with Evaluator(setting) as evaluator:
        evaluation = evaluator.evaluate(concrete_edits(logical, {}))
    assert evaluation.outcome == "safe", evaluation.reason
    meets = any(edit["op"] in ("add_vehicle", "wrong_way", "close_lane") for edit in logical.edits)
    assert (evaluation.counterpart_id is not None) is meets
    assert all(one.low <= one.base_value <= one.high for one in logical.parameters)
    assert logical.source


def test_a_name_is_found_however_it_is_written() -> None:
    assert logical_scenario("Cut-in").name == "cut_in"
    with pytest.raises(UnknownName) as refusal:
        logical_scenario("cut_inn")
    assert "cut_in" in refusal.value.valid


def test_the_typology_is_whole_and_says_what_covers_each_type() -> None:
    types = pre_crash_types()
    assert [one.number for one in types] == list(range(1, 38))
    assert sum(one.crashes for one in types) == pytest.approx(5_942_000, abs=37 * 500)
    assert all(one.percent == pytest.approx(one.crashes / 59_420, abs=0.0101) for one in types)
    assert all(bool(one.scenarios) != bool(one.reason) for one in types)
    assert {name for one in types for name in one.scenarios} <= set(catalogue())


def test_a_type_of_the_typology_names_its_usual_logical_scenario() -> None:
    assert logical_scenario("nhtsa:26").name == "stopped_lead"
    assert logical_scenario(" NHTSA: 18").name == "cut_in"
    assert pre_crash_type("cut_in") is None
    with pytest.raises(NotPossible) as refusal:
        logical_scenario("nhtsa:9")
    assert refusal.value.valid[0] == "nhtsa:2"
    for number in ("0", "38", "x", ""):
        with pytest.raises(UnknownName):
            logical_scenario(f"nhtsa:{number}")


@pytest.mark.parametrize(
    ("given", "middle"),
    [
        ({"kind": "uniform"}, 0.5),
        ({"kind": "normal", "mean": 2.0, "variance": 0.25}, 0.5),
        ({"kind": "histogram", "bins": [(1.0, 1.0, 3.0), (3.0, 3.0, 1.0)]}, 0.75),
        ({"kind": "histogram", "bins": [(0.0, 1.5, 5.0), (1.5, 2.5, 1.0), (2.5, 9.0, 13.0)]}, 0.59),
    ],
)
def test_shares_of_values_count_only_the_range(given: dict[str, Any], middle: float) -> None:
    one = Parameter(name="gap_s", low=1.0, high=3.0, distribution=Distribution.model_validate(given))
    assert (one.share_below(0.0), one.share_below(1.0)) == (0.0, 1.0)
    assert one.share_below(0.5) == pytest.approx(middle, abs=0.01)


@pytest.mark.parametrize(
    "given",
    [
        {"kind": "normal", "mean": 1.0},
        {"kind": "lognormal", "mean": -1.0, "variance": 1.0},
        {"kind": "histogram"},
        {"kind": "histogram", "bins": [[2, 1, 1]]},
        {"kind": "cauchy"},
    ],
)
def test_a_distribution_that_lacks_figures_is_refused(given: dict[str, Any], tmp_path: Path) -> None:
    entry = {"name": "a", "summary": "", "base": "three_lanes", "edits": [{"op": "mirror"}]}
    entry["parameters"] = [{"name": "x", "low": 0, "high": 1, "distribution": given}]
    (tmp_path / "own.yaml").write_text(json.dumps([entry]), encoding="utf-8")
    with pytest.raises(InvalidRequest, match="distribution"):
        logical_scenario_in(tmp_path / "own.yaml")


def test_a_file_of_ones_own_has_the_same_form(tmp_path: Path) -> None:
    path = tmp_path / "own.yaml"
    path.write_text(
        "- name: slow\n  summary: a slow lead\n  base: three_lanes\n  parameters:\n"
        "    - {name: gap_s, low: 1, high: 2}\n  edits:\n"
        "    - {op: add_vehicle, vehicle_class: car, at: ego, gap_s: $gap_s}\n",
        encoding="utf-8",
    )
    assert logical_scenario_in(path).parameters[0].base_value == 1.5
    with pytest.raises(UnknownName):
        logical_scenario_in(path, "fast")
    path.write_text("- name: slow\n", encoding="utf-8")
    with pytest.raises(InvalidRequest, match="entry 0"):
        logical_scenario_in(path)
