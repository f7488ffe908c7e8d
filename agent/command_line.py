"""The commands of clients: the demo. ``evals/command_line.py`` adds the evaluation and holds the entry point."""

from pathlib import Path
from typing import Annotated

import typer

from ..server.command_line import application

__all__ = ["application"]


@application.command()
def demo(
    scenario: Annotated[Path | None, typer.Option(help="A CommonRoad file to begin with.")] = None,
    map_file: Annotated[
        Path | None, typer.Option("--map", help="An OpenStreetMap extract (.osm) to begin with.")
    ] = None,
    folder: Annotated[Path, typer.Option(help="Where the report, pictures and scenarios go.")] = Path("demo-output"),
) -> None:
    """Take a scenario through every stage with a real MCP client, and write a report."""
    from .demo import run_demo

    raise typer.Exit(run_demo(scenario=scenario, map_file=map_file, folder=folder))
