"""``explore_boundary``: its arguments, the worker's requests, the stored map, and the answer."""

from pathlib import Path
from typing import Any, Final

from pydantic import Field, PrivateAttr

from .base import Answer, Arguments, Model, Result
from .exploration import EncounterSetting, Evaluation, LogicalScenario, Parameter, PointOutcome
from .runs import Prediction, Traffic
from .text import counted
from .worlds import PERFECT, PERFECT_NAME, World

OUTCOME_WORDS: Final[dict[PointOutcome, str]] = {
    "safe": "safe",
    "failed_avoidably": "failed avoidably",
    "failed_unavoidably": "failed unavoidably",
    "implausible": "implausible",
    "invalid": "invalid",
}
"""The outcomes as answers print them."""
LATTICE: Final = 64
"""Steps of a map's lattice along each parameter."""
MOST_CONFIGURATIONS: Final = 6
"""The most configurations of one exploration (chosen)."""


class ExploreBoundaryArguments(Arguments):
    """Map where a planner begins to fail: two parameters of a logical scenario, refined at the edges (job)."""

    scenario: str = Field("lead_braking", description="lead_braking, nhtsa:18 …, or a .yaml or .xosc file")
    over: list[str] = Field(
        [], description="two as 'headway_s=0.5..2.5', others fixed 'ego_speed_mps=20' or in slices '15,25'"
    )
    configs: list[str] = Field(
        ["current"], min_length=1, max_length=MOST_CONFIGURATIONS, description="config ids, PLANNER[:PRESET]"
    )
    base: str | None = Field(None, description="scenario id in place of the drawn road")
    points: int = Field(150, ge=30, le=1000)
    """The most points of each map; each is a run of the planner."""
    references: bool = True
    """Whether to map UN R157's careful and fuzzy drivers too."""
    prediction: Prediction = "constant_velocity"
    """As in `run_planner`."""
    traffic: Traffic | None = None
    """As in `run_planner`; by default that of the logical scenario."""
    world: str = Field(PERFECT_NAME, description="as in run_planner")
    wait_s: float = Field(45, ge=0, le=50)
    """How long to wait for the map, in s. Afterwards the answer gives the job's id."""
    seed: int = 0
    """The seed of traffic, and of the choice of cells that are checked."""


class DescribeLogicalRequest(Model):
    """A request for a logical scenario by name, or from a file (``path``); an empty name means the first one.

    ``roots``: the folders of the files that the file may refer to.
    """

    name: str = ""
    path: str | None = None
    roots: tuple[Path, ...] = ()


class DrawRoadRequest(Model):
    """A request to write the file of a road."""

    road: str
    path: str


class RoadDrawn(Model):
    """The file of a road."""

    path: str


class PointsRequest(EncounterSetting):
    """A batch of points for a worker: the values of each point's parameters."""

    logical: LogicalScenario
    points: tuple[dict[str, float], ...]


class PointsResponse(Model):
    """How the planner fares at each point, in the order of the request."""

    evaluations: tuple[Evaluation, ...]


class MapPoint(Model):
    """A point of a map: its position on the lattice, from 0 to 64 along each parameter, and how the planner fares."""

    place: tuple[int, int]
    evaluation: Evaluation


class MapArea(Model):
    """The share of the mapped range with an outcome, from 0 to 1, with its bounds."""

    outcome: PointOutcome
    share: float = Field(description="share of the mapped range")
    low: float = Field(description="its lower bound")
    high: float = Field(description="its upper bound")

    def in_words(self) -> str:
        """Return the share with its bounds in percent."""
        return f"{OUTCOME_WORDS[self.outcome]} {self.share:.0%} ({self.low:.0%} to {self.high:.0%})"


class FailureRate(Model):
    """The avoidable failures in a million encounters, with a 95 % interval.

    ``assumptions``: the frequencies of the parameters, as the end of a sentence.
    """

    per_million: float = Field(description="avoidable failures in a million encounters")
    low: float = Field(description="lower end of the 95 % interval")
    high: float = Field(description="upper end of the 95 % interval")
    assumptions: str = Field(description="the frequencies of the parameters that it assumes")

    def in_words(self) -> str:
        """Return the rate with its interval and its assumptions as one sentence."""
        return (
            f"{self.per_million:,.0f} avoidable failures per million encounters (95 % interval {self.low:,.0f} to "
            f"{self.high:,.0f}), if {self.assumptions}."
        )


class BoundaryMap(Model):
    """The map of one planner over two parameters, with the others at the values of a slice."""

    config_id: str
    config_name: str
    planner: str
    is_reference: bool = False
    at: dict[str, float] = Field(default_factory=dict, description="values of the other parameters")
    points: tuple[MapPoint, ...]
    cells: tuple[tuple[int, int, int], ...] = Field(description="lower corner and size of each cell of the lattice")
    areas: tuple[MapArea, ...]
    rate: FailureRate | None = Field(None, exclude_if=lambda rate: rate is None)

    def area(self, outcome: PointOutcome) -> MapArea | None:
        """Return the share with an outcome, or None if no point has it."""
        return next((area for area in self.areas if area.outcome == outcome), None)

    @property
    def failures(self) -> tuple[MapPoint, ...]:
        """The points at which the planner fails avoidably."""
        return tuple(point for point in self.points if point.evaluation.outcome == "failed_avoidably")


class BoundaryRecord(Model):
    """A stored exploration: the logical scenario, its two mapped parameters, and a map per planner and slice."""

    boundary_id: str
    scenario: LogicalScenario
    base_id: str
    axes: tuple[Parameter, Parameter]
    prediction: Prediction
    traffic: Traffic
    seed: int
    world: World = Field(PERFECT, exclude_if=lambda world: world.is_perfect)
    maps: tuple[BoundaryMap, ...]

    def values_at(self, place: tuple[int, int], at: dict[str, float]) -> dict[str, float]:
        """Return the parameters' values at a place of the lattice, with the others as in a slice."""
        shares = (place[0] / LATTICE, place[1] / LATTICE)
        mapped = {one.name: round(one.at_share(share), 4) for one, share in zip(self.axes, shares, strict=True)}
        return at | mapped

    def nearest_to_base(self, points: tuple[MapPoint, ...]) -> MapPoint | None:
        """Return the point nearest to the base values, those of an ordinary encounter.

        Distances are measured in fractions of the ranges.
        """

        def away(point: MapPoint) -> float:
            return sum(
                (at / LATTICE - (one.base_value - one.low) / (one.high - one.low)) ** 2
                for at, one in zip(point.place, self.axes, strict=True)
            )

        return min(points, key=lambda point: (away(point), point.place), default=None)


class FailureExample(Model):
    """A failure that a careful driver avoids: its parameters, and the edits that repeat it."""

    config_id: str
    values: dict[str, float] = Field(description="values of all parameters")
    what: str = Field(description="what happens, in words")
    base_id: str = Field(description="the scenario to edit")
    edits: tuple[dict[str, Any], ...] = Field(description="edits for modify_scenario")


class MapSummary(Model):
    """The shares of the outcomes in one planner's map."""

    config_id: str
    config_name: str
    is_reference: bool = Field(False, description="whether it is a reference driver")
    at: dict[str, float] = Field(default_factory=dict, description="values of the other parameters")
    points: int = Field(description="number of evaluated points")
    areas: tuple[MapArea, ...] = Field(description="share of each outcome")
    rate: FailureRate | None = Field(
        None, description="avoidable failures per million encounters, if a mapped parameter has a distribution"
    )

    def in_words(self) -> str:
        """Return the planner, the values of the other parameters, the shares with their bounds, and the rate."""
        at = ", ".join(f"{name} {value:g}" for name, value in self.at.items())
        areas = [area for area in self.areas if area.share > 0 or area.outcome == "failed_avoidably"]
        kind = "reference " if self.is_reference else ""
        shares = ", ".join(area.in_words() for area in areas)
        mapped = f"{kind}{self.config_name}{f' at {at}' if at else ''}: {shares}; {counted(self.points, 'point')}."
        return mapped if self.rate is None else f"{mapped} {self.rate.in_words()}"


_BOUNDS = (
    "In brackets: bounds on each share, because outcomes between the points are uncertain (estimated from test points)."
)


class ExploreBoundaryResult(Result):
    """A map of where planners fail, or the state of the job that makes it.

    In Python, ``record`` is the stored record with every point.
    """

    state: str = Field(description="done, or the state of the job")
    boundary_id: str | None = Field(None, description="id of the map, for render")
    job_id: str | None = None
    headline: str = Field("", description="what was mapped")
    maps: tuple[MapSummary, ...] = Field((), description="one per planner and slice")
    examples: tuple[FailureExample, ...] = Field((), description="the most ordinary avoidable failure of each map")
    implausible: tuple[str, ...] = Field((), description="the most frequent reasons of implausible points")
    notes: tuple[str, ...] = Field((), description="what was left out of an OpenSCENARIO file")
    message: str = Field("", description="what the job is doing")
    next_step: str
    _record: BoundaryRecord | None = PrivateAttr(None)

    @property
    def record(self) -> BoundaryRecord | None:
        """The stored record; None while the job runs, and in answers that were sent to a client."""
        return self._record

    def with_record(self, record: BoundaryRecord) -> "ExploreBoundaryResult":
        """Return the result with its record."""
        self._record = record
        return self

    def answer(self) -> Answer:
        """Return the areas of each map with bounds, and for each planner the most ordinary avoidable failure."""
        if self.boundary_id is None:
            return Answer(headline=f"{self.job_id}: {self.state}. {self.message}".rstrip(), next_step=self.next_step)
        return Answer(
            headline=f"{self.boundary_id}: {self.headline}.",
            figures=[one.in_words() for one in self.maps],
            listed=[_BOUNDS, *(f"Most ordinary avoidable failure of {example.what}" for example in self.examples)],
            warnings=[*(f"implausible points: {reason}" for reason in self.implausible), *self.notes],
            next_step=self.next_step,
        )
