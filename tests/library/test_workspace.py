"""The Python door on real workers: own planners drive in the caller's thread, and all work of tools is reachable."""

import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from support.builders import town_road
from support.server import KeptWorkers

from plannerforge.engine.execution import WorkerPool
from plannerforge.engine.planners import Observation, Plan, PlannedTrajectory, PlanningTask
from plannerforge.library import Workspace
from plannerforge.schemas.errors import InvalidRequest, NotPossible, UnknownName
from plannerforge.schemas.worlds import World
from plannerforge.tools.registry import TOOLS

METHODS = {
    "describe_catalog": "catalog",
    "generate_scenarios": "generate",
    "find_scenarios": "find",
    "import_files": "import_files",
    "describe_scenario": "describe",
    "modify_scenario": "edit",
    "list_planners": "planners",
    "configure_planner": "configure",
    "run_planner": "run",
    "get_job": "job",
    "cancel_job": "cancel_job",
    "analyze_results": "analyse",
    "compare_results": "compare",
    "find_failures": "find_failures",
    "optimize_planner": "optimise",
    "explore_boundary": "explore_boundary",
    "render": "render",
    "list_artifacts": "artifacts",
    "export_artifacts": "export",
}


class Straight:
    """Goes straight on at its speed."""

    def __init__(self, share: float = 1.0) -> None:
        self.share, self.threads = share, set[int]()

    def reset(self, task: PlanningTask) -> None:
        self.step_s = task.step_s

    def plan(self, observation: Observation) -> Plan:
        self.threads.add(threading.get_ident())
        ego = observation.ego
        times = np.arange(21) * self.step_s
        direction = np.array([np.cos(ego.heading_rad), np.sin(ego.heading_rad)])
        positions = ego.position + np.outer(times * ego.speed_mps, direction)
        same = np.ones(21)
        return Plan(PlannedTrajectory(positions, ego.heading_rad * same, ego.speed_mps * same, 0.0 * same))


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory, kept_workers: KeptWorkers) -> Iterator[Workspace]:
    folder = tmp_path_factory.mktemp("door")
    town_road().write(folder / "town.xml")
    options = {"roots": (folder,), "workers": 1, "starter": False, "warm_up": False}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(WorkerPool, "open", kept_workers.lent)
        with Workspace(folder / "workspace", **options) as opened:
            opened.import_files(folder / "town.xml", kind="scenario")
            yield opened


def scenario_of(workspace: Workspace) -> str:
    return workspace.artifacts(kind="scenario").artifacts[0].artifact_id


def test_every_tool_has_a_method_of_the_workspace() -> None:
    assert set(METHODS) == {spec.name for spec in TOOLS}
    assert all(callable(getattr(Workspace, method)) for method in METHODS.values())


def test_an_own_planner_drives_in_the_thread_of_its_caller(workspace: Workspace) -> None:
    planner = Straight()
    runs = workspace.run(scenario_of(workspace), planner)
    assert planner.threads == {threading.get_ident()}
    assert runs[0].record.planner == "straight"
    assert list(runs.to_pandas()["run_id"]) == [runs[0].run_id]
    assert len(runs[0].to_pandas()) == len(runs[0].steps.x_m)


def test_the_same_planner_again_is_the_stored_run_and_another_state_is_not(workspace: Workspace) -> None:
    planner = Straight(0.5)
    first = workspace.run(scenario_of(workspace), planner)
    again = workspace.run(scenario_of(workspace), planner)
    other = workspace.run(scenario_of(workspace), Straight(0.7))
    assert first[0].run_id == again[0].run_id
    assert first[0].run_id != other[0].run_id


def test_several_runs_are_a_batch_that_can_be_analysed_and_compared(workspace: Workspace) -> None:
    scenario = scenario_of(workspace)
    runs = workspace.run(scenario, ["idm:Default", Straight])
    assert [run.record.planner for run in runs] == ["idm", "straight"]
    assert workspace.analyse(runs).runs == 2
    assert len(workspace.compare(runs).sides) == 2


def test_objects_of_one_class_are_distinguished_by_the_callers_names(workspace: Workspace) -> None:
    one, two = Straight(0.1), Straight(0.2)
    runs = workspace.run(scenario_of(workspace), {"gentle": one, "brisk": two})
    assert [run.record.planner for run in runs] == ["gentle", "brisk"]
    assert one.threads == two.threads == {threading.get_ident()}
    with pytest.raises(InvalidRequest):
        workspace.run(scenario_of(workspace), [one, two])


class Interrupted(Straight):
    """Is interrupted once, as by Ctrl-C."""

    def plan(self, observation: Observation) -> Plan:
        if not self.threads:
            self.threads.add(0)
            raise KeyboardInterrupt
        return super().plan(observation)


def test_an_interrupted_batch_ends_and_the_same_call_continues_it(workspace: Workspace) -> None:
    planners = ["idm:Default", Interrupted()]
    with pytest.raises(KeyboardInterrupt):
        workspace.run(scenario_of(workspace), planners)
    runs = workspace.run(scenario_of(workspace), planners)
    assert [run.record.planner for run in runs] == ["idm", "interrupted"]


def test_a_closed_workspace_says_so(tmp_path: Path) -> None:
    with Workspace(tmp_path / "closed", workers=1, starter=False, warm_up=False) as closed:
        closed.artifacts()
    with pytest.raises(NotPossible):
        closed.artifacts()


def test_a_program_that_closes_no_workspace_ends(tmp_path: Path) -> None:
    opened = f"pf.Workspace({str(tmp_path / 'open')!r}, workers=1, starter=False)"
    program = f"import plannerforge as pf; workspace = {opened}; workspace.artifacts()"
    assert subprocess.run([sys.executable, "-c", program], timeout=60, check=False).returncode == 0


def test_a_workspace_that_is_closed_leaves_the_planners_of_another(workspace: Workspace, tmp_path: Path) -> None:
    planner = Straight(0.9)
    workspace.run(scenario_of(workspace), planner)
    with Workspace(tmp_path / "other", workers=1, starter=False, warm_up=False) as other:
        assert "straight" in [one.name for one in other.planners().planners]
    assert workspace.run(scenario_of(workspace), planner)[0].record.planner == "straight"


def test_a_run_is_driven_on_from_a_moment_by_another_planner(workspace: Workspace) -> None:
    run = workspace.run(scenario_of(workspace), Straight())[0]
    before = run.to_pandas()
    other = Straight(0.3)
    drive = run.at(0.5).resume(other)
    assert other.threads == {threading.get_ident()}
    assert drive.to_pandas().index[0] == before.index[5]
    assert drive.to_pandas().iloc[0]["x_m"] == before.iloc[5]["x_m"]
    assert run.at(0.5).resume("idm:Default").record.planner == "idm"
    with pytest.raises(InvalidRequest):
        run.at(1e6).resume(other)


def test_invalid_planners_and_unknown_names_are_refused(workspace: Workspace) -> None:
    with pytest.raises(InvalidRequest):
        workspace.run(scenario_of(workspace), 3)  # type: ignore[arg-type]
    with pytest.raises(UnknownName):
        workspace.describe("no_such_scenario")
    with pytest.raises(InvalidRequest):
        workspace.describe(scenario_of(workspace), detial="full")


def test_a_planner_that_fails_raises_and_the_workspace_stays_usable(workspace: Workspace) -> None:
    class Broken(Straight):
        """Has no plan."""

        def plan(self, observation: Observation) -> Plan:
            raise RuntimeError("no idea")

    with pytest.raises(Exception, match="no idea"):
        workspace.run(scenario_of(workspace), Broken())
    assert workspace.artifacts(kind="scenario").artifacts


def test_lost_runs_of_a_batch_are_warned_of_and_the_others_stay(workspace: Workspace) -> None:
    class Often(Straight):
        """Has a plan if it is whole."""

        def plan(self, observation: Observation) -> Plan:
            if self.share < 1.0:
                raise RuntimeError("no idea")
            return super().plan(observation)

    with pytest.warns(UserWarning, match="1 of 2 runs"):
        runs = workspace.run(scenario_of(workspace), {"whole": Often(), "half": Often(0.5)})
    assert runs.to_pandas()["config_name"].tolist() == ["whole:Default"]


def test_importing_the_package_loads_only_the_standard_library() -> None:
    program = "import sys; before = set(sys.modules); import plannerforge; print(*sorted(set(sys.modules) - before))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=Path.home())
    loaded = {name.partition(".")[0] for name in done.stdout.split()}
    assert loaded <= {"plannerforge", *sys.stdlib_module_names}


def test_a_world_is_given_as_text_or_as_an_object(workspace: Workspace) -> None:
    scenario = scenario_of(workspace)
    by_text = workspace.run(scenario, Straight(), world="occlusion, seed=2")
    by_object = workspace.run(scenario, Straight(), world=World(visible=0.2, seed=2))
    assert by_text.result_ids == by_object.result_ids
    assert by_object[0].record.world == World(visible=0.2, seed=2)
