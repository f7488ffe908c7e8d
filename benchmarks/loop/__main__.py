"""``make bench-loop``: checks that verdicts on a planner are reliable.

Each part is a module of this package with a function ``measure(bench: SeededBench) -> Figures``. The module explains
its keys and judges with code that shares nothing with the product.

``--only`` takes keys and parts. A part that fails or is missing is named, and the exit status is then 1. ``--json``
prints only the last line.
"""

import sys

from ..harness import Parts, SeededBench

PARTS: Parts[SeededBench] = Parts(
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
        "worlds": ("worlds_same", "sensing_cost"),
    },
)
"""The parts in the order of measurement, and the keys that each part owes."""


if __name__ == "__main__":
    sys.exit(PARTS.run("Loop", SeededBench.options(__doc__), SeededBench.of))
