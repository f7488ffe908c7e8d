"""Tests stepwise programs that go wrong, and measures the cost of the protocol.

Each faulty program of ``stepwise_program.py`` runs on a synthetic road as a program of the settings. Its run must fail
as a ``planner_failure`` with the reason in ``EXPECTED``, within the limits of the settings, and leave no process
behind.

The cost of a step compares one planner as a class in this process and as a program, on the same observations of a road
with 40 visible road users. It looks for the smallest distance to any predicted position, so both read all their input.
During the measurement both processes have priority over all others if the system allows it (``SCHED_FIFO``), because a
message wakes the other process and other load would delay it.

Keys: ``protocol_named``: share of the programs with runs reported this way. ``protocol_kinds``: number of programs.
``protocol_slowest_s``: the longest run beyond its limit. ``protocol_left``: processes left behind.
``protocol_step_ms``: median over the steps of the program's time minus the class's time. ``protocol_program_ms``,
``protocol_class_ms``: both medians.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from statistics import median
from time import perf_counter

import numpy as np
import psutil

from plannerforge.engine.commonroad import read_recorded
from plannerforge.engine.execution import silent
from plannerforge.engine.planners import (
    DebugValues,
    Observation,
    OwnPlanner,
    Plan,
    PlannedTrajectory,
    Planner,
    PlanningTask,
    programs_named,
    run_planner,
    simulate,
)
from plannerforge.engine.planners.external.command import ScenarioFile
from plannerforge.engine.planners.external.program import planner_driver
from plannerforge.engine.planners.traffic.recorded import RecordedTraffic
from plannerforge.schemas.errors import PlannerFailure
from plannerforge.schemas.planning import CommandPlanner, PlannerConfiguration, PlannerDeclaration, RunRequest

from ..harness import Figures, SeededBench, share
from .stepwise_reader import smallest_distance_m, straight_on

EXPECTED = {
    "never_ready": "timed_out",
    "hangs": "timed_out",
    "hangs_with_child": "timed_out",
    "stops_itself": "timed_out",
    "slow": "timed_out",
    "floods@2": "wrong_step",
    "endless_line": "flooded_output",
    "floods_log": "flooded_log",
    "writes_much": "wrote_too_much",
    "exits_at_start": "exit_status",
    "exits_three": "exit_status",
    "leaves@3": "exit_status",
    "takes_memory": "exit_status",
    "dies_at_start": "died",
    "segfaults@2": "died",
    "dies_with_child": "died",
    "closes_input": "closed_input",
    "closes_output": "closed_output",
    "banner": "not_json",
    "garbage": "not_json",
    "empty_line": "not_json",
    "binary": "not_json",
    "nested": "not_json",
    "half@2": "not_json",
    "not_a_number": "not_finite",
    "infinite_cost": "not_finite",
    "next_step": "wrong_step",
    "old_step@2": "wrong_step",
    "answers_twice": "wrong_step",
    "plans_at_once": "wrong_form",
    "ready_again": "wrong_form",
    "other_form": "wrong_form",
    "unknown_field": "wrong_form",
    "negative_step": "wrong_form",
    "different_lengths": "wrong_form",
    "forged_name": "wrong_form",
    "many_names": "wrong_form",
    "large_polygon": "wrong_form",
    "endless_plan": "wrong_form",
    "other_protocol": "wrong_protocol",
    "one_state": "too_short",
    "too_short": "too_short",
    "jumps": "contract_broken",
    "elsewhere": "contract_broken",
    "backwards": "contract_broken",
}
"""The behaviours of the program, with the reason for each in docs/own_planner.md."""
_LIMITS = {"start_time_s": 2.0, "step_time_s": 1.5, "time_s": 3.0, "memory_mb": 256, "folder_mb": 4, "output_mb": 1}
_LONGEST_S = _LIMITS["start_time_s"] + _LIMITS["time_s"]
"""The limits of each program, and the longest wait of a run for it."""
_MARKER = "PROTOCOL_BENCH"
"""A variable that identifies the processes of this measurement."""
_SPEED_MPS, _SECONDS, _LANE_M, _LANES = 10.0, 20, 3.5, 5
_GOAL = (110.0, 140)
"""Start of the goal on the synthetic road in m, and its last time step."""
_USERS, _FIRST_M, _SPACING_M = 40, 8.0, 7.0
"""Number of road users in sight of the ego, their initial distance ahead, and their spacing in a lane."""
_ROUNDS = 20
"""Repeats of the drive: with 37 planning steps, 740 differences."""


def measure(bench: SeededBench) -> Figures:
    """Measure the keys above."""
    folder = bench.folder("protocol")
    empty, full = folder / "empty.xml", folder / "full.xml"
    empty.write_text(_road(0), encoding="utf-8")
    full.write_text(_road(_USERS), encoding="utf-8")
    kinds = dict(list(EXPECTED.items())[: bench.limit])
    named, beyond_s = [], [0.0]
    for behaviour, reason in kinds.items():
        began = perf_counter()
        told = _reason(behaviour, empty, str(folder))
        beyond_s.append(perf_counter() - began - _LONGEST_S)
        named.append(told == reason)
        if told != reason:
            sys.stderr.write(f"{behaviour}: {told or 'no failure'} instead of {reason}\n")
    class_ms, program_ms = _step_ms(full)
    return {
        "protocol_named": share(named),
        "protocol_kinds": len(kinds),
        "protocol_slowest_s": round(max(beyond_s), 2),
        "protocol_left": len(list(_left(str(folder)))),
        "protocol_step_ms": round(median(np.subtract(program_ms, class_ms).tolist()), 3),
        "protocol_program_ms": round(median(program_ms), 3),
        "protocol_class_ms": round(median(class_ms), 3),
    }


def _reason(behaviour: str, path: Path, marker: str) -> str:
    """Return the reason by which the run of a program fails; empty if it does not fail."""
    program = Path(__file__).with_name("stepwise_program.py")
    declared = CommandPlanner(
        summary=f"a program that {behaviour}",
        command=(sys.executable, "-S", str(program), behaviour),
        protocol="stepwise",
        environment={_MARKER: marker},
        **_LIMITS,
    )
    request = RunRequest(
        run_id="run_0", scenario_path=str(path), scenario_id=path.stem, configuration=_configuration("faulty")
    )
    with programs_named({"faulty": declared}):
        try:
            run_planner(request, silent)
        except PlannerFailure as failure:
            return failure.reason
    return ""


def _configuration(planner: str) -> PlannerConfiguration:
    return PlannerConfiguration(config_id="cfg_bench", planner=planner, name=planner, preset="Default", weights={})


def _left(marker: str) -> Iterator[psutil.Process]:
    """Yield processes that were started with a marker among their variables and still run."""
    for process in psutil.process_iter(["environ", "status"]):
        variables = process.info["environ"] or {}
        if variables.get(_MARKER) == marker and process.info["status"] != psutil.STATUS_ZOMBIE:
            yield process


class _Straight:
    """The class; see ``stepwise_reader.py`` for the same as a program."""

    def reset(self, task: PlanningTask) -> None:
        """Prepare for a new run."""
        self.task, self.observations = task, list[Observation]()

    def plan(self, observation: Observation) -> Plan:
        """Look for the smallest distance to others, and go straight on."""
        self.observations.append(observation)
        ego = observation.ego
        x, y = (float(one) for one in ego.position)
        x_m, y_m = straight_on(x, y, ego.heading_rad, ego.speed_mps, self.task.step_s)
        others = [(one.positions[:, 0], one.positions[:, 1]) for one in observation.obstacles]
        count = len(x_m)
        trajectory = PlannedTrajectory(
            np.column_stack([x_m, y_m]), np.full(count, ego.heading_rad), np.full(count, ego.speed_mps), np.zeros(count)
        )
        return Plan(trajectory, debug=DebugValues({"distance_m": smallest_distance_m(x_m, y_m, others)}))


def _step_ms(path: Path) -> tuple[list[float], list[float]]:
    """Return the times of every planning step in ms, of the class and of the program."""
    loaded = read_recorded(path).loaded
    straight = _Straight()
    made = OwnPlanner(lambda: straight, PlannerDeclaration(summary="goes straight on"))
    command = (sys.executable, str(Path(__file__).with_name("stepwise_reader.py")))
    declared = CommandPlanner(summary="goes straight on", command=command, protocol="stepwise")
    file = ScenarioFile(path, path.stem)
    with (
        _before_all_others(),
        planner_driver("inside", made, file) as inside,
        planner_driver("outside", declared, file) as outside,
    ):
        simulate(
            loaded.scenario,
            loaded.problem(None),
            _configuration("inside"),
            inside,
            "constant_velocity",
            silent,
            RecordedTraffic.of(loaded),
        )
        task, seen = straight.task, tuple(straight.observations)
        if any(len(one.obstacles) != _USERS for one in seen):
            raise RuntimeError(f"some of the {_USERS} road users are out of sight at a step")
        inside.reset(task)
        outside.reset(task)
        times: tuple[list[float], list[float]] = ([], [])
        for observation in _ROUNDS * seen:
            for planner, taken in zip((inside, outside), times, strict=True):
                taken.append(_plan_ms(planner, observation))
    return times


@contextmanager
def _before_all_others() -> Iterator[None]:
    """Give this process, and those that it starts meanwhile, priority over all others, if permitted."""
    if not hasattr(os, "sched_setscheduler"):
        yield
        return
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(os.sched_get_priority_min(os.SCHED_FIFO)))
    try:
        yield
    finally:
        os.sched_setscheduler(0, *before)


def _plan_ms(planner: Planner, observation: Observation) -> float:
    began = perf_counter()
    planner.plan(observation)
    return 1000 * (perf_counter() - began)


def _road(users: int) -> str:
    """Return a CommonRoad file with a straight five-lane road: the ego in the middle, others ahead on other lanes."""
    lanes = [number for number in range(_LANES) if number != _LANES // 2]
    cars = [
        _car(100 + number, _FIRST_M + _SPACING_M * (number // len(lanes)), lanes[number % len(lanes)])
        for number in range(users)
    ]
    middle_m = (_LANES // 2) * _LANE_M
    goal_m, last_step = _GOAL
    return "\n".join(
        [
            '<?xml version="1.0" encoding="UTF-8"?>',
            '<commonRoad timeStepSize="0.1" commonRoadVersion="2020a" author="bench" affiliation="bench"',
            ' source="bench" benchmarkID="ZAM_Bench-1_1_T-1" date="2020-01-01">',
            "<location><geoNameId>-999</geoNameId><gpsLatitude>999</gpsLatitude><gpsLongitude>999</gpsLongitude>",
            "</location><scenarioTags><highway/></scenarioTags>",
            *(_lane(number) for number in range(_LANES)),
            *cars,
            '<planningProblem id="99"><initialState><position>',
            f"{_point(0.0, middle_m)}</position><orientation><exact>0.0</exact></orientation>",
            f"<time><exact>0</exact></time><velocity><exact>{_SPEED_MPS}</exact></velocity>",
            "<yawRate><exact>0.0</exact></yawRate><slipAngle><exact>0.0</exact></slipAngle></initialState>",
            "<goalState><position><rectangle><length>20.0</length><width>3.0</width><orientation>0.0</orientation>",
            f"<center><x>{goal_m + 10.0}</x><y>{middle_m}</y></center></rectangle></position>",
            f"<time><intervalStart>1</intervalStart><intervalEnd>{last_step}</intervalEnd></time></goalState>",
            "</planningProblem>",
            "</commonRoad>",
        ]
    )


def _point(x_m: float, y_m: float) -> str:
    return f"<point><x>{x_m:.3f}</x><y>{y_m:.3f}</y></point>"


def _lane(number: int) -> str:
    right_m = (number - 0.5) * _LANE_M
    bounds = {
        "leftBound": "".join(_point(x_m, right_m + _LANE_M) for x_m in range(-50, 501, 50)),
        "rightBound": "".join(_point(x_m, right_m) for x_m in range(-50, 501, 50)),
    }
    neighbours = {"adjacentLeft": number + 1, "adjacentRight": number - 1}
    return (
        f'<lanelet id="{number + 1}">'
        + "".join(f"<{name}>{points}</{name}>" for name, points in bounds.items())
        + "".join(
            f'<{name} ref="{other + 1}" drivingDir="same"/>'
            for name, other in neighbours.items()
            if 0 <= other < _LANES
        )
        + "<laneletType>highway</laneletType></lanelet>"
    )


def _car(obstacle_id: int, ahead_m: float, lane: int) -> str:
    def state(name: str, step: int) -> str:
        place = _point(ahead_m + _SPEED_MPS * 0.1 * step, lane * _LANE_M)
        return (
            f"<{name}><position>{place}</position><orientation><exact>0.0</exact></orientation>"
            f"<time><exact>{step}</exact></time><velocity><exact>{_SPEED_MPS}</exact></velocity></{name}>"
        )

    states = "".join(state("state", step) for step in range(1, 10 * _SECONDS))
    return (
        f'<dynamicObstacle id="{obstacle_id}"><type>car</type><shape><rectangle><length>4.5</length>'
        f"<width>1.8</width></rectangle></shape>{state('initialState', 0)}<trajectory>{states}</trajectory>"
        "</dynamicObstacle>"
    )
