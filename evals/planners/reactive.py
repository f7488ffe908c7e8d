"""``make bench-reactive``: rear hits of an ego that brakes to a stand.

Scenarios with a follower in the ego's lane are driven with recorded and with reactive traffic: by a planner that brakes
at once with 6 m/s², and by each of our planners, which drive for a second before the ego brakes so. Keys: ``scenarios``
(with a follower), ``runs`` (with one traffic), ``recorded_rear_hits``, ``reactive_rear_hits``, ``reactive_step_ms``
(median duration of a step of the reactive traffic).
"""

import statistics
import sys
from collections.abc import Sequence
from pathlib import Path

from ..harness import print_figures, scenario_files, shared_scenarios
from .rear_hits import BRAKES_AFTER_S, BrakedRun, braked_runs

PROCESSES = 2


def hits(runs: Sequence[BrakedRun], traffic: str, planner: str | None = None) -> int:
    """Runs in which the ego was hit from behind."""
    return sum(run.hit is not None for run in runs if run.traffic == traffic and planner in (None, run.planner))


def rows(runs: Sequence[BrakedRun]) -> list[tuple[str, str]]:
    """Hits by planner, then every hit of reactive traffic."""
    lines = []
    for planner in BRAKES_AFTER_S:
        count = sum(run.planner == planner and run.traffic == "recorded" for run in runs)
        counts = f"recorded {hits(runs, 'recorded', planner)}, reactive {hits(runs, 'reactive', planner)} of {count}"
        lines.append((f"rear hits, driven by {planner}", counts))
    reactive = [run for run in runs if run.traffic == "reactive"]
    return lines + [(f"{run.scenario_id}, {run.planner}", run.hit) for run in reactive if run.hit is not None]


def main(arguments: Sequence[str]) -> None:
    """Measure on the named files, or on all shared scenarios."""
    files = [Path(text) for text in arguments] or scenario_files(shared_scenarios(), None)
    runs = braked_runs(files, PROCESSES)
    steps = [run.step_ms for run in runs if run.traffic == "reactive"]
    figures = {
        "scenarios": len({run.scenario_id for run in runs}),
        "runs": sum(run.traffic == "recorded" for run in runs),
        "recorded_rear_hits": hits(runs, "recorded"),
        "reactive_rear_hits": hits(runs, "reactive"),
        "reactive_step_ms": round(statistics.median(steps), 2) if steps else 0.0,
    }
    print_figures("The ego brakes to a stand", rows(runs), figures)


if __name__ == "__main__":
    main(sys.argv[1:])
