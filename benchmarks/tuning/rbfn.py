"""Measures the quality of MP-RBFN's primitives, and compares the planner with Frenetix.

**Primitives.** Problems of a seed outside the training (``planners/rbfn_samples.py``) are scaled to driving: each gets
a duration of 1 to 3 s and a mean speed of 2 to 20 m/s. The judge integrates the network's curvatures and speeds at
nodes by its own Runge–Kutta method, and compares the end with the requested one: this is the miss before the primitive
is closed. The angle between heading and motion shows how far closing moves a primitive away from the single-track
model. Times are processor times of one thread for 1,000 primitives of 31 states to different ends, in 11 durations, at
once: of the network, of analytic quintics in x and y between the same boundary values (position, velocity,
acceleration), and of the solver, one problem after the other.

**Planner.** MP-RBFN and Frenetix, each with ``Default``, on every public scenario with ``ground_truth``; runs on
unsolvable problems are in no share. ``planners/acting_weights.py`` judges whether each weight acts, and
``check_planner`` tests the contract on what the planner saw at every step of some drives.

Keys:

- ``rbfn_end_error_m``: mean miss of the ends in m; ``_95``: 95th percentile; ``rbfn_end_heading_rad`` and ``_95``
  likewise.
- ``rbfn_known``: share of the problems within the network's range, to which these figures refer.
- ``rbfn_slip_rad_95``: the largest angle between heading and motion of a closed primitive, 95th percentile.
- ``rbfn_us_per_primitive``, ``quintic_us_per_primitive``, ``solver_us_per_primitive``: µs for one of 1,000.
- ``rbfn_success``, ``frenetix_success``: share of the solvable problems that reach the goal; ``rbfn_solvable``: their
  number.
- ``rbfn_points``: the difference in percentage points, with a bootstrapped 95 % interval (``_low``, ``_high``).
- ``rbfn_weights_acting``: number of its acting weights.
- ``rbfn_breaches``: its breaches of the contract, in ``rbfn_asked`` situations.
"""

import time
from collections.abc import Callable, Mapping
from pathlib import Path

import anyio
import numpy as np
from mcp import Client

from plannerforge.engine.commonroad import read_scenario
from plannerforge.engine.execution import silent
from plannerforge.engine.geometry import Points, Values
from plannerforge.engine.planners import Observation, Plan, PlanningTask, check_planner, make_planner, simulate
from plannerforge.engine.planners.rbfn.network import PrimitiveEnds, PrimitiveNetwork, motion_primitives
from plannerforge.evals.scoring.common import built_in
from plannerforge.server.assembly import create_server

from ..harness import (
    Figures,
    LeftOut,
    SeededBench,
    attempted_runs,
    drawn,
    finished_batch,
    import_scenarios,
    percentile_95,
    scenario_files,
    settings_for,
    share,
)
from ..planners.acting_weights import acting_weights
from ..planners.rbfn_samples import PrimitiveProblem, drawn_inputs
from ..planners.rbfn_training import HELD_OUT, HELD_OUT_SEED

CONFIGS = ("mp_rbfn:Default", "frenetix:Default")
SITUATIONS, CHECKED = 12, 5
"""Number of scenarios with a start that tests which weights act and the contract (chosen)."""
_SECONDS, _SPEEDS_MPS = (1.0, 3.0), (2.0, 20.0)
_GRID_S = 0.2
"""Timed durations are multiples of it: a planner samples few of them, and the network's cost grows with their number
(chosen).
"""
_TIMED, _SOLVED, _STATES = 1000, 100, 31
_SUBSTEPS = 20
"""Steps of the integration between two nodes."""
_REPEATS = 20
_DRAWS = 4000
"""Draws of the bootstrap (chosen)."""


def measure(bench: SeededBench) -> Figures:
    """Measure the keys above; a limit restricts the numbers of primitives and scenarios.

    Raises:
        LeftOut: casadi is not installed.
    """
    try:
        solve = PrimitiveProblem()
    except ModuleNotFoundError as error:
        raise LeftOut("the optimal control problem needs casadi (install the extra train)") from error
    files = scenario_files(bench.shared / "data" / "commonroad", bench.limit)
    chosen = [path for path in files if path.name in set(drawn((one.name for one in files), SITUATIONS))]
    acting = acting_weights(built_in(CONFIGS[0]), [read_scenario(path) for path in chosen])
    asked = [situation for path in chosen[:CHECKED] for situation in _situations(path)]
    breaches = [breach for one in asked for breach in check_planner(lambda: make_planner("mp_rbfn"), *one)]
    return {
        **_primitives(solve, bench.seed, bench.limit or HELD_OUT),
        **anyio.run(_planners, bench),
        "rbfn_weights_acting": len(acting),
        "rbfn_breaches": len(breaches),
        "rbfn_asked": len(asked),
    }


class _Recorder:
    """MP-RBFN with a record of its inputs."""

    def __init__(self) -> None:
        self._planner = make_planner("mp_rbfn")
        self.asked: list[tuple[PlanningTask, Observation]] = []

    def reset(self, task: PlanningTask) -> None:
        """Prepare for a new run."""
        self._task = task
        self._planner.reset(task)

    def plan(self, observation: Observation) -> Plan:
        """Return the planner's plan."""
        self.asked.append((self._task, observation))
        return self._planner.plan(observation)


def _situations(path: Path) -> list[tuple[PlanningTask, Observation]]:
    """Return MP-RBFN's inputs during a scenario."""
    loaded, recorder = read_scenario(path), _Recorder()
    simulate(loaded.scenario, loaded.problem(), built_in(CONFIGS[0]), recorder, "constant_velocity", silent)
    return recorder.asked


def _primitives(solve: PrimitiveProblem, seed: int, count: int) -> dict[str, float]:
    """Return errors and times."""
    network, choice = PrimitiveNetwork.shipped(), np.random.default_rng(HELD_OUT_SEED)
    inputs = np.array([drawn_inputs(choice) for _ in range(count)])
    choice = np.random.default_rng(seed)
    duration_s = choice.uniform(*_SECONDS, count)
    chord_m = duration_s * choice.uniform(*_SPEEDS_MPS, count) * 2 / (inputs[:, 0] + inputs[:, 5])
    known = network.knows(inputs)
    inputs, duration_s, chord_m = inputs[known], duration_s[known], chord_m[known]
    x, y, heading = _driven(*network.profiles(inputs))
    away_m = chord_m * np.hypot(x - np.cos(inputs[:, 2]), y - np.sin(inputs[:, 2]))
    turned_rad = np.abs(heading - inputs[:, 3])
    slips_rad = [_largest_slip_rad(network, *one) for one in zip(inputs, duration_s, chord_m, strict=True)]
    return {
        "rbfn_end_error_m": round(float(away_m.mean()), 5),
        "rbfn_end_error_m_95": round(percentile_95(away_m.tolist()), 5),
        "rbfn_end_heading_rad": round(float(turned_rad.mean()), 6),
        "rbfn_end_heading_rad_95": round(percentile_95(turned_rad.tolist()), 6),
        "rbfn_known": share(known.tolist()),
        "rbfn_slip_rad_95": round(percentile_95(slips_rad), 5),
        **_times(network, solve, inputs, duration_s, chord_m),
    }


def _driven(curvature: Points, speed: Points) -> tuple[Values, Values, Values]:
    """Return the end poses (x, y, heading) of rear axles with scaled curvatures and speeds (n, 31), linear between
    nodes.
    """
    nodes, count = np.linspace(0.0, 1.0, curvature.shape[1]), (curvature.shape[1] - 1) * _SUBSTEPS
    state, step = np.zeros((3, len(curvature))), 1.0 / count

    def slope(tau: float, now: Points) -> Points:
        left = min(int(tau * (len(nodes) - 1)), len(nodes) - 2)
        part = tau * (len(nodes) - 1) - left
        bend = curvature[:, left] * (1 - part) + curvature[:, left + 1] * part
        pace = speed[:, left] * (1 - part) + speed[:, left + 1] * part
        return np.stack([pace * np.cos(now[2]), pace * np.sin(now[2]), pace * bend])

    for index in range(count):
        tau = index * step
        one = slope(tau, state)
        two = slope(tau + step / 2, state + step / 2 * one)
        three = slope(tau + step / 2, state + step / 2 * two)
        four = slope(tau + step, state + step * three)
        state = state + step / 6 * (one + 2 * two + 2 * three + four)
    return state[0], state[1], state[2]


def _ends(inputs: Points, duration_s: Values, chord_m: Values) -> PrimitiveEnds:
    """Return the ends of scaled problems in metres and seconds."""
    return PrimitiveEnds(
        duration_s=duration_s,
        x_m=chord_m * np.cos(inputs[:, 2]),
        y_m=chord_m * np.sin(inputs[:, 2]),
        turn_rad=inputs[:, 3],
        curvature_per_m=inputs[:, 4] / chord_m,
        speed_mps=inputs[:, 5] * chord_m / duration_s,
    )


def _largest_slip_rad(network: PrimitiveNetwork, inputs: Values, duration_s: float, chord_m: float) -> float:
    """Return the largest angle between the heading and the motion of a closed primitive, in steps of 5 ms."""
    times = np.arange(0.0, duration_s, 0.005)
    ends = _ends(inputs[None], np.array([duration_s]), np.array([chord_m]))
    made, _ = motion_primitives(network, inputs[0] * chord_m / duration_s, inputs[1] / chord_m, ends, times)
    x, y, heading = np.diff(made.x_m[0]), np.diff(made.y_m[0]), made.heading_rad[0]
    moves = np.hypot(x, y) > 1e-3
    off = np.arctan2(y, x) - (heading[1:] + heading[:-1]) / 2
    return float(np.abs(np.angle(np.exp(1j * off[moves]))).max(initial=0.0))


def _times(
    network: PrimitiveNetwork, solve: PrimitiveProblem, inputs: Points, duration_s: Values, chord_m: Values
) -> dict[str, float]:
    """Return processor time in µs for one of 1,000 primitives with the same start, by the three methods."""
    rows = np.resize(np.arange(len(inputs)), _TIMED)
    ends = _ends(inputs[rows], np.round(duration_s[rows] / _GRID_S) * _GRID_S, chord_m[rows])
    first, bend = float(np.median(inputs[:, 0] * chord_m / duration_s)), float(np.median(inputs[:, 1] / chord_m))
    times = np.linspace(0.0, _SECONDS[1], _STATES)
    solved = inputs[:_SOLVED]

    def solver() -> None:
        for one in solved:
            solve(one)

    return {
        "rbfn_us_per_primitive": _us(lambda: motion_primitives(network, first, bend, ends, times), _TIMED, _REPEATS),
        "quintic_us_per_primitive": _us(lambda: _quintics(first, bend, ends, times), _TIMED, _REPEATS),
        "solver_us_per_primitive": _us(solver, len(solved), 1),
    }


def _us(make: Callable[[], object], count: int, repeats: int) -> float:
    """Return the best processor time of some repeats per primitive, in µs."""
    taken = []
    for _ in range(repeats):
        began = time.process_time()
        make()
        taken.append(time.process_time() - began)
    return round(min(taken) / count * 1e6, 2)


def _quintics(speed_mps: float, curvature: float, ends: PrimitiveEnds, times_s: Values) -> Mapping[str, Points]:
    """Return quintic polynomials in x and y to n ends, at m times: position, heading, speed and curvature, each (n, m).

    The accelerations at both ends are only the lateral ones, curvature · speed². The coefficients of a quintic between
    two positions, velocities and accelerations are in Takahashi et al., "Local path planning and motion control for AGV
    in positioning" (IROS 1989).
    """
    total = ends.duration_s
    cos, sin = np.cos(ends.turn_rad), np.sin(ends.turn_rad)
    across = ends.curvature_per_m * ends.speed_mps**2
    tau = np.minimum(times_s[None] / total[:, None], 1.0)
    powers = tau[..., None] ** np.arange(6)
    derivatives = []
    for begin, end in (
        ((0.0, speed_mps, 0.0), (ends.x_m, ends.speed_mps * cos, -across * sin)),
        ((0.0, 0.0, curvature * speed_mps**2), (ends.y_m, ends.speed_mps * sin, across * cos)),
    ):
        velocity, acceleration = begin[1] * total, begin[2] * total**2 / 2
        place = end[0] - begin[0] - velocity - acceleration
        pace = end[1] * total - velocity - 2 * acceleration
        change = end[2] * total**2 / 2 - acceleration
        rest = (10 * place - 4 * pace + change, -15 * place + 7 * pace - 2 * change, 6 * place - 3 * pace + change)
        rows = np.stack([np.broadcast_to(begin[0], total.shape), velocity, acceleration, *rest], axis=1)
        orders = np.arange(1, 6)
        faster = rows[:, 1:] * orders / total[:, None]
        derivatives.append(
            (
                np.einsum("nmk,nk->nm", powers, rows),
                np.einsum("nmk,nk->nm", powers[..., :5], faster),
                np.einsum("nmk,nk->nm", powers[..., :4], faster[:, 1:] * orders[:4] / total[:, None]),
            )
        )
    (x, x_1, x_2), (y, y_1, y_2) = derivatives
    speed = np.hypot(x_1, y_1)
    bend = (x_1 * y_2 - y_1 * x_2) / np.maximum(speed, 1e-6) ** 3
    return {"x_m": x, "y_m": y, "heading_rad": np.arctan2(y_1, x_1), "speed_mps": speed, "curvature_per_m": bend}


async def _planners(bench: SeededBench) -> dict[str, float]:
    """Compare both planners with a known future."""
    folder = bench.scratch / "rbfn"
    async with Client(create_server(settings_for(folder, bench.shared, 2))) as client:
        await import_scenarios(client, scenario_files(bench.shared / "data" / "commonroad", bench.limit))
        batch_id = await finished_batch(
            client, scenarios=["preset:500"], configs=list(CONFIGS), prediction="ground_truth"
        )
    reached = {name: _reached(folder, batch_id, name) for name in CONFIGS}
    own, other = (reached[name] for name in CONFIGS)
    flips = np.array([float(own[name]) - other[name] for name in sorted(own.keys() & other.keys())])
    draws = np.random.default_rng(bench.seed).choice(flips, (_DRAWS, len(flips))).mean(axis=1)
    low, high = np.quantile(draws, (0.025, 0.975))
    return {
        "rbfn_success": share(own.values()),
        "frenetix_success": share(other.values()),
        "rbfn_solvable": len(own),
        "rbfn_points": round(100 * float(flips.mean()), 2),
        "rbfn_points_low": round(100 * float(low), 2),
        "rbfn_points_high": round(100 * float(high), 2),
    }


def _reached(folder: Path, batch_id: str, config: str) -> dict[str, bool]:
    """Return by scenario whether a configuration reached the goal, if the problem is solvable."""
    wanted = built_in(config).config_id
    own = [one for one in attempted_runs(folder, batch_id) if one.config_id == wanted]
    return {one.scenario_id: one.outcome == "goal_reached" for one in own}
