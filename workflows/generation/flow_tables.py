"""Convert tables of counted traffic (``counts=FILE.csv``, ``od=FILE.csv``) to flows in the notation of a call."""

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType

from ...schemas.errors import InvalidRequest
from ...schemas.text import shown_name
from ..context import WorkflowContext

NAMING = ("counts", "od")
"""Conditions with road names as values, which keep their spelling."""
_LARGEST_TABLE_BYTES = 1_000_000
_COLUMNS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "road": ("road", "from", "street", "way", "osm_way", "edge", "origin"),
        "to": ("to", "destination"),
        "per_h": ("vehicles_per_h", "per_h", "flow", "count", "vehicles", "veh_per_h"),
        "direction": ("direction", "heading"),
    }
)
"""The columns of a table of counts, and their accepted names."""


def with_tables_read(conditions: Sequence[str], context: WorkflowContext) -> list[str]:
    """Return conditions with the content of tables (``counts=FILE.csv``, ``od=FILE.csv``) instead of their names.

    Raises:
        InvalidRequest: a table is missing, too large, not text, or lacks a column; states the line.
        OutsideRoots: tools may not read from its folder.
    """
    return [_with_table_read(text, context) for text in conditions]


def _with_table_read(text: str, context: WorkflowContext) -> str:
    key, _, value = (part.strip() for part in text.partition("="))
    if key.lower() not in NAMING or not value.lower().endswith((".csv", ".tsv", ".txt")):
        return text
    path = context.allowed_path(value)
    if not path.is_file():
        raise InvalidRequest(
            f"{key}: there is no file {value}", next_step="use a CSV file, or write the flows in the call"
        )
    if path.stat().st_size > _LARGEST_TABLE_BYTES:
        raise InvalidRequest(
            f"{key}: {shown_name(path.name)} is larger than 1 MB", next_step="keep the rows of one town"
        )
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise InvalidRequest(f"{key}: {shown_name(path.name)} is not UTF-8 text") from error
    return f"{key}={'; '.join(_rows(lines, key.lower(), path.name))}"


def _rows(lines: list[str], key: str, name: str) -> Iterator[str]:
    """Yield the flows of a table in the notation of a call, such as ``A 8:1200`` or ``A 8>Main Street:300``."""
    separator = max(",;\t", key=(lines[0] if lines else "").count)
    reader = csv.reader(lines, delimiter=separator)
    header = [word.strip().lower().replace(" ", "_") for word in next(reader, [])]
    columns = {
        column: next((header.index(word) for word in words if word in header), None)
        for column, words in _COLUMNS.items()
    }
    needed = ("road", "to", "per_h") if key == "od" else ("road", "per_h")
    if missing := [" or ".join(_COLUMNS[column][:2]) for column in needed if columns[column] is None]:
        raise InvalidRequest(
            f"{key}: the first line of {name} lacks the columns {' and '.join(missing)}",
            valid=["from,to,vehicles_per_h" if key == "od" else "road,vehicles_per_h,direction"],
        )
    for number, row in enumerate(reader, 2):
        if not any(cell.strip() for cell in row):
            continue
        cells = {
            column: row[at].strip().replace(";", ",") if at is not None and at < len(row) else ""
            for column, at in columns.items()
        }
        if not cells["road"] or not re.fullmatch(r"\d+(\.\d+)?", cells["per_h"]):
            raise InvalidRequest(f"{key}: line {number} of {name} has no road and number: {', '.join(row)[:80]!r}")
        if float(cells["per_h"]) == 0:
            continue
        road = f"{cells['road']}>{cells['to']}" if key == "od" else cells["road"]
        yield ":".join(part for part in (road, cells["per_h"], cells["direction"]) if part)
