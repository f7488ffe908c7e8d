"""Searches for failures on a drawn road, with a planner that never brakes: found, resumed, refused and reduced."""

from collections.abc import AsyncIterator, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import anyio
import pytest
from support.artifacts import store_scenario
from support.builders import driving, town_road

from benchmarks.harness import call_in_process
from plannerforge.engine.execution.jobs import JobRunner, JobStore
from plannerforge.engine.workspace import Workspace
from plannerforge.schemas.errors import InvalidRequest, NotPossible
from plannerforge.schemas.failures import EvaluatedPoint, FailureSearchRecord, FindFailuresArguments, FindFailuresResult
from plannerforge.schemas.modification import Edit
from plannerforge.workflows import failures
from plannerforge.workflows.context import WorkflowContext

BASE = "ZAM_Town-1_1_T-1"
RUNS = 20
QUIET = town_road().with_vehicles(driving(34, (280, 7), 11.0, 81, heading_rad=3.14159))


class Stopped(Exception):
    """Someone stopped the search."""


def workspace_with(folder: Path, builder: Any = QUIET) -> Workspace:
    workspace = Workspace(folder / "workspace")
    store_scenario(workspace, BASE, builder.write(folder / "town.xml"))
    return workspace


def progress(stop_after: int | None = None) -> Any:
    told: list[str] = []

    def report(share: float, message: str = "") -> None:
        assert 0.0 <= share <= 1.0
        told.append(message)
        if stop_after is not None and len(told) >= stop_after:
            raise Stopped

    return SimpleNamespace(report=report, add_result=lambda _: None, told=told)


class Stored(list[Sequence[Edit]]):
    """The edits that searches store; ids stand for scenarios and runs, which other tests cover."""

    async def store(self, edits: Sequence[Edit]) -> tuple[str, str]:
        self.append(edits)
        return f"scenario{len(self)}", f"run{len(self)}"


@pytest.fixture(scope="module")
def stored() -> Iterator[Stored]:
    made = Stored()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(failures._Search, "store", lambda _, edits: made.store(edits))
        yield made


async def searched(workspace: Workspace, told: Any, **given: Any) -> tuple[FailureSearchRecord, list[EvaluatedPoint]]:
    arguments = FindFailuresArguments.model_validate(
        {"scenario_id": BASE, "config": "keep_lane", "runs": RUNS, **given}
    )
    search = failures._search(arguments, call_in_process(workspace))
    return await search.run(told), search.points


@dataclass(frozen=True)
class Searched:
    workspace: Workspace
    record: FailureSearchRecord
    points: Sequence[EvaluatedPoint]


@pytest.fixture(scope="module")
async def whole(
    anyio_backend: str, tmp_path_factory: pytest.TempPathFactory, stored: Stored
) -> AsyncIterator[Searched]:
    """A search that nothing interrupted; its workspace keeps the points."""
    workspace = workspace_with(tmp_path_factory.mktemp("whole"))
    record, points = await searched(workspace, progress())
    yield Searched(workspace, record, points)
    workspace.close()


@pytest.mark.anyio
async def test_failures_that_a_careful_driver_avoids_are_found_with_their_edits(
    whole: Searched, stored: Stored
) -> None:
    record = whole.record
    assert record.runs == RUNS
    assert record.failures
    assert len({failure.cell for failure in record.failures}) == len(record.failures)
    for failure in record.failures:
        assert failure.prevented_by
        assert 1 <= failure.found_after <= RUNS
        assert failure.edits in stored
    assert sum(point.score.cell is not None for point in whole.points) == sum(one.hits for one in record.failures)


@pytest.mark.anyio
async def test_an_interrupted_search_goes_on_and_ends_as_one_that_was_not(
    tmp_path: Path, whole: Searched, monkeypatch: pytest.MonkeyPatch
) -> None:
    stopped = workspace_with(tmp_path)
    with pytest.raises(Stopped):
        await searched(stopped, progress(stop_after=3))
    asked = []
    run = failures._Search.evaluate_batch

    async def batch(self: Any, space: Any) -> None:
        asked.append(len(self.points))
        await run(self, space)

    monkeypatch.setattr(failures._Search, "evaluate_batch", batch)
    record, points = await searched(stopped, progress())
    assert asked[0] == 12
    assert points == whole.points
    assert [one.edits for one in record.failures] == [one.edits for one in whole.record.failures]
    assert record.runs == whole.record.runs
    stopped.close()


@pytest.mark.anyio
async def test_a_smaller_budget_has_the_first_part_of_a_larger_one(whole: Searched) -> None:
    less, again = await searched(whole.workspace, progress(), runs=8)
    assert again == whole.points
    assert less.runs == 8
    found = [one.cell for one in whole.record.failures]
    assert [one.cell for one in less.failures] == found[: len(less.failures)]


@pytest.mark.anyio
async def test_a_search_until_the_first_failure_ends_with_it_and_reduces_it(whole: Searched) -> None:
    first, _ = await searched(whole.workspace, progress(), until_first=True, shrink=True)
    (failure,) = first.failures
    assert first.runs == failure.found_after == whole.record.failures[0].found_after
    assert failure.shrunk is not None
    assert failure.shrunk.road_users <= failure.shrunk.road_users_before
    assert failure.shrunk.runs <= 40


@pytest.mark.anyio
@pytest.mark.parametrize("lines", [0, 2])
async def test_a_search_goes_on_from_the_last_whole_line_of_a_damaged_file(whole: Searched, lines: int) -> None:
    (kept,) = (whole.workspace.root / "explored").glob("*.jsonl")
    before = kept.read_text(encoding="utf-8").splitlines(keepends=True)
    kept.write_text("".join(before[:lines]) + before[lines][:30], encoding="utf-8")
    record, points = await searched(whole.workspace, progress())
    assert points == whole.points
    assert [one.edits for one in record.failures] == [one.edits for one in whole.record.failures]
    assert kept.read_text(encoding="utf-8").splitlines(keepends=True) == before


@pytest.mark.anyio
async def test_a_batch_that_two_searches_appended_counts_once(whole: Searched) -> None:
    (kept,) = (whole.workspace.root / "explored").glob("*.jsonl")
    before = kept.read_text(encoding="utf-8").splitlines(keepends=True)
    kept.write_text("".join([*before[:3], before[2], *before[3:]]), encoding="utf-8")
    _, points = await searched(whole.workspace, progress())
    assert points == whole.points


@pytest.mark.anyio
async def test_a_base_that_fails_already_is_refused_with_its_failure(tmp_path: Path) -> None:
    standing = driving(31, (70, 0), 0.0, 81)
    workspace = workspace_with(tmp_path, town_road().with_vehicles(standing))
    with pytest.raises(NotPossible, match=r"already fails in .*: collided with obstacle 31") as refusal:
        await searched(workspace, progress())
    assert refusal.value.reason.startswith("base_failed")
    workspace.close()


@pytest.mark.anyio
async def test_a_call_refuses_a_useless_base_that_its_job_opened(tmp_path: Path) -> None:
    standing = driving(31, (70, 0), 0.0, 81)
    workspace = workspace_with(tmp_path, town_road().with_vehicles(standing))
    arguments = FindFailuresArguments(scenario_id=BASE, config="keep_lane", runs=4)
    async with anyio.create_task_group() as tasks:
        services = call_in_process(workspace).services
        jobs = JobRunner(JobStore(workspace.database), tasks)
        context = WorkflowContext(replace(services, jobs=jobs))
        with pytest.raises(NotPossible) as refusal:
            await failures.find_failures(arguments, context)
    assert refusal.value.reason.startswith("base_failed")
    (job,) = jobs.store.newest(10)
    assert job.state == "failed"
    workspace.close()


def test_a_damaged_file_of_a_search_is_passed_over(tmp_path: Path) -> None:
    workspace = workspace_with(tmp_path)
    search = failures._search(FindFailuresArguments(scenario_id=BASE, config="keep_lane"), call_in_process(workspace))
    search.path.parent.mkdir(parents=True, exist_ok=True)
    search.path.write_text("{")
    search.resume()
    assert search.space is None
    assert search.points == []
    workspace.close()


def test_another_world_is_another_search(tmp_path: Path) -> None:
    workspace = workspace_with(tmp_path)
    paths = set()
    for world in ("perfect", "lidar", "camera"):
        arguments = FindFailuresArguments(scenario_id=BASE, config="idm", world=world)
        paths.add(failures._search(arguments, call_in_process(workspace)).path)
    assert len(paths) == 3
    workspace.close()


@pytest.mark.parametrize("world", ["perfect", "camera, missed=0.2"])
def test_a_search_says_in_which_world_it_drove(world: str) -> None:
    record = FailureSearchRecord(
        base_id=BASE, config_id="cfg_1", config_name="idm", runs=1, implausible=0, unavoidable=0, strata=(), world=world
    )
    found = FindFailuresResult(state="done", search=record, next_step="")
    assert (f"(world {world})" in found.answer().to_text()) == (world != "perfect")


def test_a_world_that_the_prediction_does_not_fit_is_refused_before_anything_is_run(tmp_path: Path) -> None:
    workspace = workspace_with(tmp_path)
    arguments = FindFailuresArguments(scenario_id=BASE, config="idm", world="lidar", prediction="ground_truth")
    with pytest.raises(InvalidRequest):
        failures._search(arguments, call_in_process(workspace))
    workspace.close()
