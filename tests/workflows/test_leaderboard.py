"""A leaderboard: the standing, one page with digests of everything, and the same digests in another workspace."""

import json
from dataclasses import replace
from pathlib import Path

import anyio
import pytest

from benchmarks.harness import call_in_process
from plannerforge.engine.execution.jobs import JobRunner, JobStore
from plannerforge.engine.workspace import Workspace
from plannerforge.schemas.errors import PlannerForgeError, UnknownName
from plannerforge.schemas.leaderboard import Leaderboard, LeaderboardLine, LeaderboardRequest, standing_of
from plannerforge.workflows.context import WorkflowContext
from plannerforge.workflows.leaderboard import make_leaderboard

pytestmark = pytest.mark.anyio
TINY = LeaderboardRequest(planners=("keep_lane",), scenarios=("cut_in",), points=30)


async def made(folder: Path, request: LeaderboardRequest = TINY) -> Leaderboard:
    workspace = Workspace(folder / "workspace")
    told: list[tuple[int, int]] = []
    refusal: PlannerForgeError | None = None
    async with anyio.create_task_group() as tasks:
        services = call_in_process(workspace).services
        context = WorkflowContext(replace(services, jobs=JobRunner(JobStore(workspace.database), tasks)))
        try:
            board = await make_leaderboard(
                request, folder / "out", context, lambda done, total, _: told.append((done, total))
            )
        except PlannerForgeError as error:
            refusal = error
    workspace.close()
    if refusal is not None:
        raise refusal
    assert told == [(0, 1)]
    return board


async def test_two_workspaces_give_the_same_files(tmp_path: Path) -> None:
    boards = [await made(tmp_path / name) for name in ("one", "two")]
    assert boards[0] == boards[1]
    one, two = (tmp_path / name / "out" for name in ("one", "two"))
    assert (one / "leaderboard.json").read_bytes() == (two / "leaderboard.json").read_bytes()
    assert (one / "leaderboard.html").read_bytes() == (two / "leaderboard.html").read_bytes()
    (line,) = boards[0].lines
    assert (line.scenario, line.world) == ("cut_in", "perfect")
    assert 25 <= line.points <= 30
    assert 0 < line.avoidable_low <= line.avoidable <= line.avoidable_high <= 1
    page = (one / "leaderboard.html").read_text(encoding="utf-8")
    for digest in (boards[0].digest, line.content, line.boundary_id, *boards[0].bases.values(), *boards[0].versions):
        assert digest in page
    assert "plannerforge leaderboard --planner keep_lane --boundary cut_in" in page
    assert json.loads((one / "leaderboard.json").read_bytes())["digest"] == boards[0].digest


async def test_unknown_names_are_refused_and_write_nothing(tmp_path: Path) -> None:
    for wrong in ({"scenarios": ("cut_inn",)}, {"planners": ("nobody",)}, {"worlds": ("fogg",)}):
        with pytest.raises(UnknownName):
            await made(tmp_path, TINY.model_copy(update=wrong))
    assert not (tmp_path / "out").exists()


def line(planner: str, scenario: str, avoidable: float, world: str = "perfect") -> LeaderboardLine:
    return LeaderboardLine(
        planner=planner,
        config_id=f"cfg_{planner}",
        scenario=scenario,
        world=world,
        points=30,
        avoidable=avoidable,
        avoidable_low=avoidable / 2,
        avoidable_high=2 * avoidable,
        unavoidable=0.0,
        boundary_id="boundary_1",
        content="",
    )


def test_the_standing_compares_only_what_all_planners_share() -> None:
    lines = (line("a", "one", 0.2), line("b", "one", 0.1), line("a", "two", 0.0), line("b", "two", 0.3))
    assert [(one.planner, one.avoidable) for one in standing_of(lines)] == [("a", 0.1), ("b", 0.2)]
    assert [one.planner for one in standing_of((*lines[:3],))] == ["b", "a"]
    assert standing_of((line("a", "one", 0.2), line("b", "two", 0.1))) == ()


def test_the_digest_covers_everything_else() -> None:
    board = Leaderboard(
        request=TINY, standing=(), lines=(line("a", "one", 0.2),), versions={"x": "1"}, bases={}
    ).sealed()
    assert board.sealed() == board
    for change in ({"versions": {"x": "2"}}, {"bases": {"road": "1"}}, {"lines": ()}):
        assert board.model_copy(update=change).sealed().digest != board.digest
