"""The form of every benchmark's output: a table, then one line of JSON."""

import json
import statistics
import sys
from collections.abc import Mapping, Sequence

from rich.console import Console
from rich.table import Table


def print_figures(title: str, rows: Sequence[tuple[str, str]], figures: Mapping[str, float | int | str]) -> None:
    """Print a table of ``(what, figure)`` rows and the figures as the last line."""
    table = Table("figure", "value", title=title)
    for what, value in rows:
        table.add_row(what, value)
    Console(width=110).print(table)
    sys.stdout.write(json.dumps(dict(figures)) + "\n")


def spread(values: Sequence[float], unit: str, digits: int = 2) -> str:
    """Median with minimum and maximum, in words."""
    middle = statistics.median(values)
    return f"{middle:.{digits}f} {unit} (min {min(values):.{digits}f}, max {max(values):.{digits}f}, n {len(values)})"
