"""Flags that several commands share, the flags of ``serve`` for every setting, and the settings that they produce."""

import inspect
import os
import tomllib
import types
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union, get_args, get_origin

import typer
from typer.core import TyperCommand
from typer.main import get_command

from ..server.settings import Settings, settings_file

if TYPE_CHECKING:
    from pydantic import ValidationError
    from pydantic.fields import FieldInfo

Workspace = Annotated[Path | None, typer.Option(help="Folder for all stored artifacts.")]
Roots = Annotated[
    list[Path] | None, typer.Option("--roots", help="Folder that the server may read and write; repeatable.")
]
MapFolders = Annotated[list[Path] | None, typer.Option("--map-folders", help="Folder with .osm maps; repeatable.")]
Workers = Annotated[int | None, typer.Option(help="Worker processes for simulation and planning.")]
SECRET = frozenset({"http_tokens"})
"""Settings without a flag, since other users can see a process's flags and shells record them."""
PANELS: Mapping[str, tuple[str, ...]] = types.MappingProxyType(
    {
        "Files": ("workspace", "workspace_mb", "roots", "map_folders", "starter", "file_mb"),
        "Work": (
            *("workers", "worker_memory_mb", "operation_timeout_s", "server_memory_mb"),
            *("cluster", "planners", "embedding_model", "warm_up"),
        ),
        "Tools": ("tools", "read_only", "links"),
        "Maps from the net": (
            *("maps_online", "nominatim_url", "overpass_urls", "maps_user_agent", "maps_delay_s", "maps_timeout_s"),
            *("maps_cache_mb", "maps_cache_days", "maps_km2"),
        ),
        "HTTP": (
            *("http_host", "http_port", "http_url", "http_hosts", "http_origins", "http_token_file", "http_proxies"),
            *("http_body_mb", "http_calls", "http_rate", "http_stop_s", "oauth_issuer", "oauth_keys_url"),
        ),
        "Journal, log, telemetry": (
            "journal",
            "journal_mb",
            "journal_redact",
            "log_level",
            "log_format",
            "telemetry_endpoint",
        ),
    }
)
"""Maps each heading of ``serve --help`` to the settings below it."""
_SHORT_FLAGS = {"http_host": "--host", "http_port": "--port", "http_token_file": "--token-file"}
_GIVEN = "settings of this command"


class SettingsCommand(TyperCommand):
    """A command with a flag for every setting; ``settings_of`` reads them from its context."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.params.extend(get_command(_all_flags()).params)

    def invoke(self, ctx: Any) -> Any:
        """Set the flags of settings aside for ``settings_of``, and call the command."""
        names = [name for name in Settings.model_fields if name in ctx.params]
        given = {name: ctx.params.pop(name) for name in names}
        ctx.meta[_GIVEN] = {name: value for name, value in given.items() if value not in (None, (), [])}
        return super().invoke(ctx)


def settings_of(context: typer.Context) -> Settings:
    """Return the settings of a ``SettingsCommand``; an invalid one ends the program with one line."""
    return settings_from(**context.meta[_GIVEN])


def _all_flags() -> typer.Typer:
    """Return a command that has a flag for every setting and does nothing."""

    def flags(**given: Any) -> None:
        del given

    parameters = [
        inspect.Parameter(
            name,
            inspect.Parameter.KEYWORD_ONLY,
            default=None,
            annotation=_flag(name, Settings.model_fields[name], panel),
        )
        for panel, names in PANELS.items()
        for name in names
    ]
    flags.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    program = typer.Typer(add_completion=False)
    program.command()(flags)
    return program


def _flag(name: str, setting: "FieldInfo", panel: str) -> Any:
    """Return the option of a setting as a parameter annotation; the value is None if the flag is not given."""
    spelled = f"--{name.replace('_', '-')}"
    names = [f"{spelled}/--no-{spelled[2:]}"] if setting.annotation is bool else [spelled]
    names += [_SHORT_FLAGS[name]] if name in _SHORT_FLAGS else []
    text = f"{setting.description}; repeatable" if get_origin(setting.annotation) is tuple else str(setting.description)
    default = _format_default(setting.default)
    text += f" [default: {default}]" if default else ""
    option = typer.Option(
        *names, help=text.replace("[", "\\["), rich_help_panel=panel, metavar=_form(setting.annotation)
    )
    return Annotated[Union[_type(setting.annotation), None], option]  # noqa: UP007 - a type that is known at run time only


def _type(kind: Any) -> Any:
    """Return the type that the command line reads for a setting; the settings' own validation checks the value."""
    if get_origin(kind) is tuple:
        return list[Path] if get_args(kind)[0] is Path else list[str]
    if Path in (kind, *get_args(kind)):
        return Path
    return kind if kind in (bool, int, float) else str


def _form(kind: Any) -> str | None:
    """Return the placeholder for the value in the help, or None if the type provides it."""
    words = get_args(kind)
    if get_origin(kind) is tuple:
        return "<path>" if words[0] is Path else "<str>"
    if get_origin(kind) is Literal:
        return "|".join(words)
    return "JSON" if get_origin(kind) is dict else None


def _format_default(default: Any) -> str:
    """Return a default for the help; empty if the description states it, or if there is no default."""
    if isinstance(default, bool):
        return "yes" if default else "no"
    if isinstance(default, tuple):
        return ", ".join(map(str, default))
    return f"{default:g}" if isinstance(default, int | float) else default if isinstance(default, str) else ""


def settings_from(**flags: Any) -> Settings:
    """Return settings with the given flags; an invalid one ends the program with one line."""
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
    """Return the problems of the settings, each with its source and the valid values."""
    from ..schemas.base import problems_of

    text = []
    problems = problems_of(Settings, error, "setting")
    for detail, (problem, valid) in zip(error.errors(include_url=False), problems, strict=True):
        name = str(detail["loc"][0])
        shown = {"extra_forbidden": valid[:3], "literal_error": valid}.get(detail["type"], [])
        names = ", ".join(shown)
        text.append(f"{_place(name, flags)}: {problem}" + (f" (valid: {names})" if names else ""))
    return "; ".join(text)


def _place(name: str, flags: dict[str, Any]) -> str:
    """Return the source of a setting: a flag overrides a variable, which overrides the file."""
    if flags.get(name) is not None:
        return f"--{name.replace('_', '-')}"
    variable = f"PLANNERFORGE_{name.upper()}"
    return variable if variable in os.environ else str(settings_file())
