"""``make bench-growth``: how processor time grows with the input, doubled three times.

Keys: ``growth_exponent_max`` (the largest exponent; n log n has up to 1.2 at these sizes), ``growth_subjects``,
``growth_measured`` (subjects with an exponent), and ``growth <what>`` for each subject. Its value is the exponent,
``below 0.05 s`` if at most two sizes take long enough to measure, or the size from which the input is refused (and the
exponent up to there).
"""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from ..harness import print_figures
from .measurement import Growth, measured
from .subjects import SUBJECTS


def main() -> None:
    """Read the command line and measure."""
    parser = argparse.ArgumentParser(description="Processor time on inputs that are doubled.")
    parser.add_argument("--only", default="", help="subjects with this text in their names")
    parser.add_argument("--repeats", type=int, default=2, help="timings of each size; the best counts")
    parser.add_argument("--doublings", type=int, help="only the smallest sizes, doubled this many times")
    given = parser.parse_args()
    grown: list[Growth] = []
    with tempfile.TemporaryDirectory() as folder:
        for subject in (one for one in SUBJECTS if given.only in one.name):
            grown.append(measured(subject, Path(folder), given.repeats, given.doublings))
            sys.stderr.write(f"{subject.name}: {_times(grown[-1])}\n")
    _show(grown)


def _show(grown: Sequence[Growth]) -> None:
    table = Table("what", "size: processor time", "exponent", title="Growth with the input")
    for one in grown:
        table.add_row(one.name, _times(one), str(one.figure))
    Console(width=140).print(table)
    exponents = [one.exponent for one in grown if one.exponent is not None]
    print_figures(
        "Growth",
        {
            "growth_exponent_max": max(exponents, default=0.0),
            "growth_subjects": len(grown),
            "growth_measured": len(exponents),
            **{f"growth {one.name}": one.figure for one in grown},
        },
    )


def _times(growth: Growth) -> str:
    return ", ".join(f"{one.size:,}: {one.seconds:.2f} s{' (refused)' if one.refused else ''}" for one in growth.timed)


if __name__ == "__main__":
    main()
