"""``make bench-failures``: how well failures of planners are found, reproduced and reduced.

Each part is a module of this package with a function ``measure(bench: FailuresBench) -> Figures``, which explains its
keys:

- ``planted``: ``planted_common``, ``planted_rare`` (planted weaknesses found as themselves within a budget).
- ``sound``: ``reproduced``, ``plausible``, ``shrink_users``, ``shrink_runs``, ``shrink_same`` (stored failures judged
  again, apart; their reduction).
- ``critical``: ``critical_attributable``, ``critical_plausible`` (scenarios generated with ``criticality=critical``).
- ``over_peers``: ``over_best_peer``, ``cells_150`` (distinct failures over those of other searches).
- ``speed``: ``evaluations_frenetix``, ``evaluations_fiss``, ``evaluations_idm``, ``boundary_frenetix_s``,
  ``boundary_idm_s`` (processor time).
- ``edges``: ``adaptive_share`` (points of the search of boundaries over a grid's with the same error).

Everything is repeated by its seeds; ``--seeds``, ``--bases`` and ``--runs`` set the sample. NSGA-II needs the package
in ``peers_requirements.txt``.
"""

import argparse
import sys
from pathlib import Path

from ..harness import Parts
from .bench import FailuresBench

PARTS: Parts[FailuresBench] = Parts(
    package=__package__ or "",
    keys={
        "planted": ("planted_common", "planted_rare"),
        "sound": ("reproduced", "plausible", "shrink_users", "shrink_runs", "shrink_same"),
        "critical": ("critical_attributable", "critical_plausible"),
        "over_peers": ("over_best_peer", "cells_150"),
        "speed": (
            "evaluations_frenetix",
            "evaluations_fiss",
            "evaluations_idm",
            "boundary_frenetix_s",
            "boundary_idm_s",
        ),
        "edges": ("adaptive_share",),
    },
)
"""The parts in the order of measurement, and the keys that each owes."""


def _bench(given: argparse.Namespace, scratch: Path) -> FailuresBench:
    return FailuresBench.of(given, scratch)


if __name__ == "__main__":
    sys.exit(PARTS.run("Failures", FailuresBench.options(__doc__), _bench))
