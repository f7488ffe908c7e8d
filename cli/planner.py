"""``plannerforge planner new | check | schema``: commands for your own planners."""

import json
import re
import sys
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from ..schemas.base import Model
from ..schemas.errors import InvalidRequest, PlannerFailure, PlannerForgeError, ResourceFailure
from ..schemas.planning import WEIGHT_NAME, CommandAnswer, CommandRequest
from ..schemas.stepwise import PlanMessage, ReadyMessage, StartMessage, StepMessage
from ..schemas.text import counted, quoted
from .flags import settings_from

if TYPE_CHECKING:
    from ..engine.planners import Found, PlannerCheck

SchemaName = Literal["request", "answer", "start", "ready", "step", "plan"]
_CHECKED = 3
"""Starter scenarios that a planner is checked on (chosen: takes seconds)."""
Kind = Literal["class", "stepwise"]
_FILES: dict[Kind, dict[str, str]] = {
    "class": {
        "pyproject.toml.txt": "pyproject.toml",
        "planner.py.txt": "{module}.py",
        "test_planner.py.txt": "test_{module}.py",
    },
    "stepwise": {
        "program.py.txt": "{name}.py",
        "program.toml.txt": "plannerforge.toml",
        "test_program.py.txt": "test_{name}.py",
    },
}
"""The templates by kind of planner, and the files that they produce."""
planner = typer.Typer(name="planner", no_args_is_help=True, help="Planners of your own.")


@planner.command()
def new(
    name: Annotated[str, typer.Argument(help="The planner's name: lower-case letters, digits and _.")],
    folder: Annotated[Path | None, typer.Option(help="Where to create its folder; default: here.")] = None,
    kind: Annotated[
        Kind, typer.Option(help="A Python class in a package, or a program that is called at every planning step.")
    ] = "class",
) -> None:
    """Write a starter planner and its test: a package with an entry point, or a program with its settings."""
    made = write_planner(name, folder or Path.cwd(), kind)
    known = (
        f"pip install -e {made}               registers it with the server"
        if kind == "class"
        else "plannerforge doctor                 shows the settings file; add the section in plannerforge.toml to it"
    )
    typer.echo(
        f"{made} created. It already runs:\n"
        f"  cd {made} && python -m unittest     its test\n"
        f"  {known}\n"
        f"  plannerforge planner check {name}   checks its contract"
    )


@planner.command()
def check(
    name: Annotated[str, typer.Argument(help="The planner's name, as in list_planners.")],
    scenarios: Annotated[
        list[Path] | None,
        typer.Argument(help="CommonRoad files; default: three starter scenarios.", exists=True, dir_okay=False),
    ] = None,
    empty_road: Annotated[bool, typer.Option("--empty-road", help="Leave out the recorded road users.")] = False,
) -> None:
    """Run a planner among the recorded traffic; report the outcomes and every breach of the contract.

    The exit code is 1 if the planner breaks the contract, whatever the outcomes.
    """
    from ..engine.catalog import starter_files
    from ..engine.planners import PLANNERS, own_planner, programs_named

    settings = settings_from(warm_up=False)
    with programs_named(settings.planners):
        if name.strip().lower() in PLANNERS:
            raise InvalidRequest(f"{name} is a built-in planner", next_step="give one of your own")
        found = own_planner(name)
        if scenarios:
            passed = _check_all(found, scenarios, empty_road=empty_road)
        else:
            with starter_files(_CHECKED) as starters:
                passed = _check_all(found, starters, empty_road=empty_road)
    raise typer.Exit(0 if passed else 1)


@planner.command()
def schema(
    which: Annotated[
        SchemaName,
        typer.Argument(help="request, answer: for a program that is called once; the rest: for the stepwise protocol."),
    ],
) -> None:
    """Print the JSON schema of a message that a command-line planner reads or writes."""
    typer.echo(published_schema(which), nl=False)


def published_schema(which: SchemaName) -> str:
    """Return the JSON schema as published in ``docs/examples/own_planner``."""
    models: dict[SchemaName, type[Model]] = {
        "request": CommandRequest,
        "answer": CommandAnswer,
        "start": StartMessage,
        "ready": ReadyMessage,
        "step": StepMessage,
        "plan": PlanMessage,
    }
    return json.dumps(models[which].model_json_schema(), indent=1) + "\n"


def write_planner(name: str, folder: Path, kind: Kind = "class") -> Path:
    """Write a starter planner into a new folder with its name, and return the folder.

    Raises:
        InvalidRequest: The name is not valid for a planner, or the folder exists.
        ResourceFailure: The folder cannot be written.
    """
    from ..engine.planners import PLANNERS

    if not WEIGHT_NAME.fullmatch(name) or name in PLANNERS:
        why = "is a built-in planner" if name in PLANNERS else "is not a valid planner name"
        raise InvalidRequest(
            f"{quoted(name)} {why}", next_step="use lower-case letters, digits and _, as in my_planner"
        )
    words = {
        "NAME": name,
        "MODULE": f"plannerforge_{name}",
        "CLASS": "".join(part.capitalize() for part in name.split("_")),
        "DISTRIBUTION": f"plannerforge-{name.replace('_', '-')}",
        "PYTHON": json.dumps(sys.executable),
        "PROGRAM": json.dumps(str((folder / name / f"{name}.py").absolute())),
    }
    target = folder / name
    templates = files("plannerforge.cli") / "own_planner"
    try:
        target.mkdir(parents=True)
        for template, file in _FILES[kind].items():
            text = (templates / template).read_text(encoding="utf-8")
            text = re.sub(rf"\b({'|'.join(words)})(?=\b|Test\b)", lambda found: words[found[0]], text)
            (target / file.format(module=words["MODULE"], name=name)).write_text(text, encoding="utf-8")
    except FileExistsError as error:
        raise InvalidRequest(f"{target} already exists", next_step="use another name or --folder") from error
    except OSError as error:
        raise ResourceFailure(f"{target} cannot be written: {error.strerror}") from error
    return target


def _describe_planner(found: "Found") -> str:
    try:
        declaration = found.declaration
    except PlannerFailure:  # each scenario reports it with the raised error
        return f"{found.name} ({found.where}) cannot be used"
    weights = ", ".join(f"{name}={weight.default:g}" for name, weight in declaration.weights.items()) or "no weights"
    presets = ", ".join(["Default", *declaration.presets])
    return f"{found.name} ({found.where}): {declaration.summary}\n  weights {weights}; presets {presets}"


def _check_all(found: "Found", paths: Sequence[Path], *, empty_road: bool) -> bool:
    from ..engine.planners import check_on

    typer.echo(_describe_planner(found))
    if empty_road:
        typer.echo("  on an empty road, as requested; behaviour in traffic is not checked")
    checks: list[PlannerCheck] = []
    shown: set[str] = set()
    for path in paths:
        try:
            checked = check_on(found.name, found, path, empty_road=empty_road)
        except PlannerForgeError as error:
            typer.echo(f"  {path.name}: {error.text}")
            return False
        checks.append(checked)
        typer.echo(f"  {checked.scenario_id}: {_describe_check(checked, shown)}")
        shown.update(checked.breaches)
    for note in (*_limit_notes(checks), *_unmoved_notes(found, checks)):
        typer.echo(f"  Note: {note}")
    broken = sum(bool(each.breaches) for each in checks)
    where = counted(len(checks), "scenario")
    verdict = f" keeps its contract on {where}" if not broken else f": broken on {broken} of {where}"
    typer.echo(f"{found.name}{verdict}{_describe_outcomes(checks)}.")
    return not broken


def _describe_outcomes(checks: Sequence["PlannerCheck"]) -> str:
    """Return the number of drives per outcome, most frequent first."""
    ended = Counter(each.outcome.replace("_", " ") for each in checks if each.outcome is not None)
    return f"; its drives: {', '.join(f'{outcome} {count}' for outcome, count in ended.most_common())}" if ended else ""


def _limit_notes(checks: Sequence["PlannerCheck"]) -> Iterator[str]:
    """Yield each vehicle limit that drives exceed, once per limit."""
    named: dict[str, list[str]] = {}
    for check in checks:
        for excess in check.beyond_vehicle:
            named.setdefault(excess.name, []).append(f"{excess.in_words()} on {check.scenario_id}")
    for where in named.values():
        more = f", and on {len(where) - 1} more" if len(where) > 1 else ""
        yield f"exceeds the vehicle: {where[0]}{more}; CommonRoad's benchmark may refuse this motion"


def _unmoved_notes(found: "Found", checks: Sequence["PlannerCheck"]) -> Iterator[str]:
    """Yield a note on each weight or parameter that changed no plan of any drive."""
    driven = [each for each in checks if each.outcome is not None and each.planned_again]
    count = sum(each.planned_again for each in driven)
    for name in sorted(set.intersection(*(set(each.unmoved) for each in driven))) if driven else ():
        weight = found.declaration.weights[name]
        same = f"changed none of {counted(count, 'plan')}, from {weight.lowest:g} to {weight.highest:g}"
        if weight.kind == "weight":
            yield (
                f"the weight {name} {same}; if it is not a cost weight but a threshold or gain, declare"
                " kind='parameter'"
            )
        else:
            yield f"the parameter {name} {same}: it has no effect in these drives"


def _describe_check(checked: "PlannerCheck", shown: Collection[str]) -> str:
    """Describe the result on a scenario; repeat an earlier breach in short form, and its traceback only once."""
    parts = (
        [f"{checked.outcome}: {checked.reason}{f'; {checked.took}' if checked.took else ''}"] if checked.outcome else []
    )
    new = [breach for breach in checked.breaches if breach not in shown]
    parts += [f"BREAKS THE CONTRACT: {breach}" for breach in new]
    if len(new) < len(checked.breaches):
        parts.append("BREAKS THE CONTRACT, as above")
    return "\n    ".join([*(parts or [checked.reason]), *(checked.raised.splitlines() if new else ())])
