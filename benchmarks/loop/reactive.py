"""Checks that every scenario can be driven to its end with traffic that reacts to the ego.

A cell is *lost* if it gives no run: the operation fails, or its process ends. Road users that SUMO cannot place must
stay on their recordings, which the run reports (``on_recording``). Files refused by name as unsafe are not cells: some
generated files miss steps in a trajectory, which CommonRoad does not allow.

- ``reactive_lost``: lost cells of the public scenarios of the shared folder, with reactive traffic;
- ``reactive_lost_fresh``: lost cells of at least 200 other scenarios. The seed draws them from the folder in
  ``PLANNERFORGE_DATABASE`` (a checkout of the public CommonRoad database, without the shared ones), or generates them
  if it is not set (``reactive_fresh_from`` says which). ``reactive_refused_fresh``: refused files.

The planner is ``idm``, the cheapest: SUMO treats the others independently of the ego's planner. The bench also reports
the numbers of cells, and of cells with road users on their recordings.
"""

import os
import random
import sys
from collections.abc import Sequence
from pathlib import Path

from plannerforge.schemas.errors import UnsafeInput

from ..harness import Figures, SeededBench, scenario_files
from ..planners.outcomes import CHECKOUT, Row, cells, measured
from ..symmetries.fresh_data import fresh_scenarios

FRESH = 240
_CONFIGURATION = "idm:Default"
_REFUSED = f"{UnsafeInput.__name__}: "
"""Prefix of a refused file's error in a row."""


def rows_of(files: Sequence[Path]) -> list[Row]:
    """Return the rows of a reactive run of each file; report files without a run on standard error."""
    wanted = cells(files, (_CONFIGURATION,), ("constant_velocity",), ("reactive",))
    found = list(measured(wanted, CHECKOUT))
    for row in found:
        if row["outcome"] is None:
            sys.stderr.write(f"{row['scenario']}: {row['error']}\n")
    return found


def fresh_files(bench: SeededBench, known: Sequence[Path]) -> tuple[str, list[Path]]:
    """Return the source of fresh scenarios as a word, and their files."""
    count = bench.limit or FRESH
    database = os.environ.get("PLANNERFORGE_DATABASE")
    if not database:
        return "made", list(fresh_scenarios(bench.seed, bench.folder("fresh"), count))
    names = {path.stem for path in known}
    others = [path for path in scenario_files(Path(database), None) if path.stem not in names]
    random.Random(f"{bench.seed}: reactive").shuffle(others)  # noqa: S311 - a sample
    return "database", others[:count]


def measure(bench: SeededBench) -> Figures:
    """Drive all scenarios in reactive traffic."""
    public = scenario_files(bench.shared / "data" / "commonroad", None)
    source, fresh = fresh_files(bench, public)
    rows, asked = rows_of(public[: bench.limit]), rows_of(fresh)
    fresh_rows = [row for row in asked if not row.get("error", "").startswith(_REFUSED)]
    return {
        "reactive_lost": sum(row["outcome"] is None for row in rows),
        "reactive_lost_fresh": sum(row["outcome"] is None for row in fresh_rows),
        "reactive_cells": len(rows),
        "reactive_cells_fresh": len(fresh_rows),
        "reactive_refused_fresh": len(asked) - len(fresh_rows),
        "reactive_fresh_from": source,
        "reactive_on_recording": sum(bool(row.get("on_recording")) for row in rows),
        "reactive_on_recording_fresh": sum(bool(row.get("on_recording")) for row in fresh_rows),
    }
