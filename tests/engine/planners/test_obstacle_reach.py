"""Only obstacles that the core could count are given to it: that changes no cost."""

from typing import Any

import frenetix.trajectory_functions.cost_functions as costs
import numpy as np
import pytest
from support.planning import configuration, drive, goal_state, moving_car, problem_for, rectangle_at, scenario_on
from support.planning import straight_road as road

from plannerforge.engine.planners.frenetix import core as frenet_costs
from plannerforge.engine.planners.simulation import DrivenRun

HORIZON = 30


def busy() -> DrivenRun:
    """A lead, an oncoming car, one that drives off sideways, and one far away."""
    cars = (
        moving_car(11, (25.0, 0.0), (6.0, 0.0)),
        moving_car(12, (70.0, 3.5), (-12.0, 0.0)),
        moving_car(13, (12.0, 6.0), (0.0, 30.0)),
        moving_car(14, (79.0, 3.5), (15.0, 0.0)),
    )
    goal = goal_state((40, 60), rectangle_at(40.0, 0.0))
    return drive(scenario_on(road(300.0, lanes=2), *cars), problem_for(goal), configuration("frenetix:Default"))


def test_leaving_out_obstacles_out_of_reach_changes_no_cost_and_no_trajectory(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[dict[int, int]] = []
    term = costs.CalculateCollisionProbabilityFast

    def counted(name: str, weight: float, predictions: dict[int, Any], *sizes: float) -> Any:
        given.append({key: len(prediction.predictedPath) for key, prediction in predictions.items()})
        return term(name, weight, predictions, *sizes)

    monkeypatch.setattr(costs, "CalculateCollisionProbabilityFast", counted)
    cut = busy()
    near = given[0]
    assert min(near.values()) < HORIZON
    given.clear()
    monkeypatch.setattr(frenet_costs, "BEYOND_REACH_M", 1e6)
    whole = busy()
    assert given[0].keys() > near.keys()
    assert set(given[0].values()) == {HORIZON}
    assert [dict(plan.costs) for plan in cut.plans] == [dict(plan.costs) for plan in whole.plans]
    assert np.array_equal([s.position for s in cut.states], [s.position for s in whole.states])
    assert any(plan.costs["prediction"] > 0 for plan in cut.plans)
