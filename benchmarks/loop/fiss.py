"""Compares the planning times of FISS and Frenetix on the same observations.

Frenetix drives public scenarios with ``Default``. At every planning step FISS plans from the same observation, right
after Frenetix and in the same thread, so that both find the machine in the same state. The bench compares processor
times of the thread, which other processes do not affect.

Keys: ``fiss_plan_ratio``: median time of FISS's plans over that of Frenetix's; ``fiss_plan_ms``, ``frenetix_plan_ms``:
both medians; ``fiss_core_share``: the share of FISS's plans that its core takes; ``fiss_plans``: observations on which
both planned.
"""

import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import replace

from plannerforge.engine.commonroad import read_recorded
from plannerforge.engine.execution import silent
from plannerforge.engine.planners import Observation, Plan, Planner, PlanningTask, make_planner, simulate
from plannerforge.evals.scoring.common import built_in

from ..harness import Figures, SeededBench, scenario_files

SCENARIOS = 24
"""About 700 planning steps (chosen)."""
_COMPARED = ("frenetix:Default", "fiss:Default")


class _Both:
    """Frenetix, with FISS asked in parallel; times of their plans in s, in the order of the planning steps."""

    def __init__(self) -> None:
        self._drives, self._asked = (make_planner(built_in(name).planner) for name in _COMPARED)
        self.frenetix_s: list[float] = []
        self.fiss_s: list[float] = []
        self.core_s: list[float] = []

    def reset(self, task: PlanningTask) -> None:
        """Prepare both for a new run."""
        self._drives.reset(task)
        self._asked.reset(replace(task, configuration=built_in(_COMPARED[1])))

    def plan(self, observation: Observation) -> Plan:
        """Return Frenetix's plan."""
        chosen, took_s = _timed(self._drives.plan, observation)
        other, other_s = _timed(self._asked.plan, observation)
        self.frenetix_s.append(took_s)
        self.fiss_s.append(other_s)
        self.core_s.append(other.core_s)
        return chosen


def measure(bench: SeededBench) -> Figures:
    """Return the figures of the keys above; with a limit, on so many scenarios."""
    both = _Both()
    planner: Planner = both
    for path in scenario_files(bench.shared / "data" / "commonroad", bench.limit or SCENARIOS):
        loaded = read_recorded(path).loaded
        run = simulate(loaded.scenario, loaded.problem(), built_in(_COMPARED[0]), planner, "constant_velocity", silent)
        sys.stderr.write(f"{path.name}: {run.final.outcome}, {len(both.fiss_s)} planning steps so far\n")
    frenetix_s, fiss_s = statistics.median(both.frenetix_s), statistics.median(both.fiss_s)
    return {
        "fiss_plan_ratio": round(fiss_s / frenetix_s, 4),
        "fiss_plan_ms": round(1000 * fiss_s, 3),
        "frenetix_plan_ms": round(1000 * frenetix_s, 3),
        "fiss_core_share": round(sum(both.core_s) / sum(both.fiss_s), 3),
        "fiss_plans": len(both.fiss_s),
    }


def _timed(plan: Callable[[Observation], Plan], observation: Observation) -> tuple[Plan, float]:
    began = time.thread_time()
    made = plan(observation)
    return made, time.thread_time() - began
