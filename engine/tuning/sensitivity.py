"""Which weights matter on some scenarios: screening by Morris, total indices by Sobol, both of SALib.

Morris (1991, "Factorial sampling plans for preliminary computational experiments") changes one weight at a time along
random ways through the space; μ* (Campolongo, Cariboni and Saltelli 2007) is the mean absolute change. Sobol's total
index is the share of the objective's variance in which a weight has a part. Intervals are SALib's bootstraps.
"""

from typing import Any

from ...schemas.analysis.optimization import DesignRequest, Effect, Effects, EffectsRequest, Proposals
from ..execution import ProgressReporter
from .search import legacy_seed

_LEVELS = 4
"""Levels of a Morris design, as usual."""
_FEWEST_WAYS = 4
"""Ways of a Morris design at least (chosen; four to ten are usual)."""


def sensitivity_design(request: DesignRequest, report: ProgressReporter) -> Proposals:
    """An operation: the points of a design."""
    points = _points(request)
    report(1.0, f"{len(points)} points")
    return Proposals(points=tuple(tuple(float(place) for place in point) for point in points))


def sensitivity_effects(request: EffectsRequest, report: ProgressReporter) -> Effects:
    """An operation: the effect of each weight, from the objective at the points of the design."""
    import numpy as np

    values = np.asarray(request.values, dtype=float)
    problem, points = _problem(request.design), _points(request.design)
    if values.std() == 0:
        idle = [Effect(name=name, effect=0.0, margin=0.0, verdict="none") for name in request.design.names]
        return Effects(effects=tuple(idle))
    if request.design.method == "morris":
        from SALib.analyze import morris

        found = morris.analyze(problem, points, values, num_levels=_LEVELS, seed=legacy_seed(request.design.seed))
        effects, margins = found["mu_star"], found["mu_star_conf"]
    else:
        from SALib.analyze import sobol

        found = sobol.analyze(problem, values, calc_second_order=False, seed=legacy_seed(request.design.seed))
        effects, margins = found["ST"], found["ST_conf"]
    report(1.0, "analysed")
    rows = [_effect(*row) for row in zip(request.design.names, effects, margins, strict=True)]
    return Effects(effects=tuple(sorted(rows, key=lambda row: (-row.effect, row.name))))


def _effect(name: str, effect: float, margin: float) -> Effect:
    effect, margin = float(effect), float(margin)
    if effect == 0:
        return Effect(name=name, effect=0.0, margin=0.0, verdict="none")
    return Effect(name=name, effect=effect, margin=margin, verdict="matters" if effect - margin > 0 else "unclear")


def _problem(request: DesignRequest) -> dict[str, Any]:
    count = len(request.names)
    return {"num_vars": count, "names": list(request.names), "bounds": [[0.0, 1.0]] * count}


def _points(request: DesignRequest) -> Any:
    """The design, an array with a row a point."""
    count = len(request.names)
    if request.method == "morris":
        from SALib.sample import morris

        ways = max(_FEWEST_WAYS, request.most // (count + 1))
        return morris.sample(_problem(request), ways, num_levels=_LEVELS, seed=legacy_seed(request.seed))
    from SALib.sample import sobol

    size = 2
    while 2 * size * (count + 2) <= request.most:
        size *= 2
    return sobol.sample(_problem(request), size, calc_second_order=False, seed=legacy_seed(request.seed))
