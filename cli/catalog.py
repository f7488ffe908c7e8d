"""``plannerforge catalog add | fetch``: adds scenarios to the catalogue from a folder or a downloaded archive."""

import json
from pathlib import Path
from typing import Annotated

import typer

from .flags import Workers, Workspace, settings_from

catalog = typer.Typer(name="catalog", help="Fill the catalogue with CommonRoad scenarios.", no_args_is_help=True)


@catalog.command()
def add(
    folder: Annotated[Path, typer.Argument(help="A CommonRoad file, or a folder that is searched recursively.")],
    workspace: Workspace = None,
    workers: Workers = None,
) -> None:
    """Import CommonRoad files. Reports the files that it refuses and imports the rest; a repeated call imports only
    changes.
    """
    raise typer.Exit(_import(folder, workspace, workers))


@catalog.command()
def fetch(
    url: Annotated[str, typer.Argument(help="http(s) address of a .zip of CommonRoad files, or of one .xml file.")],
    sha256: Annotated[str, typer.Option(help="SHA-256 that the download must have, in hexadecimal.")],
    workspace: Workspace = None,
    workers: Workers = None,
) -> None:
    """Download an archive, check its hash, and import its scenarios."""
    from rich.console import Console
    from rich.progress import Progress

    from ..engine.catalog import download, unpack
    from ..schemas.errors import PlannerForgeError

    console = Console(stderr=True)
    root = settings_from(workspace=workspace).workspace.expanduser().resolve()
    try:
        with Progress(console=console, transient=True) as bars:
            bar = bars.add_task("downloading", total=None)
            file = download(
                url, sha256, root / "downloads", lambda done, total: bars.update(bar, completed=done, total=total)
            )
        with unpack(file) as folder:
            code = _import(folder, workspace, workers)
    except PlannerForgeError as error:
        console.print(error.text, style="red", highlight=False, markup=False)
        code = 1
    raise typer.Exit(code)


def _import(folder: Path, workspace: Path | None, workers: int | None) -> int:
    from .one_call import make_call

    path = folder.expanduser().resolve()
    root = path if path.is_dir() else path.parent
    settings = settings_from(workspace=workspace, workers=workers, roots=[root], warm_up=False)
    return make_call(settings, "import_files", json.dumps({"path": str(path)}), as_json=False, to_the_end=True)
