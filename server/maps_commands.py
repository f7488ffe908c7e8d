"""``plannerforge maps add | list``: the maps that scenarios are made from."""

from pathlib import Path
from typing import Annotated

import typer

from .flags import MapFolders, Workspace, settings_from

maps = typer.Typer(name="maps", no_args_is_help=True, help="The maps that scenarios are made from.")


@maps.command()
def add(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="OpenStreetMap extracts or SUMO networks (.net.xml); .gz, .bz2.", exists=True, dir_okay=False
        ),
    ],
    place: Annotated[str | None, typer.Option(help="The place's name; left out: as the file says.")] = None,
    country: Annotated[str | None, typer.Option(help="Code or name; left out: from addresses or borders.")] = None,
    workspace: Workspace = None,
) -> None:
    """Take maps into the workspace's library."""
    from .map_library import add_maps

    settings = settings_from(workspace=workspace, warm_up=False)
    raise typer.Exit(add_maps(settings, files, place=place, country=country))


@maps.command(name="list")
def _list_all(workspace: Workspace = None, map_folders: MapFolders = None) -> None:
    """List the maps at hand with what sites they hold."""
    from .map_library import list_maps

    raise typer.Exit(list_maps(settings_from(workspace=workspace, map_folders=map_folders, warm_up=False)))
