"""Finds the weights that matter on a set of scenarios: Morris screening and Sobol total indices from SALib.

Morris (1991, "Factorial sampling plans for preliminary computational experiments") changes one weight at a time along
random paths through the space; μ* (Campolongo, Cariboni and Saltelli 2007) is the mean absolute change. Sobol's total
index is the share of the objective's variance to which a weight contributes. Intervals are SALib's bootstraps.

A change of a weight that turns some scenarios to success and as many to failure also moves the mean a little. So a
weight matters only if it passes a permutation test and its bootstrapped interval is above 0. The test has the scenario
as the unit: the effect must be larger than expected if each scenario's changes were as likely to have the opposite
sign. Both conditions are adjusted for the number of tested weights (Bonferroni).
"""

from collections.abc import Sequence
from statistics import NormalDist
from typing import TYPE_CHECKING, Any, Literal

from ...schemas.analysis.optimization import DesignRequest, Effect, Effects, EffectsRequest, Proposals
from ...schemas.results import SIGNIFICANCE_LEVEL
from ..execution import ProgressReporter
from .search import legacy_seed

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_LEVELS = 4
"""Levels of a Morris design, as usual."""
_FEWEST_WAYS = 4
"""Fewest paths of a Morris design (Saltelli et al. 2008, "Global Sensitivity Analysis: The Primer": four to ten)."""
_FEWEST_SAMPLES = 2
"""Fewest base samples of a Sobol design, since one sample has no variance."""
_MOST_EXACT = 13
"""Most scenarios for which all signs are evaluated: 2¹³ are fewer than the drawn ones."""
_DRAWN = 9_999
"""Number of signs drawn beyond that; with the observed ones, p is a multiple of 1/10,000 (Davison and Hinkley 1997)."""


def fewest_configurations(method: Literal["morris", "sobol"], weights: int) -> int:
    """Return the number of configurations in the smallest design over ``weights`` weights."""
    return _FEWEST_WAYS * (weights + 1) if method == "morris" else _FEWEST_SAMPLES * (weights + 2)


def sensitivity_design(request: DesignRequest, report: ProgressReporter) -> Proposals:
    """Return the points of a design (an operation): at most as many as requested, at least the smallest design."""
    points = _points(request)
    report(1.0, f"{len(points)} points")
    return Proposals(points=tuple(tuple(float(place) for place in point) for point in points))


def sensitivity_effects(request: EffectsRequest, report: ProgressReporter) -> Effects:
    """Return the effect of each weight, from the objective at the points of the design (an operation)."""
    import numpy as np

    design = request.design
    values = np.asarray(request.values, dtype=float)
    if values.std() == 0 and all(len(set(column)) == 1 for column in zip(*request.scores, strict=True)):
        idle = [Effect(name=name, effect=0.0, margin=0.0, verdict="none") for name in design.names]
        return Effects(effects=tuple(idle))
    found, margins = _analysed(design, _points(design), values)
    report(0.5, "effects")
    changes = _changes(request)
    p_values = {name: _chance(one, request.units, design) for name, one in changes.items() if one.any()}
    report(1.0, "analysed")
    tested = max(len(p_values), sum(effect != 0 for effect in found), 1)
    rows = [
        _effect(name, effect, margin, p_values.get(name), tested).model_copy(
            update={"largest": _largest(design, place, changes.get(name))}
        )
        for place, (name, effect, margin) in enumerate(zip(design.names, found, margins, strict=True))
    ]
    return Effects(effects=tuple(sorted(rows, key=lambda row: (-row.effect, row.name))))


def _analysed(design: DesignRequest, points: Any, values: "NDArray[np.float64]") -> tuple[list[float], list[float]]:
    """Return the effect of each weight and its 95% interval's half-width; all are 0 if the objective never changes."""
    if values.std() == 0:
        return [0.0] * len(design.names), [0.0] * len(design.names)
    problem, seed = _problem(design), legacy_seed(design.seed)
    if design.method == "morris":
        from SALib.analyze import morris

        found = morris.analyze(problem, points, values, num_levels=_LEVELS, seed=seed)
        return list(map(float, found["mu_star"])), list(map(float, found["mu_star_conf"]))
    from SALib.analyze import sobol

    found = sobol.analyze(problem, values, calc_second_order=False, seed=seed)
    return list(map(float, found["ST"])), list(map(float, found["ST_conf"]))


def _effect(name: str, effect: float, margin: float, p: float | None, tested: int) -> Effect:
    """Return the effect of a weight with its verdict, as one of ``tested`` weights."""
    if effect == 0 and p is None:
        return Effect(name=name, effect=0.0, margin=0.0, verdict="none")
    normal = NormalDist()
    wider = normal.inv_cdf(1 - SIGNIFICANCE_LEVEL / 2 / tested) / normal.inv_cdf(1 - SIGNIFICANCE_LEVEL / 2)
    is_apart = effect - wider * margin > 0
    adjusted = None if p is None else min(1.0, p * tested)
    is_shown = adjusted is None or adjusted < SIGNIFICANCE_LEVEL
    verdict: Literal["matters", "unclear"] = "matters" if is_apart and is_shown else "unclear"
    return Effect(name=name, effect=effect, margin=margin, verdict=verdict, p=p, p_adjusted=adjusted)


def _couples(design: DesignRequest, place: int) -> list[tuple[int, int]]:
    """Return the pairs of points of a design that differ in only one weight."""
    count = len(design.names)
    points = _points(design)
    if design.method == "sobol":  # A, then A with each weight of B, then B
        return [(first, first + 1 + place) for first in range(0, len(points), count + 2)]
    steps = [at for at in range(len(points) - 1) if (at + 1) % (count + 1)]
    return [(at, at + 1) for at in steps if points[at][place] != points[at + 1][place]]


def _changes(request: EffectsRequest) -> "dict[str, NDArray[np.float64]]":
    """Return, by weight, the changes of the objective between points that differ only in that weight: (pairs, s).

    Scenarios without a score at some point are left out; the result is empty if no scores are given.
    """
    import numpy as np

    if not request.scores:
        return {}
    scores = np.array([[np.nan if one is None else one for one in row] for row in request.scores], dtype=float)
    scores[:, np.isnan(scores).any(axis=0)] = 0.0
    found = {}
    for place, name in enumerate(request.design.names):
        couples = np.array(_couples(request.design, place), dtype=int).reshape(-1, 2)
        found[name] = scores[couples[:, 1]] - scores[couples[:, 0]]
    return found


def _chance(changes: "NDArray[np.float64]", units: Sequence[str], design: DesignRequest) -> float:
    """Return the p value: how often random signs of scenarios give at least the observed effect; never 0."""
    import numpy as np

    names = list(dict.fromkeys(units))
    sums = np.stack([changes[:, [unit == name for unit in units]].sum(axis=1) for name in names], axis=1)
    moved = sums[:, np.any(sums != 0, axis=0)]
    count = moved.shape[1]
    if count == 0:
        return 1.0
    if count <= _MOST_EXACT:
        signs = 1.0 - 2.0 * ((np.arange(2**count)[:, None] >> np.arange(count)) & 1)
    else:
        generator = np.random.default_rng(legacy_seed(design.seed))
        drawn = generator.choice([-1.0, 1.0], size=(_DRAWN, count))
        signs = np.vstack([np.ones(count), drawn])
    means = signs @ moved.T
    effects = np.abs(means).mean(axis=1) if design.method == "morris" else (means**2).mean(axis=1)
    return float((effects >= effects[0] * (1 - 1e-9)).mean())


def _largest(design: DesignRequest, place: int, changes: "NDArray[np.float64] | None") -> tuple[int, int, int] | None:
    """Return the two points and the scenario of a weight's largest change, or None if there was no change."""
    import numpy as np

    if changes is None or not changes.any():
        return None
    pair, scenario = np.unravel_index(int(np.abs(changes).argmax()), changes.shape)
    return (*_couples(design, place)[int(pair)], int(scenario))


def _problem(request: DesignRequest) -> dict[str, Any]:
    count = len(request.names)
    return {"num_vars": count, "names": list(request.names), "bounds": [[0.0, 1.0]] * count}


def _points(request: DesignRequest) -> Any:
    """Return the design as an array with one row per point."""
    count = len(request.names)
    if request.method == "morris":
        from SALib.sample import morris

        ways = max(_FEWEST_WAYS, request.most // (count + 1))
        return morris.sample(_problem(request), ways, num_levels=_LEVELS, seed=legacy_seed(request.seed))
    from SALib.sample import sobol

    size = _FEWEST_SAMPLES
    while 2 * size * (count + 2) <= request.most:
        size *= 2
    return sobol.sample(_problem(request), size, calc_second_order=False, seed=legacy_seed(request.seed))
