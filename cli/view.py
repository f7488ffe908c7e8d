"""``plannerforge view``: writes the page of a scenario, run or batch as one file, and opens it."""

import os
import sys
import webbrowser
from collections.abc import Sequence
from pathlib import Path

import anyio
import typer

from ..engine.execution import CallThreads
from ..engine.workspace import write_whole
from ..server.assembly import open_services
from ..server.settings import Settings
from ..workflows.context import WorkflowContext
from ..workflows.rendering import VIEWS, MadeView, make_view


def view_artifacts(words: Sequence[str], settings: Settings, *, output: Path | None, open_it: bool) -> None:
    """Write the page of the given artifacts, print its path, and open it if there is a screen and ``open_it`` is set.

    Raises:
        PlannerForgeError: No artifact has this name, or no view can show it.
    """
    view = anyio.run(_view, words, settings)
    path = (output or settings.workspace.expanduser() / VIEWS / f"{'_'.join(view.ids)}.html").resolve()
    write_whole(path, lambda partial: partial.write_text(view.page(), encoding="utf-8"))
    typer.echo(str(path))
    if open_it and has_screen():
        webbrowser.open(path.as_uri())


async def _view(words: Sequence[str], settings: Settings) -> MadeView:
    threads = CallThreads()
    try:
        async with open_services(settings, Path.cwd(), threads) as services:
            return await make_view(words, WorkflowContext(services))
    finally:
        threads.close()


def has_screen() -> bool:
    """Return True if a browser can show something to the person at this machine."""
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
