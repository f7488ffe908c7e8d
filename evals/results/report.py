"""The report of an evaluation: one self-contained HTML file with the tables, and each miss with its calls."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from ... import __version__
from ...engine.workspace import write_text
from .rows import Row
from .tables import tables_of


def report_html(rows: Sequence[Row]) -> str:
    """Return the report on one or more rows."""
    environment = Environment(
        loader=PackageLoader(__package__, "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["written"] = _written
    return environment.get_template("report.html.j2").render(
        title=f"Evaluation of {rows[0].agent}",
        rows=rows,
        done=sum(row.score.done for row in rows),
        misses=[row for row in rows if not row.score.done],
        tables=tables_of(rows),
        closing=f"PlannerForge MCP {__version__}, condition {rows[0].condition}",
    )


def write_results(rows: Sequence[Row], folder: Path) -> tuple[Path, Path]:
    """Write the tables and the report of an evaluation to its folder; return their paths.

    Raises:
        ResourceFailure: the folder cannot be written.
    """
    tables, report = folder / "tables.md", folder / "report.html"
    write_text(tables, "\n".join(table.to_markdown() for table in tables_of(rows)), "the tables")
    write_text(report, report_html(rows), "the report")
    return tables, report


def _written(value: Mapping[str, Any]) -> str:
    """Return an object as JSON text with one line per key."""
    lines = (f"{json.dumps(key)}: {json.dumps(one, ensure_ascii=False)}" for key, one in value.items())
    return "{" + ",\n ".join(lines) + "}"
