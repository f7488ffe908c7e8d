"""The comparison with Scenario Factory: rates and shares, the judge of files, the other environment."""

import json
import math
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from support.builders import Problem, Vehicle, town_road

from benchmarks.harness import LeftOut, Spent
from benchmarks.maps.factory import OURS, THEIRS, Factory, MapTask, Produced, figures, prepared_environment
from benchmarks.maps.factory_judge import FileVerdict, judge_file

GOOD, LATE = FileVerdict("", "goal_reached"), FileVerdict("no run: goal_unreachable", "invalid")


def task(length_s: int, folder: Path = Path()) -> MapTask:
    return MapTask(Path("town.osm"), "DEU", "Town", 0.5, length_s, folder)


def produced(maker: str, length_s: int, count: int, processor_s: float, wall_s: float = 60.0) -> Produced:
    names = (f"DEU_Town-{number // 2 + 1}_1_T-{number}.cr.xml" for number in range(count))
    return Produced(task(length_s), maker, tuple(map(Path, names)), sites=5, spent=Spent(wall_s, processor_s))


def test_rates_count_executable_scenarios_by_the_time_of_the_processor() -> None:
    found = figures(
        [
            (produced(OURS, 20, 6, 30.0), [GOOD, GOOD]),
            (produced(THEIRS, 20, 8, 60.0), [GOOD, LATE]),
            (produced(OURS, 5, 6, 60.0), [GOOD]),
            (produced(THEIRS, 5, 8, 60.0, wall_s=30.0), [GOOD]),
        ]
    )
    assert (found["factory_ours_20s_per_min"], found["factory_theirs_20s_per_min"]) == (12.0, 4.0)
    assert (found["factory_ratio"], found["factory_ratio_clock"], found["factory_ratio_5s"]) == (3.0, 1.5, 0.75)
    assert (found["factory_ours_20s_executable"], found["factory_theirs_20s_executable"]) == (1.0, 0.5)


def test_scenarios_on_one_network_are_one_place() -> None:
    found = figures([(produced(THEIRS, 20, 8, 60.0), [GOOD]), (produced(OURS, 20, 8, 60.0), [GOOD])])
    assert (found["factory_theirs_20s_places"], found["factory_ours_20s_places"]) == (4, 8)
    assert (found["factory_ratio"], found["factory_ratio_places"]) == (1.0, 2.0)


def test_a_map_without_scenarios_costs_its_time_and_is_counted() -> None:
    empty = replace(produced(THEIRS, 20, 0, 60.0), sites=0)
    found = figures([(produced(THEIRS, 20, 8, 60.0), [GOOD]), (empty, [])])
    assert (found["factory_theirs_20s_per_min"], found["factory_theirs_20s_empty_maps"]) == (4.0, 1)
    assert found["factory_theirs_sites_km2"] == 5.0
    assert found["factory_ratio"] == 0.0


def test_a_rate_over_nothing_is_infinite() -> None:
    assert figures([(produced(OURS, 20, 6, 30.0), [GOOD])])["factory_ratio"] == math.inf


def test_a_sound_file_is_executable(tmp_path: Path) -> None:
    problem = Problem(goal=(62.0, 0.0, 8.0, 3.0), steps=(15, 30))
    path = replace(town_road().cut(31), problems=(problem,)).write(tmp_path / "a.xml")
    verdict = judge_file(path, 1)
    assert (verdict.fault, verdict.outcome, verdict.executable) == ("", "goal_reached", True)


def test_an_ego_inside_another_vehicle_is_a_fault(tmp_path: Path) -> None:
    other = Vehicle(7, tuple((42.0 + step, 0.0, 0.0, 10.0) for step in range(30)))
    path = town_road().with_vehicles(other).write(tmp_path / "a.xml")
    assert judge_file(path, 1).fault == "the ego begins in a collision"


def test_a_goal_that_no_lanelet_leads_to_is_a_fault(tmp_path: Path) -> None:
    road = town_road().cut(31)
    alone = tuple(replace(lane, left=None, right=None, successors=(), predecessors=()) for lane in road.lanes)
    beside = Problem(goal=(150.0, 3.5, 8.0, 1.0), steps=(5, 15))
    path = replace(road, lanes=alone, problems=(beside,)).write(tmp_path / "a.xml")
    assert judge_file(path, 1).fault == "no way from the start to the goal"


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("<length>", "<size>", "commonroad-io does not read it"),
        ("</time>", "</time><size/>", "breaks CommonRoad's schema"),
    ],
)
def test_a_broken_file_is_a_fault_with_its_reason(tmp_path: Path, old: str, new: str, fault: str) -> None:
    path = replace(town_road().cut(31), problems=(Problem(steps=(5, 15)),)).write(tmp_path / "a.xml")
    path.write_text(path.read_text(encoding="utf-8").replace(old, new, 1), encoding="utf-8")
    verdict = judge_file(path, 1)
    assert verdict.fault.startswith(fault)
    assert not verdict.executable


def test_an_environment_that_cannot_be_created_is_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("PLANNERFORGE_FACTORY", str(tmp_path / "file" / "environment"))
    with pytest.raises(LeftOut, match="cannot be created here: "):
        prepared_environment()


def stand_in(folder: Path, script: str) -> Path:
    """An environment whose Python runs a script instead of the driver."""
    (folder / "bin").mkdir(parents=True)
    (folder / "driver.py").write_text(script)
    python = folder / "bin" / "python"
    python.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{folder / "driver.py"}"\n')
    python.chmod(0o755)
    return folder


def test_the_driver_s_answer_comes_back_as_figures(tmp_path: Path) -> None:
    answer = {"processor_s": 2.0, "wall_s": 3.0, "sites": 4, "faults": {"convert: ValueError": 2}}
    script = f"""
import json, pathlib, sys
for line in sys.stdin:
    asked = json.loads(line)
    assert (asked["steps"], asked["simulated_steps"]) == (200, 1000)
    (pathlib.Path(asked["folder"]) / "DEU_Town-1_1_T-1.cr.xml").touch()
    print({json.dumps(answer)!r}, flush=True)
"""
    environment = stand_in(tmp_path / "environment", script)
    with (tmp_path / "log").open("w") as log, Factory(environment, log) as factory:
        made = factory.make(task(20, tmp_path / "a"))
    assert (made.spent, made.sites, made.faults) == (Spent(3.0, 2.0), 4, {"convert: ValueError": 2})
    assert [path.name for path in made.files] == ["DEU_Town-1_1_T-1.cr.xml"]


def test_a_driver_that_dies_is_a_fault_and_the_next_map_begins_again(tmp_path: Path) -> None:
    environment = stand_in(tmp_path / "environment", "import sys; sys.stdin.readline(); sys.exit(3)")
    with (tmp_path / "log").open("w") as log, Factory(environment, log) as factory:
        for name in ("a", "b"):
            made = factory.make(task(20, tmp_path / name))
            assert (dict(made.faults), made.files) == ({"its process ended with 3": 1}, ())
