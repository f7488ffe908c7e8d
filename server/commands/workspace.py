"""``plannerforge workspace info | verify | gc``: what a workspace takes, whether it is sound, and room made again."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .flags import Workspace as WorkspaceFlag
from .flags import settings_from

if TYPE_CHECKING:
    from ...engine.workspace import Workspace

workspace = typer.Typer(name="workspace", no_args_is_help=True, help="The folder that holds everything that was made.")
_MB = 1024**2


@workspace.command()
def info(workspace: WorkspaceFlag = None) -> None:
    """Say what each part of the workspace takes."""
    from rich.console import Console
    from rich.table import Column, Table

    from ...engine.workspace import room_used

    with _opened(workspace) as opened:
        uses = room_used(opened)
        table = Table("what", Column("files", justify="right"), Column("MB", justify="right"), "can be made again")
        for use in uses:
            table.add_row(use.name, f"{use.files:,}", f"{use.size_bytes / _MB:,.1f}", "yes" if use.is_cache else "")
        console = Console()
        console.print(str(opened.root), highlight=False, soft_wrap=True)
        console.print(table)
        console.print(f"{sum(use.size_bytes for use in uses) / _MB:,.1f} MB", highlight=False)


@workspace.command()
def verify(workspace: WorkspaceFlag = None) -> None:
    """Look whether records and files agree; exit code 1 where something that was made is lost."""
    from ...engine.workspace import disagreements

    with _opened(workspace) as opened:
        found = list(disagreements(opened))
    for each in found:
        typer.echo(f"{'lost' if each.is_lost else 'left over'}: {each.where}: {each.what}")
    lost = sum(each.is_lost for each in found)
    typer.echo(f"{lost} lost, {len(found) - lost} left over" + ("; gc removes these" if len(found) > lost else ""))
    raise typer.Exit(1 if lost else 0)


@workspace.command()
def gc(
    quota_mb: Annotated[
        int | None, typer.Option(help="Remove what can be made again until the workspace takes no more than this.")
    ] = None,
    workspace: WorkspaceFlag = None,
) -> None:
    """Remove what belongs to nothing; with a quota also what can be made again. What was made stays."""
    from ...engine.workspace import make_room, room_used

    with _opened(workspace) as opened:
        removed = make_room(opened, quota_bytes=None if quota_mb is None else quota_mb * _MB)
        left = sum(use.size_bytes for use in room_used(opened))
    freed = sum(size for _, size in removed)
    typer.echo(f"removed {len(removed):,} entries, {freed / _MB:,.1f} MB; the workspace takes {left / _MB:,.1f} MB")
    if quota_mb is not None and left > quota_mb * _MB:
        typer.echo("More cannot be removed: the rest was made, or is younger than an hour.", err=True)
        raise typer.Exit(1)


@contextmanager
def _opened(given: Path | None) -> "Iterator[Workspace]":
    from ...engine.workspace import Workspace

    root = settings_from(workspace=given).workspace.expanduser().resolve()
    if not root.is_dir():
        typer.echo(f"There is no workspace {root}.", err=True)
        raise typer.Exit(2)
    opened = Workspace(root)
    try:
        yield opened
    finally:
        opened.close()
