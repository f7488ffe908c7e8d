"""The bench on fresh maps: a crash counts as a crash, a refusal as a refusal, a lost site as a failure."""

import json
import random
from collections.abc import Callable
from pathlib import Path

import pytest
from support.generation_bench import map_facts

from benchmarks.generation import fresh
from benchmarks.generation.figures import DEFECT, Made
from benchmarks.generation.fresh import FreshMap, drawn_request, print_fresh, try_map
from benchmarks.symmetries.fresh_data import mutated_map
from plannerforge.schemas.errors import UnsafeInput

LOST = "2 sites lost when the road network is built: roundabout at 50.00001, -10.00000; 1 more"


def raising(error: Exception) -> Callable[..., None]:
    def operation(*_: object, **__: object) -> None:
        raise error

    return operation


def test_a_map_that_is_refused_by_name_is_not_a_crash(tmp_path: Path) -> None:
    path = tmp_path / "broken.osm"
    path.write_text("<osm><node", encoding="utf-8")
    found = try_map(path, 1)
    assert found.refusal
    assert not found.crash
    assert not found.made


def test_anything_else_that_reading_raises_is_a_crash(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fresh, "read_map", raising(ZeroDivisionError("of nodes")))
    found = try_map(tmp_path / "any.osm", 1)
    assert "ZeroDivisionError" in found.crash
    assert not found.refusal


@pytest.mark.parametrize(("error", "crashed"), [(UnsafeInput("too large"), False), (KeyError("way"), True)])
def test_whole_conversion_refuses_or_crashes(
    error: Exception, crashed: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fresh, "read_map", lambda *_: map_facts({}))
    monkeypatch.setattr(fresh, "read_map_file", raising(error))
    found = try_map(tmp_path / "any.osm", 1)
    assert bool(found.crash) is crashed
    assert bool(found.conversion) is not crashed
    assert not found.refusal


def test_a_defect_during_generation_is_a_crash_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    request = drawn_request(map_facts({"urban": 1}), random.Random(1))
    monkeypatch.setattr(fresh, "read_map", lambda *_: map_facts({"urban": 1}))
    monkeypatch.setattr(fresh, "read_map_file", raising(UnsafeInput("too large")))
    monkeypatch.setattr(fresh, "make_all", lambda *_: [Made(request, fault=f"{DEFECT}IndexError()")])
    assert "IndexError" in try_map(tmp_path / "any.osm", 1).crash


def test_requests_are_drawn_from_the_types_that_the_index_names() -> None:
    facts = map_facts({"ramp": 1, "urban": 3})
    drawn = [drawn_request(facts, random.Random(seed)).arguments for seed in range(60)]
    assert {arguments.scenario_type for arguments in drawn} == {"ramp", "urban"}
    assert {arguments.density for arguments in drawn} == {"low", "medium", "high"}
    assert not [one for one in drawn if one.scenario_type == "ramp" and "bicycle" in " ".join(one.vehicles)]
    assert drawn == [drawn_request(facts, random.Random(seed)).arguments for seed in range(60)]


def test_lost_sites_and_refusals_are_failures_and_maps_without_sites_are_not(
    capsys: pytest.CaptureFixture[str],
) -> None:
    request = drawn_request(map_facts({"roundabout": 1}), random.Random(1))
    good = Made(request, executable=True, outcome="off_road", road_type=None, vehicles=True)
    found = [
        FreshMap("lost", made=(Made(request, fault=f"NotPossible: {LOST}"),)),
        FreshMap("late", made=(Made(request, executable=True, notes=(f"skipped: {LOST}",)),)),
        FreshMap("good", made=(good,)),
        FreshMap("empty"),
        FreshMap("refused", refusal="cut in the middle"),
        FreshMap("broken", crash="KeyError(1)"),
    ]
    print_fresh([7, 8], found)
    figures = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert figures["seeds"] == "7 8"
    counted = {key: figures[f"fresh_{key}"] for key in ("maps", "map_crashes", "maps_refused", "without_site")}
    assert counted == {"maps": 6, "map_crashes": 1, "maps_refused": 1, "without_site": 1}
    assert (figures["fresh_scenarios"], figures["fresh_executable"]) == (3, 0.6667)
    assert (figures["fresh_lost_sites"], figures["fresh_off_road"]) == (4, 1)
    assert figures["fresh_road_type_judged"] == 1


@pytest.mark.usefixtures("shared_data")
def test_a_lane_of_zero_width_is_left_out(tmp_path: Path) -> None:
    """A lane for bicycles of this map: the scenario was written with it, and refused when it was read back."""
    path = mutated_map(2002, tmp_path, 30)
    assert [one.executable for one in try_map(path, 2002).made] == [True]
