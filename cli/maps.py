"""``plannerforge maps add | fetch | list``: the maps that scenarios are made from."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from .flags import MapFolders, Workspace, settings_from

_Type = Literal[
    "any", "highway", "urban", "intersection", "signalised_intersection", "roundabout", "rural", "ramp"
]  # as ScenarioType has them, without its module
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


@maps.command()
def fetch(
    place: Annotated[str, typer.Argument(help="A town, a street with its town, a crossing, a sight.")],
    country: Annotated[str | None, typer.Option(help="Code or name, where several have the place.")] = None,
    scenario_type: Annotated[_Type, typer.Option(help="A type of site that is to be on the map.")] = "any",
    workspace: Workspace = None,
) -> None:
    """Fetch a map from OpenStreetMap's services, to have it beside you without a net."""
    from .map_library import fetch_map

    settings = settings_from(workspace=workspace, warm_up=False)
    raise typer.Exit(fetch_map(settings, place, country=country, scenario_type=scenario_type))


@maps.command(name="list")
def _list_all(workspace: Workspace = None, map_folders: MapFolders = None) -> None:
    """List the maps at hand with what sites they hold."""
    from .map_library import list_maps

    raise typer.Exit(list_maps(settings_from(workspace=workspace, map_folders=map_folders, warm_up=False)))
