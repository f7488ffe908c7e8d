"""``plannerforge workspace …``: reports the workspace's size, checks and repairs it, frees space, and exports it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .flags import Workspace as WorkspaceFlag
from .flags import settings_from

if TYPE_CHECKING:
    from ..engine.workspace import Workspace

workspace = typer.Typer(name="workspace", no_args_is_help=True, help="The folder with all stored artifacts.")
_MB = 1024**2


@workspace.command()
def info(workspace: WorkspaceFlag = None) -> None:
    """Show the size of each part of the workspace."""
    from rich.console import Console
    from rich.table import Column, Table

    from ..engine.workspace import room_used

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
    """Check that records and files agree; the exit code is 1 if something is lost."""
    from ..engine.workspace import disagreements

    with _opened(workspace) as opened:
        found = list(disagreements(opened))
    for each in found:
        typer.echo(f"{'lost' if each.is_lost else 'left over'}: {each.where}: {each.what}")
    lost = sum(each.is_lost for each in found)
    typer.echo(f"{lost} lost, {len(found) - lost} left over" + ("; gc removes the latter" if len(found) > lost else ""))
    raise typer.Exit(1 if lost else 0)


@workspace.command()
def repair(workspace: WorkspaceFlag = None) -> None:
    """Remove records that are unreadable or inconsistent, with the reasons; everything else stays."""
    from ..engine.workspace import repair as take_out_broken

    with _opened(workspace) as opened:
        done = take_out_broken(opened)
    for each, kept in done:
        typer.echo(f"removed: {each.where}: {each.what}; its row and its files are in {kept}")
    typer.echo(f"{len(done)} removed")


@workspace.command()
def gc(
    quota_mb: Annotated[
        int | None, typer.Option(help="Remove what can be recreated until the workspace is no larger than this.")
    ] = None,
    workspace: WorkspaceFlag = None,
) -> None:
    """Remove what belongs to no record, and with a quota also what can be recreated. Stored artifacts stay."""
    from ..engine.workspace import make_room, room_used

    with _opened(workspace) as opened:
        removed = make_room(opened, quota_bytes=None if quota_mb is None else quota_mb * _MB)
        left = sum(use.size_bytes for use in room_used(opened))
    freed = sum(size for _, size in removed)
    typer.echo(f"removed {len(removed):,} entries, {freed / _MB:,.1f} MB; the workspace takes {left / _MB:,.1f} MB")
    if quota_mb is not None and left > quota_mb * _MB:
        typer.echo("Nothing more can be removed: the rest is stored work, or younger than an hour.", err=True)
        raise typer.Exit(1)


@workspace.command(name="export")
def export_to(
    file: Annotated[Path, typer.Argument(help="The archive to write, such as work.zip.")],
    journal: Annotated[bool, typer.Option("--journal", help="Include the journal of calls.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an existing file.")] = False,
    workspace: WorkspaceFlag = None,
) -> None:
    """Write all stored artifacts to one file, with records and digests; the exit code is 1 if something is lost."""
    from ..engine.workspace import export_workspace

    with _opened(workspace) as opened, _progress("writing") as on_bytes:
        made = export_workspace(opened, file, journal=journal, overwrite=overwrite, on_bytes=on_bytes)
    typer.echo(f"{file}: {made.artifacts:,} artifacts, {made.files:,} files, {made.size_bytes / _MB:,.1f} MB")
    for lost in made.left_out:
        typer.echo(f"left out: {lost}: its file is gone; `workspace verify` says more", err=True)
    raise typer.Exit(1 if made.left_out else 0)


@workspace.command(name="import")
def import_from(
    file: Annotated[
        Path, typer.Argument(help="The archive, written by `workspace export`.", exists=True, dir_okay=False)
    ],
    most_mb: Annotated[int, typer.Option(min=1, help="Largest unpacked size.")] = 20_480,
    workspace: WorkspaceFlag = None,
) -> None:
    """Check a whole archive, then import everything in it; import nothing if anything is wrong."""
    from ..engine.commonroad import scan_xml
    from ..engine.workspace import ArchiveLimits, Quota, import_workspace, make_private
    from ..engine.workspace import Workspace as Opened

    def check(path: Path) -> None:
        if path.suffix == ".xml":
            scan_xml(path)

    settings = settings_from(workspace=workspace)
    root = settings.workspace.expanduser().resolve()
    make_private(root)
    opened = Opened(root)
    if settings.workspace_mb:
        opened.limit_room(Quota(opened, settings.workspace_mb * _MB).admit)
    limits = ArchiveLimits(unpacked_bytes=most_mb * _MB)
    try:
        with _progress("reading") as on_bytes:
            made = import_workspace(opened, file, limits=limits, check=check, on_bytes=on_bytes)
    finally:
        opened.close()
    typer.echo(f"{root}: {made.added:,} artifacts added, {made.known:,} already there")


@contextmanager
def _progress(what: str) -> Iterator[Callable[[int, int], None]]:
    """Show a progress bar on standard error, and yield its update function, which takes the bytes done and in total."""
    from rich.console import Console
    from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        bar = bars.add_task(what, total=None)
        yield lambda done, total: bars.update(bar, completed=done, total=total)


@contextmanager
def _opened(given: Path | None) -> "Iterator[Workspace]":
    from ..engine.workspace import Workspace

    root = settings_from(workspace=given).workspace.expanduser().resolve()
    if not root.is_dir():
        typer.echo(f"There is no workspace {root}.", err=True)
        raise typer.Exit(2)
    opened = Workspace(root)
    try:
        yield opened
    finally:
        opened.close()
