"""``make bench-analysis``: whether what an analysis says of runs is so.

Each part is a module of this package with a function ``measure(bench: SeededBench) -> Figures``, which explains its
keys and judges by code apart from the product. The keys that count:

``causes``: ``class_right`` (share of made collisions whose kind is told as it is), ``fault_right`` (told to be
preventable or not, as the truth has it), and both of recorded ones.
``rules``: ``rules_right`` (the share of made drives for which the traffic rule that they are about is told as it is).
``nulls``: ``false_findings_rate`` (of batches in which nothing differs, those in which a comparison states that
something does), ``interval_coverage`` (95 % intervals that hold the truth).
``planted``: ``planted_found`` (of batches with one cause of failure planted, those in which a finding names it).
``trivial``: ``trivial_marked`` (share of reached goals that are told to ask for no driving, or not, as it is so).
``advice``: ``advice_helped`` (of changes of a weight that a trial tells to help, those that help on other roads).
``statements``: ``statements_recomputed`` (share of the figures in answers and reports that raw rows give once more).
``solutions``: ``solutions_valid`` (of runs to the goal that are told to be drivable, those whose exported solution
CommonRoad's checker accepts).
``measures``: ``measures_agree`` (share of the measured values that closed forms, or CriMe on recorded traffic, give
too). CriMe runs in an environment of its own, which the part makes where it is not there.
``questions``: ``questions_answered`` (share of the corpora's questions about results that one call answers).

``--only`` takes keys and parts. A part that is not there is left out and named, one that fails too; then the status is
1. ``--json`` prints the last line alone.
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
"""The parts in the order in which they are measured, and the keys that each owes."""


if __name__ == "__main__":
    sys.exit(PARTS.run("Analysis", SeededBench.options(__doc__), SeededBench.of))
