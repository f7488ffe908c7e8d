"""Flags that several commands share, and the settings that they make."""

import tomllib
from pathlib import Path
from typing import Annotated, Any

import typer

from ..settings import Settings, settings_file

Workspace = Annotated[Path | None, typer.Option(help="Folder for everything that is made.")]
Roots = Annotated[list[Path] | None, typer.Option("--roots", help="Folder that may be read and written; repeatable.")]
MapFolders = Annotated[list[Path] | None, typer.Option("--map-folders", help="Folder with .osm maps; repeatable.")]
Workers = Annotated[int | None, typer.Option(help="Worker processes for simulation and planning.")]


def settings_from(**flags: Any) -> Settings:
    """Settings with the flags that were given; a wrong one ends the program with one line."""
    from pydantic import ValidationError
    from pydantic_settings import SettingsError

    try:
        return Settings(**{name: value for name, value in flags.items() if value is not None})
    except ValidationError as error:
        details = error.errors(include_url=False)
        problems = "; ".join(f"{'.'.join(map(str, detail['loc']))}: {detail['msg']}" for detail in details)
        typer.echo(f"plannerforge: {problems}", err=True)
        raise typer.Exit(2) from None
    except SettingsError as error:
        typer.echo(f"plannerforge: {error}", err=True)
        raise typer.Exit(2) from None
    except (OSError, tomllib.TOMLDecodeError) as error:
        typer.echo(f"plannerforge: {settings_file()} cannot be read: {error}", err=True)
        raise typer.Exit(2) from None
