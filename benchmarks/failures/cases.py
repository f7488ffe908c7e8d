"""A case of the benchmark: a public scenario, a fast planner, perhaps a weakness, and the space that all search."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from plannerforge.engine.execution import silent
from plannerforge.engine.exploration import Evaluator, Point, Score, Stratum
from plannerforge.engine.exploration.finding import evaluated, open_space
from plannerforge.engine.planners import Planner
from plannerforge.engine.tuning import preset_configuration
from plannerforge.schemas.exploration import EncounterSetting
from plannerforge.schemas.failures import EvaluatedPoint, SearchSpace, SpacePoint, SpaceRequest

from ..harness import drawn
from .peers import Judged
from .weaknesses import Weak

LEAST_STRATA = 6
"""Strata of a base that counts."""
_SAFE_TTC_S = 5.0


@dataclass
class Case:
    """A base with a planner; its evaluator is open until ``close``. Points are evaluated once."""

    path: Path
    planner: str
    weakness: str = ""
    horizon_s: float = 6.0
    known: dict[Point, EvaluatedPoint] = field(default_factory=dict)
    _stack: ExitStack = field(default_factory=ExitStack)

    @property
    def setting(self) -> EncounterSetting:
        """What all points share."""
        configuration = preset_configuration(self.planner, None)
        return EncounterSetting(xml=self.path, configuration=configuration, horizon_s=self.horizon_s)

    @cached_property
    def space(self) -> SearchSpace:
        """The space of the healthy planner; without strata if it fails in the base."""
        return open_space(SpaceRequest(setting=self.setting, base_id=self.path.stem), silent)

    @cached_property
    def strata(self) -> list[Stratum]:
        """The strata as a search sees them."""
        return [Stratum(one.name, len(one.parameters)) for one in self.space.strata]

    def drives(self, healthy: Planner) -> Planner:
        """Return the planner with the weakness, if there is one."""
        return Weak(healthy, self.weakness) if self.weakness else healthy

    @cached_property
    def evaluator(self) -> Evaluator:
        """The evaluator with the weak planner."""
        return self._stack.enter_context(Evaluator(self.setting, self.drives))

    @cached_property
    def healthy(self) -> Evaluator:
        """An evaluator with the healthy planner."""
        return self._stack.enter_context(Evaluator(self.setting))

    def close(self) -> None:
        """Close the evaluators."""
        self._stack.close()

    def evaluated(self, point: Point) -> EvaluatedPoint:
        """Return how the planner fares at a point."""
        key = Point(point.stratum, point.values)
        if key not in self.known:
            stratum = next(one for one in self.space.strata if one.name == point.stratum)
            asked = SpacePoint(stratum=point.stratum, shares=point.values)
            self.known[key] = evaluated(self.evaluator, stratum, asked, self.space.recorded)
        return self.known[key]

    def judge(self, point: Point) -> Judged:
        """Return the score of a point for any search; the second objective is the least time to collision."""
        found = self.evaluated(point)
        seconds = found.evaluation.least_time_to_collision_s
        second = 1.0 if seconds is None else min(seconds, _SAFE_TTC_S) / _SAFE_TTC_S
        return Judged(Score(found.score.value, found.score.cell), second)

    def is_planted(self, point: Point) -> bool:
        """Return True if the healthy planner does not fail at a point at which the weak one does."""
        found = self.evaluated(point)
        return found.evaluation.has_failed and not self.healthy.evaluate(found.edits).has_failed


def bases(folder: Path, planner: str, count: int, without: Sequence[str] = ()) -> list[Path]:
    """Return the first public scenarios, in a drawn order, in which a planner passes and enough strata are possible."""
    found: list[Path] = []
    names = [path.name for path in sorted(folder.glob("*.xml")) if path.stem not in without]
    for name in drawn(names, None if not names else len(names)):
        try:
            case = Case(folder / name, planner)
            enough = len(case.space.strata) >= LEAST_STRATA
        except Exception:  # noqa: BLE001, S112 - a file that cannot be edited or driven is no base
            continue
        if enough:
            found.append(folder / name)
        if len(found) >= count:
            break
    return found
