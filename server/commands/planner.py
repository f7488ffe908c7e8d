"""``plannerforge planner new | check | schema``: planners of one's own."""

import json
import re
from collections.abc import Collection, Sequence
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from ...schemas.errors import InvalidRequest, PlannerFailure, PlannerForgeError, ResourceFailure
from ...schemas.planning import WEIGHT_NAME, CommandAnswer, CommandRequest
from ...schemas.text import counted, quoted
from .flags import settings_from

if TYPE_CHECKING:
    from ...engine.planners import Found, PlannerCheck

_CHECKED = 3
"""Starter scenarios that a planner is checked on (chosen: seconds)."""
_FILES = {
    "pyproject.toml.txt": "pyproject.toml",
    "planner.py.txt": "{module}.py",
    "test_planner.py.txt": "test_{module}.py",
}
planner = typer.Typer(name="planner", no_args_is_help=True, help="Planners of your own.")


@planner.command()
def new(
    name: Annotated[str, typer.Argument(help="Its name: lower-case letters, digits and _.")],
    folder: Annotated[Path | None, typer.Option(help="Where its folder is made; left out: here.")] = None,
) -> None:
    """Write a planner to begin with: a package with its entry point, a planner of 30 lines, and its test."""
    made = write_planner(name, folder or Path.cwd())
    typer.echo(
        f"{made} is written. It runs as it is:\n"
        f"  cd {made} && python -m unittest     its test\n"
        f"  pip install -e {made}               known to the server from now on\n"
        f"  plannerforge planner check {name}   its contract, in words"
    )


@planner.command()
def check(
    name: Annotated[str, typer.Argument(help="The planner's name, as list_planners has it.")],
    scenarios: Annotated[
        list[Path] | None,
        typer.Argument(help="CommonRoad files; left out: three starter scenarios.", exists=True, dir_okay=False),
    ] = None,
) -> None:
    """Drive a planner and say in words what it breaks of the contract; exit code 1 where it breaks something."""
    from ...engine.catalog import starter_files
    from ...engine.planners import PLANNERS, own_planner, programs_named

    settings = settings_from(warm_up=False)
    with programs_named(settings.planners):
        if name.strip().lower() in PLANNERS:
            raise InvalidRequest(f"{name} is a built-in planner", next_step="name one of your own")
        found = own_planner(name)
        if scenarios:
            passed = _check_all(found, scenarios)
        else:
            with starter_files(_CHECKED) as starters:
                passed = _check_all(found, starters)
    raise typer.Exit(0 if passed else 1)


@planner.command()
def schema(
    which: Annotated[Literal["request", "answer"], typer.Argument(help="What a program reads, or what it writes.")],
) -> None:
    """Print the JSON schema of what a command-line planner reads or writes."""
    typer.echo(published_schema(which), nl=False)


def published_schema(which: Literal["request", "answer"]) -> str:
    """The JSON schema as it is published in ``docs/examples/own_planner``."""
    model = CommandRequest if which == "request" else CommandAnswer
    return json.dumps(model.model_json_schema(), indent=1) + "\n"


def write_planner(name: str, folder: Path) -> Path:
    """Write the package of a planner to begin with into a new folder of its name; the folder.

    Raises:
        InvalidRequest: the name cannot be a planner's, or the folder is there.
        ResourceFailure: it cannot be written.
    """
    from ...engine.planners import PLANNERS

    if not WEIGHT_NAME.fullmatch(name) or name in PLANNERS:
        why = "is a built-in planner" if name in PLANNERS else "is no name for a planner"
        raise InvalidRequest(
            f"{quoted(name)} {why}", next_step="take lower-case letters, digits and _, as in my_planner"
        )
    words = {
        "NAME": name,
        "MODULE": f"plannerforge_{name}",
        "CLASS": "".join(part.capitalize() for part in name.split("_")),
        "DISTRIBUTION": f"plannerforge-{name.replace('_', '-')}",
    }
    target = folder / name
    templates = files("plannerforge.server.commands") / "own_planner"
    try:
        target.mkdir(parents=True)
        for template, file in _FILES.items():
            text = (templates / template).read_text(encoding="utf-8")
            text = re.sub(r"\b(NAME|MODULE|CLASS|DISTRIBUTION)(?=\b|Test\b)", lambda found: words[found[0]], text)
            (target / file.format(module=words["MODULE"])).write_text(text, encoding="utf-8")
    except FileExistsError as error:
        raise InvalidRequest(f"{target} is there already", next_step="take another name or --folder") from error
    except OSError as error:
        raise ResourceFailure(f"{target} cannot be written: {error.strerror}") from error
    return target


def _introduced(found: "Found") -> str:
    try:
        declaration = found.declaration
    except PlannerFailure:  # each scenario tells it, with what was raised
        return f"{found.name} ({found.where}) cannot be used"
    weights = ", ".join(f"{name}={weight.default:g}" for name, weight in declaration.weights.items()) or "no weights"
    presets = ", ".join(["Default", *declaration.presets])
    return f"{found.name} ({found.where}): {declaration.summary}\n  weights {weights}; presets {presets}"


def _check_all(found: "Found", paths: Sequence[Path]) -> bool:
    from ...engine.planners import check_on

    typer.echo(_introduced(found))
    checks: list[PlannerCheck] = []
    told: set[str] = set()
    for path in paths:
        try:
            checked = check_on(found.name, found, path)
        except PlannerForgeError as error:
            typer.echo(f"  {path.name}: {error.text}")
            return False
        checks.append(checked)
        typer.echo(f"  {checked.scenario_id}: {_in_words(checked, told)}")
        told.update(checked.breaches)
    driven = [set(each.idle) for each in checks if each.outcome is not None]
    for weight in sorted(set.intersection(*driven)) if driven else []:
        typer.echo(f"  Note: the weight {weight} changed no first plan, from one end of its range to the other.")
    broken = sum(bool(each.breaches) for each in checks)
    where = counted(len(checks), "scenario")
    typer.echo(
        f"{found.name} keeps its contract on {where}."
        if not broken
        else f"{found.name}: broken on {broken} of {where}."
    )
    return not broken


def _in_words(checked: "PlannerCheck", told: Collection[str]) -> str:
    """What it did on a scenario; a breach that was told of one before in short, and what it raised once."""
    parts = (
        [f"{checked.outcome}: {checked.reason}{f'; {checked.took}' if checked.took else ''}"] if checked.outcome else []
    )
    new = [breach for breach in checked.breaches if breach not in told]
    parts += [f"BREAKS THE CONTRACT: {breach}" for breach in new]
    if len(new) < len(checked.breaches):
        parts.append("BREAKS THE CONTRACT as before")
    return "\n    ".join([*(parts or [checked.reason]), *(checked.raised.splitlines() if new else ())])
