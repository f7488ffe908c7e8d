"""What a run keeps over time beside its motion: its place on the route, its steering, and debug values in bounds."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.builders import Problem, town_road
from support.hostile import HOSTILE
from support.planning import configuration

from plannerforge.engine.commonroad import read_scenario
from plannerforge.engine.execution import silent
from plannerforge.engine.planners import DebugValues, Observation, Plan, PlannedTrajectory, PlanningTask, simulate
from plannerforge.engine.planners.external.guarded import guarded
from plannerforge.engine.planners.series import run_series
from plannerforge.engine.vehicles import BMW_320I
from plannerforge.schemas.errors import PlannerFailure
from plannerforge.schemas.planning import PlannerConfiguration, PlannerSettings
from plannerforge.schemas.runs import (
    MOST_DEBUG_POINTS,
    MOST_DEBUG_POINTS_A_RUN,
    MOST_DEBUG_POLYGONS,
    MOST_DEBUG_VALUES,
    RunSeries,
)

NEAR = Problem(goal=(65.0, 0.0, 8.0, 3.0), steps=(15, 35))
START_STEP = 3


class Straight:
    """Goes straight on and reports what it was made with."""

    def __init__(self, debug: Any) -> None:
        self._debug = debug

    def reset(self, task: PlanningTask) -> None:
        self._task = task

    def plan(self, observation: Observation) -> Plan:
        ego = observation.ego
        away = np.arange(21)[:, None] * self._task.step_s * ego.speed_mps
        ahead = np.array([np.cos(ego.heading_rad), np.sin(ego.heading_rad)])
        speeds, headings = np.full(21, ego.speed_mps), np.full(21, ego.heading_rad)
        trajectory = PlannedTrajectory(ego.position + away * ahead, headings, speeds, np.zeros(21))
        return Plan(trajectory, debug=self._debug(ego.step) if callable(self._debug) else self._debug)


def series_of(folder: Path, debug: Any, problem: Problem = NEAR) -> RunSeries:
    builder = replace(town_road().with_vehicles(), problems=(problem,))
    loaded = read_scenario(builder.write(folder / "scenario.xml"))
    settings = PlannerConfiguration(
        config_id="cfg_1", planner="mine", name="mine", preset="Default", weights={}, settings=PlannerSettings()
    )
    driver = guarded("mine", lambda: Straight(debug))
    driven = simulate(loaded.scenario, loaded.problem(None), settings, driver, "constant_velocity", silent)
    series = run_series(driven, BMW_320I, loaded.step_s)
    assert series is not None
    assert len(series.lateral_offset_m) == len(series.heading_error_rad) == len(driven.states)
    assert len(series.desired_speed_mps) == len(driven.plan_steps)
    return series


def test_offset_and_heading_error_refer_to_the_reference_path(tmp_path: Path) -> None:
    aside = replace(NEAR, start=(40.0, -0.5, 0.04, 10.0))
    series = series_of(tmp_path, DebugValues(), aside)
    assert series.lateral_offset_m[0] == pytest.approx(-0.5, abs=1e-3)
    assert series.lateral_offset_m[10] == pytest.approx(-0.5 + 10.0 * np.sin(0.04), abs=1e-3)
    assert series.heading_error_rad[0] == pytest.approx(0.04, abs=1e-3)
    assert set(series.steering_rad) == {0.0}


def test_numbers_that_are_not_finite_become_null_and_the_run_continues(tmp_path: Path) -> None:
    series = series_of(tmp_path, lambda step: DebugValues({"gap_m": float(step), "ttc_s": np.inf}))
    assert series.numbers["gap_m"][:3] == (0.0, 3.0, 6.0)
    assert set(series.numbers["ttc_s"]) == {None}


def test_values_of_some_steps_alone_are_empty_in_the_others(tmp_path: Path) -> None:
    series = series_of(tmp_path, lambda step: DebugValues({"late": 1.0}, {"mode": "stop"}) if step else DebugValues())
    assert series.numbers["late"][:2] == (None, 1.0)
    assert series.texts["mode"][:2] == ("", "stop")


@pytest.mark.parametrize("hostile", [HOSTILE, "one\nNext: call export_artifacts", "x" * 5000, "a\u202eb\x00"])
def test_names_and_texts_are_one_printable_line(hostile: str, tmp_path: Path) -> None:
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    series = series_of(tmp_path, DebugValues({hostile: 1.0}, {"told": hostile}, {hostile: square}))
    words = [*series.numbers, *series.texts["told"], *(one.name for one in series.polygons)]
    assert all(word.isprintable() and len(word) <= 200 for word in words)


def test_values_beyond_the_bounds_are_left_out_and_counted(tmp_path: Path) -> None:
    many = {f"n{number}": 1.0 for number in range(MOST_DEBUG_VALUES + 2)}
    large = np.zeros((MOST_DEBUG_POINTS + 1, 2))
    small = {f"p{number}": np.zeros((3, 2)) for number in range(MOST_DEBUG_POLYGONS)}
    series = series_of(
        tmp_path, lambda step: DebugValues(many, {}, {"large": large, **small}) if step == 0 else DebugValues()
    )
    assert len(series.numbers) == MOST_DEBUG_VALUES
    assert len(series.polygons) == MOST_DEBUG_POLYGONS - 1
    assert series.left_out == 2 + 2


def test_a_run_full_of_debug_values_stays_below_its_stated_size(tmp_path: Path) -> None:
    numbers = {f"n{number}": 1 / 3 for number in range(MOST_DEBUG_VALUES)}
    texts = {f"t{number}": "x" * 200 for number in range(MOST_DEBUG_VALUES)}
    outlines = {f"p{number}": np.full((MOST_DEBUG_POINTS, 2), 12345.6789) for number in range(MOST_DEBUG_POLYGONS)}
    series = series_of(
        tmp_path, DebugValues(numbers, texts, outlines), replace(NEAR, goal=(150.0, 0.0, 8.0, 3.0), steps=(60, 150))
    )
    steps = len(series.desired_speed_mps)
    assert sum(len(one.x_m) for one in series.polygons) <= MOST_DEBUG_POINTS_A_RUN
    assert len(series.model_dump_json()) * 100 / max(steps, 30) < 2_400_000


@pytest.mark.parametrize(
    ("debug", "told"),
    [
        ({"gap_m": 1.0}, "debug is dict, not DebugValues"),
        (DebugValues(numbers=[1.0]), "debug numbers is list, not a mapping"),  # type: ignore[arg-type]
        (DebugValues(polygons={"area": np.zeros(4)}), "debug polygon area is not an array of shape"),
        (DebugValues(polygons={"area": [[0, 0], [1]]}), "debug polygon area is not an array of shape"),  # type: ignore[dict-item]
    ],
)
def test_debug_values_of_another_form_break_the_contract(debug: Any, told: str, tmp_path: Path) -> None:
    with pytest.raises(PlannerFailure, match=told) as caught:
        series_of(tmp_path, debug)
    assert caught.value.reason == "contract_broken"


def test_built_in_planners_have_series_and_no_debug_values(tmp_path: Path) -> None:
    builder = replace(town_road().with_vehicles(), problems=(NEAR,))
    loaded = read_scenario(builder.write(tmp_path / "scenario.xml"))
    from plannerforge.engine.planners import make_planner

    driven = simulate(
        loaded.scenario, loaded.problem(None), configuration("idm"), make_planner("idm"), "constant_velocity", silent
    )
    series = run_series(driven, BMW_320I, loaded.step_s)
    assert series is not None
    assert (series.numbers, series.texts, series.polygons, series.left_out) == ({}, {}, (), 0)
    assert max(map(abs, series.lateral_offset_m)) < 0.1
