"""The bench of failures: a planted weakness that changes nothing in a run is known to change nothing."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from benchmarks.failures.weaknesses import Watch, Weak
from plannerforge.engine.planners import Observation
from plannerforge.engine.planners.interface import EgoState, PredictedObstacle

TASK: Any = SimpleNamespace(step_s=0.1)


class Eyes:
    """A planner that remembers what it saw."""

    def __init__(self) -> None:
        self.saw: list[tuple[int, ...]] = []

    def reset(self, task: Any) -> None:
        del task

    def plan(self, observation: Observation) -> Any:
        self.saw.append(tuple(other.obstacle_id for other in observation.obstacles))


def observed(step: int, kind: str = "bicycle", speed_mps: float = 3.0) -> Observation:
    ego = EgoState(step=step, position=np.zeros(2), heading_rad=0.0, speed_mps=8.0)
    ahead = np.array([[20.0 + 0.1 * speed_mps * index, -2.0] for index in range(5)])
    other = PredictedObstacle(7, ahead, np.zeros(5), np.eye(2), 2.0, 1.0, speed_mps, kind)
    return Observation(ego, (other,))


def watched(*names: str) -> tuple[Watch, Eyes]:
    eyes = Eyes()
    watch = Watch(eyes, names)
    watch.reset(TASK)
    return watch, eyes


def test_a_weakness_changes_a_run_only_if_it_changes_what_is_seen() -> None:
    watch, eyes = watched("blind_to_cyclists", "blind_to_pedestrians", "blind_on_the_left", "others_seem_to_stand")
    watch.plan(observed(0))
    assert watch.altered == {"blind_to_cyclists", "others_seem_to_stand"}
    assert eyes.saw == [(7,)]  # the healthy planner sees everything


def test_a_weak_planner_does_not_see_what_its_weakness_hides() -> None:
    eyes = Eyes()
    weak = Weak(eyes, "blind_to_cyclists")
    weak.reset(TASK)
    weak.plan(observed(0))
    weak.plan(observed(1, kind="car"))
    assert eyes.saw == [(), (7,)]


def test_a_delay_changes_nothing_for_one_that_stands() -> None:
    watch, _ = watched("latency")
    for step in range(40):
        watch.plan(observed(step, speed_mps=0.0))
    assert watch.altered == set()
    watch.plan(observed(40, speed_mps=3.0))
    assert watch.altered == {"latency"}
