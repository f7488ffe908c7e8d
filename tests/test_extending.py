"""How to extend PlannerForge: one of each kind of thing is added, in at most three places, and used.

What a test puts into a registry is what you write into the source; the function is written out in the test.

- a tool: its function (``tools/``), its arguments and result (``schemas/``), its entry in ``TOOLS``
  (``tools/registry.py``), its method of the Python door (``library/workspace.py``)
- an operation: its function on the face of a package of the engine, its line in ``workflows/operations.py``
- an edit: a function of its name (``engine/edits/trajectory.py`` or one of its siblings, where ``OPERATIONS``
  finds it), its line in ``EDITS`` and its name in ``EditOperation`` (``schemas/modification.py``)
- a planner: its class, its line in ``PLANNERS`` (``engine/planners/registry.py``), its ``PlannerTuning`` in
  ``TUNINGS`` (``engine/tuning/tunings.py``)
- a metric of a run: its definition in ``MEASURES``, its field in ``RunMetrics`` (``schemas/measures.py``), its figure
  (``engine/motion_figures.py``, or ``engine/criticality.py`` if it is about others)
- a finding: its function and its place in ``FINDINGS`` (``engine/analysis/findings.py``)
- a rule for road networks: a function under ``@rule`` in a module of ``engine/network/rules``
- a map source: its reader, its entry in ``MAP_FORMATS`` (``engine/maps/unpacking.py``), its line in ``MAP_READERS``
  (``engine/maps/map_file.py``)
- a chart: its kind in ``PictureKind`` and its place in ``REPORT_PICTURES`` (``schemas/rendering.py``), its function and
  its line in ``CHARTS`` (``engine/rendering/charts.py``)
"""

import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import worker_operations
from support.builders import driving, town_road
from support.planning import configuration, drive, goal_state, problem_for, rectangle_at, scenario_on, straight_road
from support.roads import good_road, write
from support.runs import record, source
from support.server import Connect

from plannerforge.engine import motion_figures
from plannerforge.engine.analysis import RunSet, findings, measures
from plannerforge.engine.commonroad import RoadDocument, read_scenario, recorded_tracks
from plannerforge.engine.edits import Changes, apply, apply_edits, report, trajectory
from plannerforge.engine.edits.changes import EditStep
from plannerforge.engine.execution import Operation, silent
from plannerforge.engine.maps import map_file, unpacking
from plannerforge.engine.maps.drawn_library import LIBRARY
from plannerforge.engine.maps.osm import OsmMap, read_osm
from plannerforge.engine.network.rules import check, topology
from plannerforge.engine.network.rules.rule import Defect, rule
from plannerforge.engine.planners import (
    PLANNERS,
    EgoState,
    Observation,
    Plan,
    PlannedTrajectory,
    PlanningTask,
    check_planner,
    make_planner,
    runs,
)
from plannerforge.engine.planners.lanes import build_road
from plannerforge.engine.planners.reference_path import build_reference_path
from plannerforge.engine.rendering import charts, pictures
from plannerforge.engine.rendering.canvas import Drawing, new_figure
from plannerforge.engine.scene import Scene
from plannerforge.engine.scene.routing import find_route
from plannerforge.engine.tuning import tunings
from plannerforge.engine.vehicles.models import BMW_320I
from plannerforge.schemas import measures as definitions
from plannerforge.schemas import modification
from plannerforge.schemas.base import Answer, Arguments, Result
from plannerforge.schemas.measures import RunMetrics
from plannerforge.schemas.modification import Edit, EditKind, EditReport, ModificationRequest
from plannerforge.schemas.rendering import Rendered, RenderRequest
from plannerforge.schemas.results import Finding
from plannerforge.schemas.runs import RunSource
from plannerforge.server import assembly
from plannerforge.tools import scenarios
from plannerforge.tools.call import ToolCall
from plannerforge.tools.registry import TOOLS, ToolSpec


class RepeatWordsArguments(Arguments):
    """Repeat words."""

    words: str


class RepeatWordsResult(Result):
    words: str

    def answer(self) -> Answer:
        return Answer(f"You said: {self.words}")


@pytest.fixture
def warm_workers() -> None:
    """Workers of the server's own: those that are kept between tests know no operations of tests."""


@pytest.mark.anyio
async def test_a_tool_has_a_worker_carry_out_an_operation(
    monkeypatch: pytest.MonkeyPatch, importable_tests: None, connect: Connect
) -> None:
    echo = Operation("support.worker_operations:echo", worker_operations.Words, worker_operations.Words, timeout_s=30.0)

    async def repeat_words(arguments: RepeatWordsArguments, call: ToolCall) -> RepeatWordsResult:
        response = await call.run(echo, worker_operations.Words(text=arguments.words))
        return RepeatWordsResult(words=response.text)

    monkeypatch.setattr(scenarios, "repeat_words", repeat_words, raising=False)
    monkeypatch.setattr(assembly, "TOOLS", (*TOOLS, ToolSpec("repeat_words", "Repeat words", "scenarios")))
    async with connect() as client:
        result = await client.call_tool("repeat_words", {"words": "hello"})
        assert result.structured_content == {"words": "hello"}
        refused = await client.call_tool("repeat_words", {})
        assert refused.is_error
        assert "words" in refused.content[0].text  # type: ignore[union-attr]


class AnyEdit(Edit):
    """In the source, ``EditOperation`` gets the name."""

    op: str  # type: ignore[assignment]


class AnyEditReport(EditReport):
    """As above."""

    op: str  # type: ignore[assignment]


def test_an_edit_stops_a_vehicle(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def stop_vehicle(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
        return trajectory.set_speed(edit.model_copy(update={"speed": "0m/s"}), scene, changes)

    monkeypatch.setitem(apply.OPERATIONS, "stop_vehicle", stop_vehicle)
    monkeypatch.setitem(modification.EDITS, "stop_vehicle", EditKind("T", ("vehicles", "time_s")))
    monkeypatch.setattr(report, "EditReport", AnyEditReport)
    edit = AnyEdit(op="stop_vehicle", vehicles=["34"], time_s=2.0)
    base = town_road().with_vehicles(driving(34, (280, 7), 10.0, 101, heading_rad=np.pi)).write(tmp_path / "base.xml")
    request = ModificationRequest(xml=base, edits=(edit,), benchmark_id="ZAM_Builder-1_1_T-2", output=tmp_path / "out")
    outcome = apply_edits(request, silent)
    assert outcome.xml is not None
    speeds = recorded_tracks(read_scenario(outcome.xml).scenario)[34].speeds_mps
    assert speeds[20] == pytest.approx(10.0, abs=0.2)
    assert speeds[80] == pytest.approx(0.0, abs=0.1)


class KeepsItsSpeed:
    """Drives straight on along a straight reference path, at the speed that it has."""

    def reset(self, task: PlanningTask) -> None:
        self.task = task

    def plan(self, observation: Observation) -> Plan:
        ego, steps = (
            observation.ego,
            np.arange(round(self.task.configuration.settings.horizon_s / self.task.step_s) + 1),
        )
        ahead = ego.speed_mps * self.task.step_s * steps
        direction = np.array([np.cos(ego.heading_rad), np.sin(ego.heading_rad)])
        still, same = np.zeros(len(steps)), np.ones(len(steps))
        line = ego.position + ahead[:, None] * direction
        return Plan(PlannedTrajectory(line, ego.heading_rad * same, ego.speed_mps * same, still))


def test_a_planner_runs_in_the_loop_with_a_configuration(monkeypatch: pytest.MonkeyPatch) -> None:
    weight = tunings.Weight("patience", "how long it keeps its speed", "more patient", "ours")
    preset = tunings.Preset("Default", "Default", "keeps its speed", {"patience": 1.0})
    tuning = tunings.PlannerTuning("keeps its speed", {"patience": weight}, {}, {"Default": preset})
    monkeypatch.setitem(PLANNERS, "steady", KeepsItsSpeed)
    monkeypatch.setitem(tunings.TUNINGS, "steady", tuning)
    chosen = configuration("steady", "patience=2")
    assert chosen.weights == {"patience": 2.0}
    goal = goal_state((40, 60), rectangle_at(50.0, 0.0))
    scenario, problem, start = scenario_on(straight_road(200.0)), problem_for(goal), np.zeros(2)
    route = find_route(scenario.lanelet_network, problem.goal, start, 0.0, ahead_m=120.0)
    path = build_reference_path(scenario.lanelet_network, route, start, 10.0)
    road = build_road(scenario.lanelet_network, path)
    task = PlanningTask(scenario.lanelet_network, problem, chosen, path, road, BMW_320I, scenario.dt)
    observation = Observation(EgoState(0, start, 0.0, 10.0), ())
    assert check_planner(KeepsItsSpeed, task, observation) == ()
    run = drive(scenario, problem, chosen, planner=make_planner("steady"))
    assert run.verdict.outcome == "goal_reached"


class RunMetricsWithStrain(RunMetrics):
    strain: float | None = None


def test_a_metric_is_computed_once_for_runs_and_for_analysis(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def with_strain(*motion: Any) -> motion_figures.MotionFigures:
        found = motion_figures.motion_figures(*motion)
        return replace(found, series=(*found.series, motion_figures.MotionSeries("strain", np.array([1.0, 3.0, 2.0]))))

    for module in (runs, measures):
        monkeypatch.setattr(module, "motion_figures", with_strain)
    for module in (runs, definitions):
        monkeypatch.setattr(module, "RunMetrics", RunMetricsWithStrain)
    strain = definitions.Measure("strain", "strain", "1", "lower", "an example", "as it is", "", "0 to 3", "no motion")
    monkeypatch.setattr(measures, "MEASURES", (strain,))
    assert strain.stored
    problem = problem_for(goal_state((40, 60), rectangle_at(50.0, 0.0)))
    driven = drive(scenario_on(straight_road(200.0)), problem, configuration("idm"), planner=make_planner("idm"))
    stored = runs.metrics_of(driven, BMW_320I, 0.1)
    assert stored is not None
    assert stored.model_dump()["strain"] == 3.0
    (tmp_path / "steps.json").write_text(runs.run_steps(driven).model_dump_json(), encoding="utf-8")
    run = RunSource(record=record(figures=stored), steps_path=str(tmp_path / "steps.json"))
    (told,) = measures.measures_of(RunSet((run,), ()), run.record)
    assert (told.value, told.time_s) == (3.0, 0.2)


def test_a_finding_is_stated(monkeypatch: pytest.MonkeyPatch) -> None:
    def all_runs_are_of_one_planner(evidence: findings.Evidence) -> list[Finding]:
        ids = tuple(run.run_id for run in evidence.runs.valid)
        return [Finding(name="all_runs_are_of_one_planner", statement="One planner drove.", run_ids=ids)]

    monkeypatch.setattr(findings, "FINDINGS", (*findings.FINDINGS, all_runs_are_of_one_planner))
    assert "One planner drove." in [finding.statement for finding in findings.find_all(RunSet((source(record()),), ()))]


def test_a_rule_for_road_networks_is_reported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    @rule("warning", why="It is an example.")
    def first_lanelet(document: RoadDocument) -> Iterator[Defect]:
        """A network has lanelets."""
        yield Defect("is a lanelet", (1,))

    monkeypatch.setattr(topology, "first_lanelet", first_lanelet, raising=False)
    assert [finding.rule for finding in check.check_file(write(good_road(), tmp_path)).findings] == ["first_lanelet"]


def test_a_map_source_is_read(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def read_town(path: Path) -> OsmMap:
        return read_osm(LIBRARY / path.read_text())

    monkeypatch.setattr(unpacking, "MAP_FORMATS", (*unpacking.MAP_FORMATS, unpacking.MapFormat(".town", (".town",))))
    monkeypatch.setitem(map_file.MAP_READERS, ".town", read_town)
    path = tmp_path / "my.town"
    path.write_text("landmoor.osm")
    assert map_file.read_map_file(path) == read_osm(LIBRARY / "landmoor.osm")
    kept = Path(shutil.copy(path, tmp_path / unpacking.stored_name(path)))
    assert map_file.read_map_file(kept) == read_osm(LIBRARY / "landmoor.osm")
    assert unpacking.stored_name(path) == "map.town"
    copy = Path(shutil.copy(LIBRARY / "landmoor.osm", tmp_path / "other.osm"))
    assert map_file.read_map_file(copy) == read_osm(LIBRARY / "landmoor.osm")


class RenderedOfAnyKind(Rendered):
    """In the source, ``PictureKind`` gets the name."""

    kind: str  # type: ignore[assignment]


def test_a_chart_is_drawn(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def draw_count(runs: RunSet) -> Drawing:
        figure = new_figure(1000, 200)
        figure.text(0.5, 0.5, f"{len(runs.records)} runs")
        return Drawing(figure, f"{len(runs.records)} runs.")

    monkeypatch.setitem(charts.CHARTS, "count", draw_count)
    monkeypatch.setattr(pictures, "Rendered", RenderedOfAnyKind)
    request = RenderRequest(kind="outcomes", folder=str(tmp_path), runs=(source(record()),))
    image = pictures.render(request.model_copy(update={"kind": "count"}), silent).images[0]
    assert image.alt_text == "1 runs."
    assert Path(image.path).name == "count.png"
