"""``plannerforge maps add | fetch | list``: manages the maps that scenarios are generated from."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from .flags import MapFolders, Workspace, settings_from

_Type = Literal[
    "any", "highway", "urban", "intersection", "signalised_intersection", "roundabout", "rural", "ramp"
]  # as in ScenarioType, without importing its module
maps = typer.Typer(name="maps", no_args_is_help=True, help="The maps that scenarios are generated from.")


@maps.command()
def add(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="OpenStreetMap extracts or SUMO networks (.net.xml); .gz, .bz2.", exists=True, dir_okay=False
        ),
    ],
    place: Annotated[str | None, typer.Option(help="The place's name; default: from the file.")] = None,
    country: Annotated[str | None, typer.Option(help="Code or name; default: from addresses or borders.")] = None,
    workspace: Workspace = None,
) -> None:
    """Add maps to the workspace's library."""
    from .map_library import add_maps

    settings = settings_from(workspace=workspace, warm_up=False)
    raise typer.Exit(add_maps(settings, files, place=place, country=country))


@maps.command()
def fetch(
    place: Annotated[str, typer.Argument(help="A town, a street with its town, a crossing, or a sight.")],
    country: Annotated[str | None, typer.Option(help="Code or name, if several countries have the place.")] = None,
    scenario_type: Annotated[_Type, typer.Option(help="A type of site that the map must have.")] = "any",
    workspace: Workspace = None,
) -> None:
    """Fetch a map from OpenStreetMap's services, for use without a network."""
    from .map_library import fetch_map

    settings = settings_from(workspace=workspace, warm_up=False)
    raise typer.Exit(fetch_map(settings, place, country=country, scenario_type=scenario_type))


@maps.command(name="list")
def _list_all(workspace: Workspace = None, map_folders: MapFolders = None) -> None:
    """List the available maps with their sites."""
    from .map_library import list_maps

    raise typer.Exit(list_maps(settings_from(workspace=workspace, map_folders=map_folders, warm_up=False)))
