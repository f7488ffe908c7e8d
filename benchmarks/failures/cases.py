"""A case of the benchmark: a public scenario, a fast planner, perhaps a weakness, and the space that all search."""

import sys
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from plannerforge.engine.execution import silent
from plannerforge.engine.exploration import Evaluator, Point, Score, Stratum
from plannerforge.engine.exploration.finding import evaluated, open_space, shrunk
from plannerforge.engine.planners import Planner
from plannerforge.engine.tuning import preset_configuration
from plannerforge.schemas.exploration import EncounterSetting, Evaluation
from plannerforge.schemas.failures import EvaluatedPoint, SearchSpace, ShrinkRequest, Shrunk, SpacePoint, SpaceRequest

from ..harness import drawn
from .peers import Judged
from .weaknesses import Watch, Weak

LEAST_STRATA = 6
"""Strata of a base that counts."""
MOST_ROAD_USERS = 10
"""Recorded road users of a base. An edit simulates all of them, so that a busy recording takes ten times as long."""
HORIZON_S = 6.0
_SAFE_TTC_S = 5.0


@dataclass
class Base:
    """A scenario with a planner. Its evaluator is open until ``close``, and every point is evaluated once.

    ``watched``: the weaknesses of its cases.
    """

    path: Path
    planner: str
    watched: tuple[str, ...] = ()
    known: dict[tuple[str, Point], EvaluatedPoint] = field(default_factory=dict)
    _altered: dict[Point, frozenset[str]] = field(default_factory=dict)
    _driving: str = ""
    _watch: Watch | None = None
    _stack: ExitStack = field(default_factory=ExitStack)

    @property
    def setting(self) -> EncounterSetting:
        """What all points share."""
        configuration = preset_configuration(self.planner, None)
        return EncounterSetting(xml=self.path, configuration=configuration, horizon_s=HORIZON_S)

    @cached_property
    def space(self) -> SearchSpace:
        """The space of the healthy planner; without strata if it fails in the base."""
        return open_space(SpaceRequest(setting=self.setting, base_id=self.path.stem), silent)

    @cached_property
    def strata(self) -> list[Stratum]:
        """The strata as a search sees them."""
        return [Stratum(one.name, len(one.parameters)) for one in self.space.strata]

    @cached_property
    def evaluator(self) -> Evaluator:
        """The evaluator, in which the healthy planner or one with a weakness drives."""
        return self._stack.enter_context(Evaluator(self.setting, self._drives, self.space.drive))

    def _drives(self, healthy: Planner) -> Planner:
        if self._driving:
            return Weak(healthy, self._driving)
        self._watch = Watch(healthy, self.watched)
        return self._watch

    def close(self) -> None:
        """Close the evaluator."""
        self._stack.close()
        self.__dict__.pop("evaluator", None)

    def unchanged(self, weakness: str) -> Evaluation:
        """Return how a planner with a weakness fares in the unchanged base."""
        self._driving = weakness
        return self.evaluator.evaluate(())

    def evaluated(self, point: Point, weakness: str = "") -> EvaluatedPoint:
        """Return how the planner fares at a point, healthy or with a weakness."""
        bare = Point(point.stratum, point.values)
        if weakness and bare in self._altered and weakness not in self._altered[bare]:
            return self.known["", bare]
        if (weakness, bare) not in self.known:
            stratum = next(one for one in self.space.strata if one.name == bare.stratum)
            asked = SpacePoint(stratum=bare.stratum, shares=bare.values, screened=point.way == "demand")
            self._driving, self._watch = weakness, None
            self.known[weakness, bare] = evaluated(self.evaluator, stratum, asked, self.space.recorded)
            if not weakness:
                self._altered[bare] = frozenset(() if self._watch is None else self._watch.altered)
        return self.known[weakness, bare]

    def is_altered(self, point: Point, weakness: str) -> bool:
        """Return True if a weakness changes what the healthy planner sees in its run at a point."""
        self.evaluated(point)
        return weakness in self._altered[Point(point.stratum, point.values)]


@dataclass
class Case:
    """A base in which a planner drives with a weakness, or as it is; ``seen``: its points in the order of the search.

    ``shares``: whether the healthy planner drives first at the points with which a search starts. Other cases of the
    base start with the same ones, and need no run where their weakness changes nothing.
    """

    base: Base
    weakness: str = ""
    shares: bool = False

    @property
    def path(self) -> Path:
        """The scenario's file."""
        return self.base.path

    @property
    def setting(self) -> EncounterSetting:
        """What all points share."""
        return self.base.setting

    @property
    def space(self) -> SearchSpace:
        """The space of the healthy planner."""
        return self.base.space

    @property
    def strata(self) -> list[Stratum]:
        """The strata as a search sees them."""
        return self.base.strata

    @property
    def is_possible(self) -> bool:
        """Whether there is something to search, and the planner passes the unchanged base."""
        return bool(self.strata) and not self.base.unchanged(self.weakness).has_failed

    def drives(self, healthy: Planner) -> Planner:
        """Return the planner with the weakness, if there is one."""
        return Weak(healthy, self.weakness) if self.weakness else healthy

    @property
    def seen(self) -> Iterator[EvaluatedPoint]:
        """The points at which this planner was evaluated."""
        yield from (point for (weakness, _), point in self.base.known.items() if weakness == self.weakness)

    def evaluated(self, point: Point) -> EvaluatedPoint:
        """Return how the planner fares at a point."""
        if self.weakness and self.shares and point.way == "start":
            self.base.evaluated(point)
        return self.base.evaluated(point, self.weakness)

    def judge(self, point: Point) -> Judged:
        """Return the score of a point for any search; the second objective is the least time to collision."""
        found = self.evaluated(point)
        seconds = found.evaluation.least_time_to_collision_s
        second = 1.0 if seconds is None else min(seconds, _SAFE_TTC_S) / _SAFE_TTC_S
        cell = found.score.cell
        return Judged(Score(found.score.value, None if cell is None else cell.key, found.score.demand), second)

    def is_planted(self, point: Point) -> bool:
        """Return True if the healthy planner does not fail at a point at which the weak one does."""
        if not self.evaluated(point).evaluation.has_failed:
            return False
        return not self.base.evaluated(point).evaluation.has_failed

    def shrunk(self, request: ShrinkRequest) -> Shrunk:
        """Return a reduced failure of this planner."""
        self.base.unchanged(self.weakness)
        return shrunk(self.base.evaluator, request, silent)


def bases(folder: Path, planner: str, count: int, without: Sequence[str] = (), *, practice: bool = False) -> list[Base]:
    """Return the first public scenarios, in a drawn order, that a planner passes and that can be varied.

    They have few road users and are recorded up to the horizon. What a search would find there plays no part.
    ``practice``: take the last ones, on which the search may be developed.
    """
    names = drawn((path.name for path in sorted(folder.glob("*.xml")) if path.stem not in without), None)
    half = names[len(names) // 2 :][::-1] if practice else names[: len(names) // 2]
    return list(_opened((folder / name for name in half), planner, count))


def _opened(paths: Iterator[Path], planner: str, count: int) -> Iterator[Base]:
    """Yield the bases among some files; says on the way what it does."""
    found = 0
    for path in paths:
        if found >= count:
            return
        if not _is_small(path):
            continue
        begun, base = time.monotonic(), Base(path, planner)
        try:
            strata, problem = len(base.strata), base.space.base.reason
        except Exception as error:  # noqa: BLE001 - a file that cannot be edited or driven is no base
            strata, problem = 0, str(error)
        said = f"{strata} strata" if strata else problem
        sys.stderr.write(f"{path.stem}, {planner}: {said} ({time.monotonic() - begun:.0f} s)\n")
        if strata >= LEAST_STRATA:
            found += 1
            yield base


def _is_small(path: Path) -> bool:
    """Return True if a file has few road users, recorded up to the horizon."""
    root = ElementTree.parse(path).getroot()  # noqa: S314 - public scenarios, which the benchmark is given
    moving = root.findall("dynamicObstacle")
    steps = [float(time.text or 0) for one in moving for time in one.iterfind("trajectory/state/time/exact")]
    return 0 < len(moving) <= MOST_ROAD_USERS and max(steps, default=0.0) * float(root.get("timeStepSize", 0.1)) >= (
        HORIZON_S
    )
