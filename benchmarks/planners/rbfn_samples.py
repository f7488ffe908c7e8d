"""Motion primitives as an optimal control problem, for training and judging MP-RBFN's network.

A primitive moves the rear axle of a kinematic single-track model between two states in a given time. In the scale of
the network (``engine/planners/rbfn/network.py``), its states are x, y, ψ, V, K and its controls the changes A of V and
B of K, piecewise constant on 30 intervals. The problem is

    minimise ∫ A² + 0.01 · B² dτ,  with V ≥ 0, |K| ≤ 8 and both ends given,

by direct multiple shooting (one fourth-order Runge–Kutta step per interval) with casadi and IPOPT. Boundary values
resemble those of the planner: a path with evenly changing curvature, an offset from it, initial errors of heading and
curvature, an even change of speed, and up to a tenth more or less distance than this implies. A problem that IPOPT does
not solve is counted and left out.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from plannerforge.engine.geometry import Points, Values
from plannerforge.engine.planners.rbfn.network import PRIMITIVE_INPUTS, PRIMITIVE_NODES

CURVATURE_SHARE = 0.01
"""Chosen: weight of the change in curvature relative to that in speed. A right angle (B² about 10) then equals a
change of speed by a third.
"""
_LARGEST_CURVATURE = 8.0
_MOST_ITERATIONS = 100
_STATES, _CONTROLS = 5, 2
_PATH_POINTS = 200


@dataclass(frozen=True)
class PrimitiveSamples:
    """Solved problems: ``inputs`` (n, 6), bearings to the left, ``states`` (n, 31, 5); and the number of unsolved
    ones.
    """

    inputs: Points
    states: Points
    failures: int

    def save(self, path: Path) -> None:
        """Write them."""
        np.savez(path, inputs=self.inputs, states=self.states, failures=np.array(self.failures))

    @classmethod
    def load(cls, path: Path) -> "PrimitiveSamples":
        """Read a file written by :meth:`save`."""
        with np.load(path) as arrays:
            return cls(arrays["inputs"], arrays["states"], int(arrays["failures"]))


def solved_samples(seed: int, count: int) -> PrimitiveSamples:
    """Return the solutions of ``count`` problems of a seed, at about 5 ms each."""
    solve, choice = PrimitiveProblem(), np.random.default_rng(seed)
    drawn = [drawn_inputs(choice) for _ in range(count)]
    answers = [(inputs, solve(inputs)) for inputs in drawn]
    solved = [(inputs, states) for inputs, states in answers if states is not None]
    inputs, states = (np.array(values) for values in zip(*solved, strict=True))
    return PrimitiveSamples(inputs, states, count - len(solved))


def drawn_inputs(choice: np.random.Generator) -> Values:
    """Return boundary values (6,) of one problem, mirrored if the bearing is to the right."""
    mildness = choice.choice([0.15, 1.0])
    first, last = choice.uniform(-2.0, 2.0, 2) * mildness
    offset, turned, steered = choice.uniform(-1.0, 1.0, 3) * choice.random(3) * (0.5, 0.4, 1.5) * mildness
    share = (np.arange(_PATH_POINTS) + 0.5) / _PATH_POINTS
    heading = np.cumsum(first + (last - first) * share) / _PATH_POINTS
    end = float(heading[-1])
    x = float(np.cos(heading).mean()) - offset * np.sin(end)
    y = float(np.sin(heading).mean()) + offset * np.cos(end)
    chord = float(np.hypot(x, y))
    change, more = choice.uniform(-1.0, 1.0), choice.uniform(0.92, 1.1)
    values = {
        "speed_start": (1.0 - change) * more / chord,
        "curvature_start": (first + steered) * chord,
        "bearing": float(np.arctan2(y, x)) - turned,
        "turn": end - turned,
        "curvature_end": last * chord,
        "speed_end": (1.0 + change) * more / chord,
    }
    inputs = np.array([values[name] for name in PRIMITIVE_INPUTS])
    if inputs[2] < 0.0:
        inputs[1:5] *= -1.0
    return inputs


class PrimitiveProblem:
    """The problem, built once; called with boundary values (6,) it gives the states (31, 5), or None.

    Raises:
        ModuleNotFoundError: casadi is not installed (the extra ``train``).
    """

    def __init__(self) -> None:
        import casadi

        intervals = PRIMITIVE_NODES - 1
        states = casadi.MX.sym("states", _STATES, PRIMITIVE_NODES)
        controls = casadi.MX.sym("controls", _CONTROLS, intervals)
        given = casadi.MX.sym("given", len(PRIMITIVE_INPUTS))
        begin = casadi.vertcat(0, 0, 0, given[0], given[1])
        end = casadi.vertcat(casadi.cos(given[2]), casadi.sin(given[2]), given[3], given[5], given[4])
        reached = _one_interval(casadi).map(intervals)(states[:, :-1], controls)
        gaps = casadi.veccat(states[:, 0] - begin, states[:, 1:] - reached, states[:, -1] - end)
        effort = casadi.sumsqr(controls[0, :]) + CURVATURE_SHARE * casadi.sumsqr(controls[1, :])
        problem = {"x": casadi.veccat(states, controls), "f": effort / intervals, "g": gaps, "p": given}
        quiet = {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": False}
        options = {**quiet, "ipopt.max_iter": _MOST_ITERATIONS, "expand": True}
        self._solver: Any = casadi.nlpsol("primitive", "ipopt", problem, options)
        lowest, highest = (np.full((PRIMITIVE_NODES, _STATES), bound) for bound in (-np.inf, np.inf))
        lowest[:, 3], lowest[:, 4], highest[:, 4] = 0.0, -_LARGEST_CURVATURE, _LARGEST_CURVATURE
        free = np.full(_CONTROLS * intervals, np.inf)
        self._bounds = np.concatenate([lowest.ravel(), -free]), np.concatenate([highest.ravel(), free])

    def __call__(self, inputs: Values) -> Points | None:
        """Return the states of the best motion, from the straight line as a first guess."""
        first, bend, bearing, turn, last_bend, last = inputs.tolist()
        begin = np.array([0.0, 0.0, 0.0, first, bend])
        end = np.array([np.cos(bearing), np.sin(bearing), turn, last, last_bend])
        line = begin + (end - begin) * np.linspace(0.0, 1.0, PRIMITIVE_NODES)[:, None]
        changes = np.tile((end - begin)[3:], PRIMITIVE_NODES - 1)
        lowest, highest = self._bounds
        guess = np.concatenate([line.ravel(), changes])
        answer = self._solver(x0=guess, p=inputs, lbx=lowest, ubx=highest, lbg=0.0, ubg=0.0)
        if not self._solver.stats()["success"]:
            return None
        found = np.asarray(answer["x"], dtype=float).ravel()
        return found[: PRIMITIVE_NODES * _STATES].reshape(PRIMITIVE_NODES, _STATES)


def _one_interval(casadi: Any) -> Any:
    """Return the states after one interval of constant controls."""
    state, control = casadi.MX.sym("state", _STATES), casadi.MX.sym("control", _CONTROLS)
    heading, speed, bend = state[2], state[3], state[4]
    change = casadi.vertcat(speed * casadi.cos(heading), speed * casadi.sin(heading), speed * bend, control)
    slope = casadi.Function("slope", [state, control], [change])
    step = 1.0 / (PRIMITIVE_NODES - 1)
    one = slope(state, control)
    two = slope(state + step / 2 * one, control)
    three = slope(state + step / 2 * two, control)
    four = slope(state + step * three, control)
    return casadi.Function("interval", [state, control], [state + step / 6 * (one + 2 * two + 2 * three + four)])
