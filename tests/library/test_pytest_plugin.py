"""The plugin of pytest runs suites with planners of the test's own."""

from pathlib import Path

import pytest
from support.builders import town_road

pytest_plugins = ["pytester"]

SUITE = """
name: gate
scenarios:
  - files: town.xml
configurations: ["stands:Default"]
limits: ["lost == 0", "success >= {share}"]
"""
TESTS = """
import numpy as np
import pytest
from plannerforge.engine.planners import Plan, PlannedTrajectory

class Stands:
    def reset(self, task):
        self.step_s = task.step_s

    def plan(self, observation):
        ego, many = observation.ego, np.ones(21)
        speeds = np.maximum(ego.speed_mps - 4.0 * self.step_s * np.arange(21), 0.0)
        way = np.concatenate([[0.0], np.cumsum((speeds[1:] + speeds[:-1]) / 2 * self.step_s)])
        ahead = np.array([np.cos(ego.heading_rad), np.sin(ego.heading_rad)])
        places = ego.position + np.outer(way, ahead)
        return Plan(PlannedTrajectory(places, ego.heading_rad * many, speeds, np.gradient(speeds, self.step_s)))

@pytest.mark.planner_suite("easy.yaml", planners=[Stands])
def test_easy(planner_suite):
    assert planner_suite.passed, planner_suite.verdicts

@pytest.mark.planner_suite("hard.yaml", planners=[Stands])
def test_hard(planner_suite):
    assert planner_suite.passed, planner_suite.verdicts

def test_unmarked(planner_suite):
    pass
"""


@pytest.mark.usefixtures("warm_workers")
def test_limits_that_hold_pass_and_broken_ones_fail(pytester: pytest.Pytester) -> None:
    folder = Path(pytester.path)
    town_road().write(folder / "town.xml")
    for name, share in (("easy", 0), ("hard", 1)):
        (folder / f"{name}.yaml").write_text(SUITE.format(share=share), encoding="utf-8")
    pytester.makepyfile(test_planner=TESTS)
    result = pytester.runpytest("-p", "plannerforge.library.testing", "-p", "no:cacheprovider")
    result.assert_outcomes(passed=1, failed=1, errors=1)
