"""An operational design domain: what is measured, what is inside, what is missing, and which files are read."""

from pathlib import Path
from typing import Any

import pytest

from plannerforge.engine.catalog import judge_odd, odd_values
from plannerforge.schemas.errors import InvalidRequest, NotPossible
from plannerforge.schemas.odd import OddCoverage, OddEntry, OddRequest
from plannerforge.schemas.scenarios import EgoFacts, LocationFacts, ParticipantFacts, RoadFacts, ScenarioFacts

TOWN = """
TAXONOMY:
  scenery:
    junction: [none, intersection, roundabout, ramp]
    speed_limit: float velocity
    tunnel: boolean
  environment:
    rain: [none, light_rain, heavy_rain]
  dynamic:
    traffic_density: [low, medium, high]
    truck: boolean
MODULES:
  town:
    INCLUDE_AND:
      speed_limit: "[0 .. 30] mph"
      junction: [intersection, roundabout]
    EXCLUDE_OR:
      rain: [heavy_rain]
      tunnel: true
"""


def facts(*features: str, limit_kmh: float | None = 50, circumstances: tuple[str, ...] = (), **counts: int) -> Any:
    ego = EgoFacts(
        problem_id=1,
        speed_mps=10,
        x_m=0,
        y_m=0,
        heading_rad=0,
        lanes=2,
        lanelets=(1,),
        goal_forms=(),
        goal_first_step=None,
        goal_last_step=None,
    )
    return ScenarioFacts(
        scenario_id="DEU_Town-1_1_T-1",
        format_version="2020a",
        step_s=0.1,
        horizon_steps=100,
        location=LocationFacts(country="DEU", place="Town"),
        tags=("urban",),
        features=features,
        roads=RoadFacts(lanelets=3, limits_ego_kmh=() if limit_kmh is None else (limit_kmh,)),
        participants=ParticipantFacts(dynamic={"car": 3, **counts}),
        egos=(ego,),
        density_per_km=8,
        circumstances=circumstances,
    )


def entry(*features: str, runs: int = 0, failed: int = 0, **given: Any) -> OddEntry:
    return OddEntry(scenario_id="X", values=odd_values(facts(*features, **given)), runs=runs, failed=failed)


def judged(folder: Path, *entries: OddEntry, text: str = TOWN, **files: str) -> OddCoverage:
    for name, content in files.items():
        (folder / f"{name}.yaml").write_text(content, encoding="utf-8")
    path = folder / "town.yaml"
    path.write_text(text, encoding="utf-8")
    return judge_odd(OddRequest(path=path, entries=entries), lambda *_: None)


def level(coverage: OddCoverage, concept: str, name: str) -> tuple[bool, int, int, int]:
    found = next(one for one in coverage.concepts if one.name == concept)
    one = next(one for one in found.levels if one.level == name)
    return one.is_inside, one.scenarios, one.runs, one.failed


def test_scenarios_and_runs_are_inside_or_outside(tmp_path: Path) -> None:
    inside = entry("intersection", limit_kmh=48, runs=3, failed=1)
    too_fast, ramp, wet = entry("roundabout"), entry("ramp", runs=2), entry("roundabout", circumstances=("heavy_rain",))
    covered = judged(tmp_path, inside, too_fast, ramp, wet)
    assert (covered.inside.scenarios, covered.inside.runs, covered.inside.failed) == (1, 3, 1)
    assert (covered.outside.scenarios, covered.outside.runs) == (3, 2)
    assert level(covered, "scenery.junction", "intersection") == (True, 1, 3, 1)
    assert level(covered, "scenery.junction", "ramp") == (False, 1, 2, 0)
    assert level(covered, "environment.rain", "none") == (True, 1, 3, 1)
    assert covered.not_measured == ("scenery.tunnel",)


def test_a_value_that_is_not_stated_does_not_put_a_scenario_outside(tmp_path: Path) -> None:
    covered = judged(tmp_path, entry("intersection", limit_kmh=None), text=TOWN.replace("      tunnel: true\n", ""))
    assert (covered.inside.scenarios, covered.assumed) == (1, 1)


def test_what_is_missing_comes_with_the_calls_that_fill_it(tmp_path: Path) -> None:
    covered = judged(tmp_path, entry("intersection", limit_kmh=30, truck=1))
    assert {"scenario_type roundabout", "density medium", "vehicles cars", "weather light_rain"} <= set(covered.missing)
    assert not any("ramp" in one or "heavy_rain" in one for one in covered.missing)
    assert covered.calls == (
        {"cover": ["scenario_type=intersection|roundabout", "density=low|medium|high", "vehicles=cars|truck"]},
        {"conditions": ["weather=light_rain"]},
    )
    assert (covered.pairs, covered.covered_pairs) == (16, 3)


def test_a_catalogue_that_covers_everything_needs_no_call(tmp_path: Path) -> None:
    text = "TAXONOMY: {junction: [roundabout, ramp]}\nMODULES: {m: {INCLUDE_AND: {junction: [roundabout]}}}\n"
    covered = judged(tmp_path, entry("roundabout"), text=text)
    assert covered.missing == ()
    assert covered.calls == ()


def test_a_binding_file_says_how_other_names_are_measured(tmp_path: Path) -> None:
    document = 'TAXONOMY: {posted: float velocity}\nMODULES: {m: {INCLUDE_AND: {posted: "[0 .. 50] km/h"}}}\n'
    binding = "openodd: [document.yaml]\nprobes: {posted: {probe: speed_limit, buckets: [0, 60, 90]}}\n"
    covered = judged(tmp_path, entry(limit_kmh=50), entry(limit_kmh=80), text=binding, document=document)
    assert level(covered, "posted", "[0, 60)")[:2] == (True, 1)
    assert level(covered, "posted", "[60, 90]")[:2] == (False, 1)


@pytest.mark.parametrize(
    "text",
    [
        "IMPORT: [../elsewhere.yaml]\nMODULES: {}\n",
        "IMPORT: [/etc/hostname]\nMODULES: {}\n",
        "openodd: [{git: https://example.com/odd.git, rev: main, path: odd.yaml}]\n",
        "openodd: [missing.yaml]\n",
        "TAXONOMY: {junction: [a]}\nMODULES: {m: {INCLUDE: 3}}\n",
        "openodd: [other.yaml]\nprobes: {junction: {probe: 'os:getcwd'}}\n",
        "- a list\n",
        "{",
        "\0",
    ],
)
def test_files_from_elsewhere_and_files_that_are_no_odd_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "elsewhere.yaml").write_text(TOWN, encoding="utf-8")
    folder = tmp_path / "odds"
    folder.mkdir()
    with pytest.raises(InvalidRequest):
        judged(folder, text=text, other="TAXONOMY: {junction: [a, b]}\n")


def test_an_odd_without_a_measured_concept_is_refused_with_what_is_measured(tmp_path: Path) -> None:
    with pytest.raises(NotPossible) as refusal:
        judged(tmp_path, text="TAXONOMY: {humidity: float}\nMODULES: {m: {INCLUDE_AND: {humidity: '[0 .. 1]'}}}\n")
    assert "speed_limit" in refusal.value.valid
