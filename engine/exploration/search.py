"""A search for failures in a stratified space; it knows nothing of roads, so it can search a space of any kind.

The space is divided into *strata*, each with parameters of its own in [0, 1]. The search proposes points in batches
(``ask``) and learns their scores (``tell``). Its proposals depend only on its strata, its seed and the scores, which it
receives in the order of the proposals. An interrupted search therefore continues by telling the stored scores again
(``resumed``), and several workers may evaluate a batch.

There are four ways to propose a point:

* ``start``: the next point of a scrambled Sobol sequence, in the stratum with the fewest points;
* ``demand``: a point at which the planner has to react and could, far from the known points: its drive through the
  unchanged base would collide there, and a careful driver would not. A planner that overlooks a rare counterpart shows
  nothing before it fails, so that no score leads there; these points have to be covered evenly;
* ``descend``: from the best point of a promising stratum towards a lower score;
* ``spread``: from a known failure to a different one next to it.

The last three consult a model of the stratum, a Gaussian process (Rasmussen and Williams, 2006, chapter 2) with a
Matérn 5/2 kernel. ``descend`` takes the candidate with the lowest confidence bound (Srinivas and others, 2010), and
``spread`` the one with the largest product of its probability to fail and its distance from known failures. Both leave
a cell after enough hits (``HITS_TO_LEAVE``). ``demand`` takes the largest product of the probability that the planner
has to react and the distance from all known points. A stratum has few parameters and a search has few evaluations, so a
model is better here than an evolution strategy: ``python -m benchmarks.failures.landscapes`` measures it.

After the start in every stratum, one of the ways is drawn; its probability grows with the number of cells that it
found recently.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
from scipy.stats import qmc

from ..geometry import Values
from .archive import Archive, Hit

Way = Literal["start", "demand", "descend", "spread"]
BATCH: Final = 4
"""Points of a batch (chosen): a larger batch keeps more workers busy, but its points know less of each other. On the
landscapes of the benchmark, 8 find as many cells as 4, but fewer of the rare failures (70 instead of 85 %)."""
_STARTS: Final = 3
"""Points in every stratum before the other ways are used (chosen on landscapes: 2 miss more of the rare failures)."""
_IMPLAUSIBLE_SHARE: Final = 1.0 / 3.0
"""An implausible point counts as this share of a point of its stratum: it costs no run (chosen)."""
_IDLE_SHARE: Final = 0.25
"""A point at which the planner need not react counts as this share of one at which it has to (chosen)."""
_LEAST_SHARE: Final = 0.1
"""The least share of the proposals of each way (chosen)."""
_FORGETTING: Final = 0.05
"""The weight of the newest proposal in the success of its way (chosen: a memory of about twenty proposals)."""
_NEW_CELL, _OTHERWISE = 3.0, 0.02
"""The success of a proposal that finds a new cell, and of any other one (chosen)."""
_RANK_CHANCE: Final = 0.35
"""The chance that ``descend`` takes the most promising stratum; each following one gets the same share of the rest."""
_STAGNATION: Final = 0.05
"""What a proposal of ``descend`` without progress adds to the score of its stratum (chosen)."""
_STEPS: Final = ((100, 0.15), (50, 0.05))
"""Candidates of ``descend``: how many, and their standard deviation around the best point; others are uniform."""
_UNIFORM: Final = 100
_SPREADS: Final = ((60, 0.08), (60, 0.16), (60, 0.32))
"""Candidates of ``spread``: how many, and their standard deviation around a known failure."""
_DEMANDS: Final = 0.75
"""A larger demand means that the planner has to react and could."""
_DEMANDING: Final = 200
"""Candidates of ``demand``, all uniform."""
_FAR: Final = 0.4
"""A larger distance from the known failures counts as this one."""
_FAILED, _LEFT = -0.1, 0.5
"""The values of failures in the model: in a cell that is still sought, and in one that the search has left."""
_LARGEST: Final = 1.0
"""Scores are cut off here in the model, so that far points do not stretch its scale."""
_BAD_PENALTY: Final = 1.5
"""What a candidate next to an implausible point adds to its bound, in standard deviations of the scores."""
_MOST_MODELLED: Final = 80
"""A model uses this many points, those nearest to its candidates."""
_LENGTHS: Final = (0.2, 0.4, 0.8)
"""Length scales of which the model takes the most likely one."""
_NOISE: Final = 1e-3
_DECIMALS: Final = 6
"""Proposals are rounded, so that a stored point is the proposed one."""


@dataclass(frozen=True)
class Stratum:
    """A part of the space; ``dimensions`` is the number of its parameters."""

    name: str
    dimensions: int


@dataclass(frozen=True)
class Point:
    """A proposal: its stratum, its parameters in [0, 1], and how it was chosen."""

    stratum: str
    values: tuple[float, ...]
    way: Way = "start"


@dataclass(frozen=True)
class Score:
    """The score of a point; lower scores are nearer to a failure. ``value``: 0 at the edge of failing, 1 if nothing
    comes near; None if the planner was not run, which costs no run: the point is implausible, or, if its demand is
    known, the planner need not react there. ``cell``: the cell of the failure, if it is a failure of the kind that
    the search looks for; otherwise None. ``demand``: 1 if the planner has to react there and could, 0.5 if it could
    not, 0 if it need not; None if unknown.
    """

    value: float | None
    cell: str | None = None
    demand: float | None = None


@dataclass
class _Known:
    """The search's knowledge of a stratum: its plausible points, its implausible points, and its Sobol sequence.

    ``idle``: points that were not run because the planner need not react there. ``demands``: known demands by point.
    """

    stratum: Stratum
    sequence: qmc.Sobol
    points: list[Values] = field(default_factory=list)
    scores: list[Score] = field(default_factory=list)
    implausible: list[Values] = field(default_factory=list)
    idle: list[Values] = field(default_factory=list)
    demands: list[tuple[Values, float]] = field(default_factory=list)
    pending: list[Values] = field(default_factory=list)
    stagnant: int = 0

    @property
    def weight(self) -> float:
        """The number of points that count as examined in the stratum."""
        return len(self.points) + len(self.pending) + _IMPLAUSIBLE_SHARE * len(self.implausible)

    @property
    def demanding(self) -> float:
        """The number of points that count as examined where the planner has to react."""
        reacts = sum(demand > _DEMANDS for _, demand in self.demands)
        others = len(self.points) + len(self.idle) + len(self.implausible) - reacts
        return reacts + len(self.pending) + _IDLE_SHARE * others

    @property
    def best(self) -> int | None:
        """The index of the best point that is not a failure, or None."""
        open_points = [index for index, score in enumerate(self.scores) if score.cell is None]
        return min(open_points, key=lambda index: (_value(self.scores[index]), index)) if open_points else None


class FailureSearch:
    """A search; ``archive`` contains the failures that it found, by cell.

    Args:
        strata: the parts of the space, at least one.
        seed: the seed of every choice.
        batch: the number of points of a proposal.
    """

    def __init__(self, strata: Sequence[Stratum], seed: int, batch: int = BATCH) -> None:
        self.archive: Archive[Point] = Archive()
        self.evaluated = self.runs = 0
        self._random, self._batch = np.random.default_rng(seed), batch
        self._known = {
            stratum.name: _Known(
                stratum, qmc.Sobol(stratum.dimensions, scramble=True, rng=np.random.default_rng((seed, index)))
            )
            for index, stratum in enumerate(strata)
        }
        self._success: dict[Way, float] = {"start": 1.0, "demand": 1.0, "descend": 1.0, "spread": 1.0}
        self._varied: dict[str, int] = {}
        self._asked: list[tuple[Point, float]] = []

    def ask(self) -> list[Point]:
        """Return the next batch; tell its scores before you ask for another batch."""
        if self._asked:
            raise RuntimeError("the scores of the last batch have not been told")
        for _ in range(self._batch):
            point, parent = self._proposal()
            self._known[point.stratum].pending.append(np.array(point.values))
            self._asked.append((point, parent))
        return [point for point, _ in self._asked]

    def tell(self, scores: Sequence[Score]) -> None:
        """Receive the scores of the last batch, in the order of its points."""
        if len(scores) != len(self._asked):
            raise RuntimeError(f"{len(self._asked)} scores are expected, not {len(scores)}")
        asked, self._asked = self._asked, []
        for known in self._known.values():
            known.pending.clear()
        for (point, parent), score in zip(asked, scores, strict=True):
            self._learn(point, parent, score)

    def resumed(self, scores: Sequence[Score]) -> "FailureSearch":
        """Receive the stored scores of whole batches again, and return the search itself."""
        for begin in range(0, len(scores) - self._batch + 1, self._batch):
            self.ask()
            self.tell(scores[begin : begin + self._batch])
        return self

    def _learn(self, point: Point, parent: float, score: Score) -> None:
        known, number = self._known[point.stratum], self.evaluated
        self.evaluated += 1
        if score.demand is not None:
            known.demands.append((np.array(point.values), score.demand))
        if score.value is None:
            (known.implausible if score.demand is None else known.idle).append(np.array(point.values))
            return
        self.runs += 1
        known.points.append(np.array(point.values))
        known.scores.append(score)
        is_new = score.cell is not None and self.archive.add(score.cell, Hit(number, score.value, point))
        if is_new:
            known.stagnant = 0
        elif point.way == "descend":
            known.stagnant = max(known.stagnant - 2, 0) if score.value < parent else known.stagnant + 1
        success = _NEW_CELL if is_new else _OTHERWISE
        kept = (1.0 - _FORGETTING) * self._success[point.way] + _FORGETTING * success
        self._success[point.way] = max(kept, _OTHERWISE)

    def _proposal(self) -> tuple[Point, float]:
        """Return a point, and the score of the point from which it was derived."""
        least = min(self._known.values(), key=lambda known: known.weight)
        if least.weight >= _STARTS:  # a stratum with more parameters needs more points
            least = min(self._known.values(), key=lambda known: known.weight / known.stratum.dimensions)
        way = self._way() if least.weight >= _STARTS else "start"
        if way == "descend":
            found = self._descent()
            if found is not None:
                return found
        elif way == "spread":
            return self._variation(), 0.0
        elif way == "demand":
            return self._reaction(), _LARGEST
        values = least.sequence.random(1)[0]
        return _point(least.stratum, values, "start"), _LARGEST

    def _way(self) -> Way:
        ways: list[Way] = ["start", "descend"]
        if len(self.archive):
            ways.append("spread")
        if any(known.demands for known in self._known.values()):
            ways.append("demand")
        total = sum(self._success[way] for way in ways)
        rest = 1.0 - _LEAST_SHARE * len(ways)
        chances = [_LEAST_SHARE + rest * self._success[way] / total for way in ways]
        return ways[int(self._random.choice(len(ways), p=chances))]

    def _descent(self) -> tuple[Point, float] | None:
        """Return a step from the best point of a promising stratum, and that point's score."""
        open_strata = [(known, best) for known in self._known.values() if (best := known.best) is not None]
        if not open_strata:
            return None
        open_strata.sort(key=lambda item: _value(item[0].scores[item[1]]) + _STAGNATION * item[0].stagnant)
        known, best = open_strata[min(int(self._random.geometric(_RANK_CHANCE)) - 1, len(open_strata) - 1)]
        center, dimensions = known.points[best], known.stratum.dimensions
        anywhere = self._random.random((_UNIFORM, dimensions))
        candidates = np.concatenate([*(self._around(center, count, step) for count, step in _STEPS), anywhere])
        mean, deviation, scale = self._model(known, candidates)
        bound = mean - deviation + _BAD_PENALTY * scale * _next_to_implausible(known, candidates)
        return _point(known.stratum, candidates[int(np.argmin(bound))], "descend"), _value(known.scores[best])

    def _reaction(self) -> Point:
        """Return a point at which the planner has to react, in the stratum with the fewest such points for its number
        of parameters.
        """
        from scipy.special import ndtr

        open_strata = [one for one in self._known.values() if one.demands]
        known = min(open_strata, key=lambda one: one.demanding / one.stratum.dimensions)
        candidates = self._random.random((_DEMANDING, known.stratum.dimensions))
        points = np.array([point for point, _ in known.demands])
        values = np.array([demand for _, demand in known.demands])
        center, scale = float(values.mean()), float(values.std()) + 1e-6
        mean, deviation = _gaussian_process(points, (values - center) / scale, candidates)
        reacts = ndtr((mean - (_DEMANDS - center) / scale) / deviation)
        away = _distances(candidates, np.array([*known.points, *known.pending, *known.idle])).min(axis=1)
        return _point(known.stratum, candidates[int(np.argmax(reacts * away))], "demand")

    def _variation(self) -> Point:
        """Return a point next to a failure in the least varied cell, and away from known failures."""
        from scipy.special import ndtr

        cell = min(self.archive.cells, key=lambda name: self._varied.get(name, 0))
        self._varied[cell] = self._varied.get(cell, 0) + 1
        hits = self.archive.cells[cell]
        hit = hits[int(self._random.integers(len(hits)))].item
        known, center = self._known[hit.stratum], np.array(hit.values)
        candidates = np.concatenate([self._around(center, count, step) for count, step in _SPREADS])
        mean, deviation, _ = self._model(known, candidates, left=_FAILED)
        failing = ndtr(-mean / deviation)
        failures = [point for point, score in zip(known.points, known.scores, strict=True) if score.cell is not None]
        away = _distances(candidates, np.array([*failures, *known.pending])).min(axis=1)
        return _point(known.stratum, candidates[int(np.argmax(failing * np.minimum(away, _FAR)))], "spread")

    def _around(self, center: Values, count: int, step: float) -> Values:
        """Return candidates (count, d) around a point, mirrored at the bounds of the space."""
        drawn = np.abs(center + self._random.normal(0.0, step, (count, len(center))))
        inside: Values = np.clip(np.where(drawn > 1.0, 2.0 - drawn, drawn), 0.0, 1.0)
        return inside

    def _model(self, known: _Known, candidates: Values, left: float = _LEFT) -> tuple[Values, Values, float]:
        """Return mean and standard deviation of the scores at candidates (n, d), and the spread of the known scores.

        ``left``: the score that the model uses for failures in cells that the search no longer explores. Points that
        are still being evaluated count as having an ordinary score.
        """
        points = np.array(known.points)
        values = np.array([self._modelled(score, left) for score in known.scores])
        if known.pending:
            points = np.concatenate([points, known.pending])
            values = np.concatenate([values, np.full(len(known.pending), values.mean())])
        if len(points) > _MOST_MODELLED:
            near = np.argsort(_distances(points, candidates.mean(axis=0)[None])[:, 0], kind="stable")[:_MOST_MODELLED]
            points, values = points[near], values[near]
        center, scale = float(values.mean()), float(values.std()) + 1e-6
        mean, deviation = _gaussian_process(points, (values - center) / scale, candidates)
        return mean * scale + center, deviation * scale, scale

    def _modelled(self, score: Score, left: float) -> float:
        if score.cell is None:
            return min(_value(score), _LARGEST)
        return left if self.archive.is_exhausted(score.cell) else _FAILED


def _gaussian_process(points: Values, values: Values, candidates: Values) -> tuple[Values, Values]:
    """Return mean and standard deviation at candidates (m, d) of a process with known values (n,) at points (n, d)."""
    apart = _distances(points, points)
    fits = []
    for length in _LENGTHS:
        factor = np.linalg.cholesky(_matern(apart / length) + _NOISE * np.eye(len(points)))
        weights = np.linalg.solve(factor.T, np.linalg.solve(factor, values))
        likelihood = -0.5 * float(values @ weights) - float(np.log(np.diag(factor)).sum())
        fits.append((likelihood, length, factor, weights))
    _, length, factor, weights = max(fits, key=lambda fit: fit[0])
    between = _matern(_distances(candidates, points) / length)
    explained = np.linalg.solve(factor, between.T)
    mean: Values = between @ weights
    deviation: Values = np.sqrt(np.maximum(1.0 - (explained * explained).sum(axis=0), 1e-9))
    return mean, deviation


def _matern(scaled: Values) -> Values:
    """Return the Matérn 5/2 correlation at distances in length scales."""
    root = math.sqrt(5.0) * scaled
    correlation: Values = (1.0 + root + root * root / 3.0) * np.exp(-root)
    return correlation


def _distances(first: Values, second: Values) -> Values:
    """Return the distances (n, m) between points (n, d) and (m, d)."""
    distances: Values = np.sqrt(((first[:, None] - second[None]) ** 2).sum(axis=-1))
    return distances


def _next_to_implausible(known: _Known, candidates: Values) -> Values:
    """Return 1 for each candidate that is nearer to an implausible point than to any plausible one, else 0."""
    if not known.implausible:
        return np.zeros(len(candidates))
    bad = _distances(candidates, np.array(known.implausible)).min(axis=1)
    nearer: Values = (bad < _distances(candidates, np.array(known.points)).min(axis=1)).astype(np.float64)
    return nearer


def _value(score: Score) -> float:
    return _LARGEST if score.value is None else score.value


def _point(stratum: Stratum, values: Values, way: Way) -> Point:
    return Point(stratum.name, tuple(round(float(value), _DECIMALS) for value in values), way)
