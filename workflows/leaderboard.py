"""Compare planners over the standard boundaries in several worlds, on one page that everyone can reproduce.

Each boundary in a world is an exploration, which is stored and continues where it was interrupted.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import get_args

from ..engine.exploration import catalogue
from ..engine.planners import PLANNERS
from ..engine.rendering import report_image
from ..engine.workspace import write_whole
from ..schemas.boundaries import MOST_CONFIGURATIONS, BoundaryRecord, ExploreBoundaryArguments
from ..schemas.errors import NotPossible, PlannerForgeError, UnknownName
from ..schemas.leaderboard import Leaderboard, LeaderboardLine, LeaderboardRequest, standing_of
from ..schemas.rendering import ReportImage, ReportRequest, ReportSection, ReportTable
from ..schemas.reviews import DriverModelName
from ..schemas.scenarios import ScenarioRecord
from .boundaries import explore_boundary
from .context import WorkflowContext
from .operations import WRITE_REPORT
from .rendering import draw

BOARD_NAMES = ("leaderboard.html", "leaderboard.json")
"""The files of a leaderboard: the page, and everything on it with all digests."""
_WAIT_S = 50.0


async def make_leaderboard(
    request: LeaderboardRequest, folder: Path, context: WorkflowContext, show: Callable[[int, int, str], None]
) -> Leaderboard:
    """Explore every boundary in every world, and write the page and its data into the folder.

    Args:
        request: what to compare.
        folder: where the two files are written.
        context: the resources of the workflow.
        show: receives the explorations done, their number, and what is being done.

    Raises:
        UnknownName: there is no such logical scenario, planner or world.
        NotPossible: no exploration succeeded.
        ResourceFailure: the folder cannot be written.
    """
    scenarios = request.scenarios or tuple(catalogue())
    planners = request.planners or tuple(name for name in PLANNERS if name not in get_args(DriverModelName))
    request = request.model_copy(update={"scenarios": tuple(scenarios), "planners": planners})
    lines, left_out, images = list[LeaderboardLine](), list[str](), list[ReportImage]()
    versions, bases = dict[str, str](), dict[str, str]()
    parts = [planners[begin : begin + MOST_CONFIGURATIONS] for begin in range(0, len(planners), MOST_CONFIGURATIONS)]
    wanted = [(scenario, world, part) for scenario in scenarios for world in request.worlds for part in parts]
    for number, (scenario, world, part) in enumerate(wanted):
        show(number, len(wanted), f"{scenario} in the world {world}")
        try:
            record = await _explored(request.model_copy(update={"planners": part}), scenario, world, context)
        except UnknownName:
            raise
        except PlannerForgeError as error:
            left_out.append(f"{scenario} in the world {world}: {error.message}")
            continue
        artifact = context.workspace.get(record.boundary_id, "boundary")
        versions |= artifact.recipe.versions
        bases[record.base_id] = context.workspace.get(record.base_id, "scenario").read(ScenarioRecord).content
        lines += [LeaderboardLine.of(one, record.boundary_id, scenario, world) for one in record.maps]
        drawn = await draw(context, "boundary", boundary=record)
        images += [report_image(image, f"{scenario}, world {world} ({record.boundary_id})") for image in drawn.images]
    if not lines:
        raise NotPossible(f"no boundary could be explored: {'; '.join(left_out)}")
    board = Leaderboard(
        request=request,
        standing=standing_of(tuple(lines)),
        lines=tuple(lines),
        left_out=tuple(left_out),
        versions=dict(sorted(versions.items())),
        bases=dict(sorted(bases.items())),
    ).sealed()
    page, data = (folder / name for name in BOARD_NAMES)
    write_whole(data, partial(Path.write_text, data=board.model_dump_json(indent=1) + "\n", encoding="utf-8"))
    await context.run(WRITE_REPORT, _page(board, tuple(images), page))
    return board


async def _explored(request: LeaderboardRequest, scenario: str, world: str, context: WorkflowContext) -> BoundaryRecord:
    """Return the stored or new map of one boundary in one world.

    Raises:
        NotPossible: the exploration failed.
    """
    arguments = ExploreBoundaryArguments(
        scenario=scenario,
        configs=list(request.planners),
        points=request.points,
        references=False,
        world=world,
        seed=request.seed,
        wait_s=_WAIT_S,
    )
    while True:
        found = await explore_boundary(arguments, context)
        if found.record is not None:
            return found.record
        if found.state != "running":
            raise NotPossible(found.message or f"the exploration is {found.state}")


def _page(board: Leaderboard, images: tuple[ReportImage, ...], path: Path) -> ReportRequest:
    standing = ReportTable(
        caption="Mean share of the mapped ranges in which a planner fails although a careful driver would not",
        columns=("place", "planner", "fails avoidably", "bounds", "configuration"),
        rows=tuple(
            (str(place), one.planner, f"{one.avoidable:.1%}", f"{one.low:.1%} to {one.high:.1%}", one.config_id)
            for place, one in enumerate(board.standing, 1)
        ),
    )
    cells = ReportTable(
        caption="Each boundary and world",
        columns=("boundary", "world", "planner", "fails avoidably", "fails unavoidably", "points"),
        rows=tuple(
            (one.scenario, one.world, one.planner, one.in_words(), f"{one.unavoidable:.1%}", str(one.points))
            for one in board.lines
        ),
    )
    digests = ReportTable(
        caption="SHA-256 of each map with all its points",
        columns=("boundary", "world", "planner", "map", "SHA-256"),
        rows=tuple((one.scenario, one.world, one.planner, one.boundary_id, one.content) for one in board.lines),
    )
    bases = ReportTable(caption="Roads", columns=("scenario", "SHA-256"), rows=tuple(board.bases.items()))
    versions = ReportTable(caption="Versions", columns=("package", "version"), rows=tuple(board.versions.items()))
    request = board.request
    command = " ".join(
        [
            "plannerforge leaderboard",
            *(f"--planner {name}" for name in request.planners),
            *(f"--boundary {name}" for name in request.scenarios),
            *(f"--world '{world}'" for world in request.worlds),
            f"--points {request.points} --seed {request.seed}",
        ]
    )
    return ReportRequest(
        title="Leaderboard of motion planners",
        introduction=f"{board.in_words()}.",
        sections=(
            ReportSection(title="Standing", tables=(standing,), findings=board.left_out),
            ReportSection(title="Boundaries", tables=(cells,), images=images),
            ReportSection(
                title="Reproduce it",
                asked=command,
                text=("The same versions give the same digests.",),
                tables=(digests, bases, versions),
            ),
        ),
        footer="Created by PlannerForge MCP.",
        path=str(path),
    )
