"""``make bench-analysis``: checks that statements of analyses about runs are true.

Each part is a module of this package with a function ``measure(bench: SeededBench) -> Figures``. The module explains
its keys and judges with code that shares nothing with the product. The main keys:

- ``causes``: ``class_right`` (share of synthetic collisions reported with the right kind), ``fault_right`` (share
  reported correctly as preventable or not), and both for recorded collisions.
- ``rules``: ``rules_right`` (share of synthetic drives with their traffic rule reported correctly).
- ``nulls``: ``false_findings_rate`` (share of batches without a difference in which a comparison states one),
  ``interval_coverage`` (share of 95 % intervals that contain the truth).
- ``planted``: ``planted_found`` (share of batches with one planted cause of failure in which a finding names it).
- ``trivial``: ``trivial_marked`` (share of reached goals marked correctly as requiring driving or not).
- ``advice``: ``advice_helped`` (share of the weight changes reported to help that help on other roads).
- ``statements``: ``statements_recomputed`` (share of the figures in answers and reports that raw rows reproduce).
- ``solutions``: ``solutions_valid`` (share of successful runs reported as drivable for which CommonRoad's checker
  accepts the exported solution).
- ``measures``: ``measures_agree`` (share of measured values that closed forms, or CriMe on recorded traffic, confirm).
  CriMe runs in its own environment, which the part creates if it is missing.
- ``questions``: ``questions_answered`` (share of the corpora's questions about results that one call answers).

``--only`` takes keys and parts. A part that fails or is missing is named, and the exit status is then 1. ``--json``
prints only the last line.
"""

import sys

from ..harness import Parts, SeededBench

PARTS: Parts[SeededBench] = Parts(
    package=__package__ or "",
    keys={
        "causes": ("class_right", "fault_right", "recorded_class_right", "recorded_fault_right"),
        "rules": ("rules_right", "rules_silent"),
        "nulls": ("false_findings_rate", "interval_coverage"),
        "planted": ("planted_found",),
        "trivial": ("trivial_marked",),
        "advice": ("advice_helped", "advice_told"),
        "statements": ("statements_recomputed",),
        "solutions": ("solutions_valid", "motions_feasible", "steering_told"),
        "measures": ("measures_agree",),
        "questions": ("questions_answered",),
    },
)
"""The parts in the order of measurement, and the keys that each owes."""


if __name__ == "__main__":
    sys.exit(PARTS.run("Analysis", SeededBench.options(__doc__), SeededBench.of))
