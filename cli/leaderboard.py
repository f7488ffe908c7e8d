"""``plannerforge leaderboard``: compares planners over standard boundaries, and writes the page with all digests."""

from pathlib import Path

import anyio
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn

from ..engine.execution import CallThreads
from ..schemas.errors import PlannerForgeError, leaves_of
from ..schemas.leaderboard import Leaderboard, LeaderboardRequest
from ..server.assembly import open_services
from ..server.observing.logs import log_to_stderr
from ..server.settings import Settings


def write_leaderboard(request: LeaderboardRequest, folder: Path, settings: Settings) -> int:
    """Make a leaderboard, print its standing, and return the exit code: 0, or 2 if it could not be made."""
    errors = Console(stderr=True)
    messages: list[str] = []
    board: Leaderboard | None = None
    try:
        board = anyio.run(_carry_out, request, folder.resolve(), settings, errors)
    except* PlannerForgeError as failures:
        messages = [str(getattr(error, "text", error)) for error in leaves_of(failures)]
    for text in dict.fromkeys(messages):
        errors.print(text, style="red", highlight=False, markup=False, soft_wrap=True)
    if board is None or messages:
        return 2
    console = Console()
    lines = [f"{place}. {one.in_words()}" for place, one in enumerate(board.standing, 1)]
    for line in (*lines, *(f"Left out: {text}" for text in board.left_out), board.in_words(), f"Page: {folder}"):
        console.print(escape(line), highlight=False, soft_wrap=True)
    return 0


async def _carry_out(request: LeaderboardRequest, folder: Path, settings: Settings, console: Console) -> Leaderboard:
    from ..workflows.context import WorkflowContext
    from ..workflows.leaderboard import make_leaderboard

    log_to_stderr(settings.log_level, settings.log_format, settings.journal_redact)
    columns = (SpinnerColumn(), BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"))
    threads = CallThreads()
    try:
        async with open_services(settings, Path.cwd(), threads) as services:
            with Progress(*columns, console=console, transient=True) as bars:
                bar = bars.add_task("starting", total=None)

                def show(done: int, total: int, message: str) -> None:
                    bars.update(bar, completed=done, total=total, description=escape(message))

                return await make_leaderboard(request, folder, WorkflowContext(services), show)
    finally:
        threads.close()
