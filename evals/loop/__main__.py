"""``make bench-loop``: whether a verdict on a planner can be relied on.

Each part is a module of this package with a function ``measure(bench: LoopBench) -> Figures``. The module explains its
keys and judges with code that shares nothing with the product.

``--only`` takes keys and parts. A part that fails or is missing is named, and the exit status is then 1. ``--json``
prints only the last line.
"""

import argparse
import sys
import tempfile
from pathlib import Path

from ..harness import Parts, add_part_options, existing, print_parts, shared_folder
from .bench import LoopBench

PARTS: Parts[LoopBench] = Parts(
    package=__package__ or "",
    keys={
        "standing": ("standing_right", "braking_right"),
        "laps": ("lap_error_m_max",),
        "restarts": ("restarts",),
        "reactive": ("reactive_lost", "reactive_lost_fresh"),
        "verdicts": ("verdicts_right", "window_errors"),
        "ego_classes": ("ego_classes_right",),
        "versions": ("versions_told",),
        "protocol": ("protocol_named", "protocol_step_ms"),
        "official": ("official_goals_gt", "official_goals_cv", "beyond_limits"),
        "acceptance": ("acceptance_agree",),
        "fiss": ("fiss_plan_ratio",),
        "headlines": ("headlines_right",),
    },
)
"""The parts in the order in which they are measured, and the keys that each part owes."""


def _main() -> int:
    """Read the command line, measure, print; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_part_options(parser)
    parser.add_argument("--shared", type=Path, default=shared_folder(), help="folder that contains data/commonroad")
    parser.add_argument("--seed", type=int, default=20, help="of everything that is drawn (default: 20)")
    parser.add_argument("--limit", type=int, default=None, help="only this many cases per part: a sample")
    given = parser.parse_args()
    try:
        parts = PARTS.chosen(given.only)
    except ValueError as error:
        parser.error(str(error))
    with tempfile.TemporaryDirectory() as scratch:
        bench = LoopBench(existing(given.shared), Path(scratch), given.seed, given.limit)
        figures, faults = PARTS.measured(parts, bench)
    return print_parts("Loop", figures, faults, as_json=given.json)


if __name__ == "__main__":
    sys.exit(_main())
