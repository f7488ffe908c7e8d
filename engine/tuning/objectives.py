"""The objectives of a search for a configuration, and the constraints that it must satisfy.

Every measure is a number from 0 to 1 per run, so that sums are comparable between sets of scenarios. A run that does
not reach its goal has no comfort and the worst time, so no configuration gains by failing early.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean

from ...schemas.errors import InvalidRequest, UnknownName, closest
from ...schemas.runs import RunRecord
from ...schemas.text import quoted

_HALF_COMFORT = 4.0
"""Mean squared jerk in m²/s⁶ at which comfort is one half (chosen: 2 m/s³ throughout)."""
_HALF_TIME_S = 10.0
"""Duration at which time is one half (chosen: about the length of a public scenario)."""
_MOST_RISK = 5
"""Risk scores range from 0 (collision) to 5."""


@dataclass(frozen=True)
class _Measure:
    """A measure of a run; ``sign`` is 1 if more is better, and −1 if less is better."""

    sign: int
    of: Callable[[RunRecord], float]


def _reached(run: RunRecord) -> bool:
    return run.outcome == "goal_reached"


def _collided(run: RunRecord) -> bool:
    return run.outcome == "collision"


def _risk(run: RunRecord) -> float:
    if _collided(run) or run.outcome == "off_road":
        return 1.0
    score = None if run.metrics is None else run.metrics.risk_score
    return 0.0 if score is None else 1 - score / _MOST_RISK


def _comfort(run: RunRecord) -> float:
    if not _reached(run) or run.metrics is None:
        return 0.0
    return 1 / (1 + run.metrics.mean_squared_jerk / _HALF_COMFORT)


def _time(run: RunRecord) -> float:
    if not _reached(run) or run.metrics is None:
        return 1.0
    return run.metrics.duration_s / (run.metrics.duration_s + _HALF_TIME_S)


_MEASURES: Mapping[str, _Measure] = {
    "success": _Measure(1, lambda run: float(_reached(run))),
    "collisions": _Measure(-1, lambda run: float(_collided(run))),
    "risk": _Measure(-1, _risk),
    "comfort": _Measure(1, _comfort),
    "time": _Measure(-1, _time),
}
_NUMBER = r"\d+(?:\.\d*)?|\.\d+"
_TERM = re.compile(rf"(?P<name>[A-Za-z_]+)(?:\s*\*\s*(?P<factor>{_NUMBER}))?")
_ROUGH_BOUND = re.compile(r"(?P<name>[A-Za-z_]+)\s*(?P<operator>[<>])\s*(?P<bound>base|0(?:\.\d*)?|\.\d+|1(?:\.0*)?)")
"""A bound with < or >, which stands for <= or >=."""
_BOUND = re.compile(rf"(?P<name>[A-Za-z_]+)\s*(?P<operator>>=|<=)\s*(?P<bound>base|{_NUMBER})")


@dataclass(frozen=True)
class Objective:
    """A measure with its weight in a sum."""

    name: str
    factor: float

    def score(self, run: RunRecord) -> float:
        """Return the run's part of the sum; higher is better."""
        measure = _MEASURES[self.name]
        return self.factor * measure.sign * measure.of(run)


@dataclass(frozen=True)
class Constraint:
    """A bound on the mean of a measure; ``bound`` None means the base's own mean on the same scenarios."""

    name: str
    is_least: bool
    bound: float | None

    def holds(self, runs: Sequence[RunRecord], base: Sequence[RunRecord]) -> bool:
        """Return True if a candidate's runs satisfy the constraint, given the base's runs on the same scenarios."""
        if not runs:
            return True
        mean = fmean(_MEASURES[self.name].of(run) for run in runs)
        bound = fmean(_MEASURES[self.name].of(run) for run in base) if self.bound is None else self.bound
        return mean >= bound - 1e-12 if self.is_least else mean <= bound + 1e-12


def parse_objective(text: str) -> Objective:
    """Parse an objective such as ``success`` or ``comfort*0.2``.

    Raises:
        InvalidRequest: The text is malformed.
        UnknownName: There is no such measure.
    """
    found = _TERM.fullmatch(text.strip())
    if found is None:
        raise InvalidRequest(f"{quoted(text)} is not an objective", valid=["success", "comfort*0.2"])
    return Objective(_known(found["name"]), float(found["factor"] or 1.0))


def parse_constraint(text: str) -> Constraint:
    """Parse a constraint such as ``success>=base`` or ``collisions<=0.1``.

    Raises:
        InvalidRequest: The text is malformed.
        UnknownName: There is no such measure.
    """
    found = _BOUND.fullmatch(text.strip())
    if found is None:
        rough = _ROUGH_BOUND.fullmatch(text.strip())
        meant = [f"{rough['name']}{rough['operator'][0]}={rough['bound']}"] if rough else []
        raise InvalidRequest(
            f"{quoted(text)} is not a constraint; a constraint bounds a mean from 0 to 1 with >= or <=",
            valid=[*meant, "success>=base", "collisions<=0.1"],
            given=text,
        )
    name, is_least = _known(found["name"]), found["operator"] == ">="
    bound = None if found["bound"] == "base" else float(found["bound"])
    if bound is not None and bound > 1.0:
        raise InvalidRequest(
            f"{quoted(text)} is out of range: {name} is from 0 to 1",
            valid=[f"{name}{found['operator']}{'base' if is_least else '1'}", f"{name}{found['operator']}0.9"],
            given=text,
        )
    return Constraint(name, is_least, bound)


def _known(name: str) -> str:
    if name.lower() in _MEASURES:
        return name.lower()
    raise UnknownName(f"there is no measure {quoted(name)}", valid=closest(name, _MEASURES) or list(_MEASURES))
