"""Rank correlations between features of scenarios and success, also with other features held fixed.

Features are known before a run (traffic, speed at the start), never results of it. They correlate with each other too:
dense traffic is slow, and motorways are fast. Therefore each feature is also correlated while the other features and
the kind of road are held fixed.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean

from ...schemas.results import Correlation
from ...schemas.runs import RunRecord
from ...schemas.text import counted
from .run_set import RunSet, reached_goal
from .statistics import holm, rank_correlation

_FEWEST_SCENARIOS = 12
"""Below this a rank correlation must exceed 0.58 to differ from 0 at 5%: too coarse to report."""
_FEWEST_OF_A_ROAD = 3
"""A kind of road with fewer scenarios has no indicator of its own (chosen): it would only model their mean."""
ROAD = "road"


@dataclass(frozen=True)
class _Scenario:
    """The features of a scenario, its kind of road, and the share of its runs that reached the goal."""

    features: Mapping[str, float]
    road: str
    success: float


Note = tuple[str, Mapping[str, float]]
"""A sentence and its figures by name."""


def correlations(runs: RunSet) -> tuple[tuple[Correlation, ...], Note]:
    """Return Spearman correlations of features with success, strongest first, and a note if there are none."""
    seen = _scenarios(runs)
    if len(seen) < _FEWEST_SCENARIOS:
        covered = counted(len(seen), "scenario")
        words = f"no correlations: valid runs cover {covered}, but at least {_FEWEST_SCENARIOS} are needed"
        return (), (words, {"scenarios": len(seen), "least_scenarios": _FEWEST_SCENARIOS})
    if len({scenario.success for scenario in seen}) == 1:
        return (), ("no correlations: all scenarios ended alike", {})
    tested = {name: (n, *found) for name in _FEATURES if (found := _plain(seen, name)) for n in [_count(seen, name)]}
    adjusted = holm([p for _, _, p in tested.values()])
    listed = []
    for (name, (n, rho, p)), p_holm in zip(tested.items(), adjusted, strict=True):
        controls, left = _controlled_for(seen, name, [other for other in tested if other != name])
        listed.append(
            Correlation(
                feature=name,
                n=n,
                rho=rho,
                p=p,
                p_holm=p_holm,
                rho_fixed=None if left is None else left[0],
                p_fixed=None if left is None else left[1],
                held_fixed=controls,
            )
        )
    return tuple(sorted(listed, key=lambda item: (-abs(item.rho), item.feature))), ("", {})


def _scenarios(runs: RunSet) -> list[_Scenario]:
    groups: dict[str, list[RunRecord]] = {}
    for record in runs.valid:
        groups.setdefault(runs.root(record), []).append(record)
    return [_scenario(runs, records) for records in groups.values()]


def _scenario(runs: RunSet, records: Sequence[RunRecord]) -> _Scenario:
    """Return a scenario's features: means over its runs, because planning problems and versions may differ."""
    values = {
        name: [value for record in records if (value := feature(runs, record)) is not None]
        for name, feature in _FEATURES.items()
    }
    known = runs.scenario(records[0])
    return _Scenario(
        features={name: fmean(found) for name, found in values.items() if found},
        road="" if known is None else known.road,
        success=fmean(reached_goal(record) for record in records),
    )


def _count(seen: Sequence[_Scenario], name: str) -> int:
    return sum(name in scenario.features for scenario in seen)


def _plain(seen: Sequence[_Scenario], name: str) -> tuple[float, float] | None:
    """Return ρ and p over the scenarios with the feature; None if these are too few, or either quantity is constant."""
    rows = [(scenario.features[name], scenario.success) for scenario in seen if name in scenario.features]
    return rank_correlation(rows) if len(rows) >= _FEWEST_SCENARIOS else None


def _controlled_for(
    seen: Sequence[_Scenario], name: str, others: Sequence[str]
) -> tuple[tuple[str, ...], tuple[float, float] | None]:
    """Return the features held fixed, with the resulting ρ and p; None if no feature can be held fixed, or no data is
    left.
    """
    known = [scenario for scenario in seen if {name, *others} <= scenario.features.keys()]
    counts: dict[str, int] = {}
    for scenario in known:
        counts[scenario.road] = counts.get(scenario.road, 0) + 1
    roads = sorted(road for road, count in counts.items() if count >= _FEWEST_OF_A_ROAD)[1:]
    controls = (*others, *([ROAD] if roads else []))
    columns = len(others) + len(roads)
    if not columns or len(known) < _FEWEST_SCENARIOS + columns:
        return (), None
    rows = [
        (
            scenario.features[name],
            scenario.success,
            *(scenario.features[other] for other in others),
            *(float(scenario.road == road) for road in roads),
        )
        for scenario in known
    ]
    return controls, rank_correlation(rows, columns)


def _large_vehicles(runs: RunSet, record: RunRecord) -> float | None:
    by_type = runs.obstacles.get(record.scenario_id)
    return None if by_type is None else by_type.get("truck", 0) + by_type.get("bus", 0)


def _initial_speed(runs: RunSet, record: RunRecord) -> float | None:
    steps = runs.steps.get(record.run_id)
    return steps.speed_mps[0] if steps is not None and steps.speed_mps else None


def _density(runs: RunSet, record: RunRecord) -> float | None:
    known = runs.scenario(record)
    return None if known is None else known.density_per_km


_FEATURES: dict[str, Callable[[RunSet, RunRecord], float | None]] = {
    "obstacles": RunSet.obstacle_count,
    "density_per_km": _density,
    "trucks_and_buses": _large_vehicles,
    "initial_speed_mps": _initial_speed,
}
