"""``plannerforge check FILE…``: checks CommonRoad files against the rules for road networks."""

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Column, Table

from ..schemas.scenarios import CheckedFile

_SHOWN_IDS = 4
"""Ids that a line lists per finding (chosen)."""


def check_files(paths: Sequence[Path], *, as_json: bool) -> int:
    """Check every file and print the findings; return 0 if no rule found an error, otherwise 1."""
    from ..engine.network import check_file

    checked = [check_file(path) for path in paths]
    if as_json:
        listed = [file.model_dump(mode="json") for file in checked]
        sys.stdout.write(json.dumps(listed, indent=1, ensure_ascii=False) + "\n")
    else:
        _print(checked)
    return 0 if all(file.passed for file in checked) else 1


def _print(checked: Sequence[CheckedFile]) -> None:
    console = Console()
    table = Table(Column("file", overflow="fold"), "severity", Column("rule", overflow="fold"), "ids", "what is wrong")
    for file in checked:
        name = Path(file.file).name
        if file.unreadable:
            table.add_row(name, "[red]error[/red]", "–", "", _plain(file.unreadable))
        for finding in file.findings:
            colour = "red" if finding.severity == "error" else "yellow"
            table.add_row(
                name,
                f"[{colour}]{finding.severity}[/{colour}]",
                finding.rule,
                _ids(finding.elements),
                _plain(finding.message),
            )
    if table.row_count:
        console.print(table)
    errors = sum(file.count("error") for file in checked)
    warnings = sum(file.count("warning") for file in checked)
    unreadable = sum(bool(file.unreadable) for file in checked)
    clean = sum(file.passed and not file.findings for file in checked)
    console.print(
        f"{len(checked)} file(s): {clean} without a finding, {errors} error(s), {warnings} warning(s)"
        f"{f', {unreadable} unreadable' if unreadable else ''}",
        highlight=False,
    )


def _ids(elements: tuple[int, ...]) -> str:
    more = len(elements) - _SHOWN_IDS
    return " ".join(map(str, elements[:_SHOWN_IDS])) + (f" +{more}" if more > 0 else "")


def _plain(text: str) -> str:
    """Escape text of a file, which must not be read as rich's markup."""
    from rich.markup import escape

    return escape(text)
