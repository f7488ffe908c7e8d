"""Flags that several commands share, and the settings that they make."""

import os
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..settings import Settings, settings_file

if TYPE_CHECKING:
    from pydantic import ValidationError

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
        typer.echo(f"plannerforge: {_problems(error, flags)}", err=True)
        raise typer.Exit(2) from None
    except SettingsError as error:
        typer.echo(f"plannerforge: {error}", err=True)
        raise typer.Exit(2) from None
    except (OSError, tomllib.TOMLDecodeError) as error:
        typer.echo(f"plannerforge: {settings_file()} cannot be read: {error}", err=True)
        raise typer.Exit(2) from None


def _problems(error: "ValidationError", flags: dict[str, Any]) -> str:
    """What is wrong with the settings, each with where it stands and what is valid."""
    from ..arguments.checking import problems_of

    told = []
    for detail, (problem, valid) in zip(error.errors(include_url=False), problems_of(Settings, error), strict=True):
        name = str(detail["loc"][0])
        words = problem.replace("there is no argument", "there is no setting")
        names = ", ".join(valid[:3]) if detail["type"] in {"extra_forbidden", "literal_error"} else ""
        told.append(f"{_place(name, flags)}: {words}" + (f" (valid: {names})" if names else ""))
    return "; ".join(told)


def _place(name: str, flags: dict[str, Any]) -> str:
    """Where a setting was given: a flag wins over a variable, a variable over the file."""
    if flags.get(name) is not None:
        return f"--{name.replace('_', '-')}"
    variable = f"PLANNERFORGE_{name.upper()}"
    return variable if variable in os.environ else str(settings_file())
