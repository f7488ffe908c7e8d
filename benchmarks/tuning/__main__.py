"""``make bench-tuning``: planners, their tuning, and runs on more than one machine.

Each part is a module of this package with a function ``measure(bench: SeededBench) -> Figures``. The module explains
its keys and judges with code that shares nothing with the product. The main keys:

- ``cluster``: ``dask_same_rows`` (share of runs that two Dask workers, killed or not, carry out identically to one
  process), ``dask_speedup`` (time on one Dask worker over that on two).
- ``weight_files``: ``yaml_exact`` (share of weight files that come back identical except for changed numbers).
- ``sensitivity``: ``sensitivity_planted`` (share of cases in which the decisive and the inert weight are reported as
  such).
- ``optimised``: ``optimised_gain``, ``optimised_gain_low``, ``optimised_collision_change`` (gain of a search on unseen
  roads).
- ``rbfn``: ``rbfn_end_error_m``, ``rbfn_us_per_primitive``, ``rbfn_success``, ``frenetix_success`` (quality of
  MP-RBFN's primitives, and its success with a known future).
- ``requests``: ``requests_exact``, ``refused_right`` (every line of the tuning corpus as arguments).
- ``own_planners``: ``own_faults_named`` (faulty programs that are each a named error of their run).
- ``speed``: ``run_median_s``, ``two_worker_speedup``, ``first_run_s`` and the shares of the stages of a run.
- ``tables``: ``success_PLANNER_N``, ``collisions_PLANNER_N`` (every planner on the presets of 50, 100 and all
  scenarios).
- ``reference``: ``reference_agree`` (share of scenarios that end as in the public loop around Frenetix),
  ``reference_time_ratio`` (processor time of its runs over ours).
- ``reference_presets``: ``reference_guessed_to_success`` and others: the gain of Safety-Conservative in that loop.

``--only`` takes keys and parts. A part that fails or is missing is named, and the exit status is then 1. ``--json``
prints only the last line.
"""

import argparse
import sys
from pathlib import Path

from ..harness import Parts, existing
from .reference import TuningBench

PARTS: Parts[TuningBench] = Parts(
    package=__package__ or "",
    keys={
        "requests": ("requests_exact", "refused_right"),
        "own_planners": ("own_faults_named",),
        "speed": ("run_median_s", "two_worker_speedup", "first_run_s"),
        "rbfn": ("rbfn_end_error_m", "rbfn_us_per_primitive", "rbfn_success", "frenetix_success"),
        "cluster": ("dask_same_rows", "dask_speedup"),
        "weight_files": ("yaml_exact",),
        "sensitivity": ("sensitivity_planted",),
        "optimised": ("optimised_gain", "optimised_gain_low", "optimised_collision_change"),
        "tables": ("tabled", "success_frenetix_500"),
        "reference": ("reference_agree", "reference_time_ratio"),
        "reference_presets": ("reference_guessed_to_success", "own_guessed_to_success"),
    },
)
"""The parts in the order of measurement, and the keys that each owes."""


def _bench(given: argparse.Namespace, scratch: Path) -> TuningBench:
    return TuningBench(
        existing(given.shared), scratch, given.seed, given.limit, given.reference, given.reference_python
    )


def _main() -> int:
    """Read the command line, measure, print; the status."""
    parser = TuningBench.options(__doc__)
    parser.add_argument("--reference", type=Path, help="checkout of Frenetix-Motion-Planner (docs/planners.md)")
    parser.add_argument("--reference-python", type=Path, help="the Python of its environment")
    return PARTS.run("Tuning", parser, _bench)


if __name__ == "__main__":
    sys.exit(_main())
