"""The search for failures: its space, proposals, points and failures, and the tool's arguments and result."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Final, Literal

from pydantic import Field

from .base import Answer, Arguments, Model, Result, first_of
from .exploration import EncounterSetting, Evaluation, LogicalScenario
from .jobs import JobState, state_in_words
from .modification import Edit
from .reviews import CAREFUL_DRIVERS, COLLISION_CAUSES, kind_in_words
from .runs import Prediction, Traffic
from .text import counted
from .worlds import PERFECT_NAME

SpeedBand = Literal["slow", "middle", "fast", "any"]
_BANDS: dict[SpeedBand, str] = {"slow": "low", "middle": "medium", "fast": "high"}
_CAUSES = {str(cause): words for cause, words in COLLISION_CAUSES.items()}


class SpaceRequest(Model):
    """The base and planner for which a space is derived."""

    setting: EncounterSetting
    base_id: str


class BaseDrive(Model):
    """The planner's drive through the unchanged base up to the horizon: x and y in m, heading in rad and speed in m/s
    at each step, and the ego's size.
    """

    first_step: int
    states: tuple[tuple[float, float, float, float], ...]
    length_m: float
    width_m: float


class SearchSpace(Model):
    """The unchanged base, and the search space that it offers.

    ``base``: how the planner fares in the unchanged base. ``strata``: logical scenarios with one counterpart and one
    manoeuvre each; empty if the base fails. ``recorded``: the base's road users by id. ``drive``: the planner's drive
    through the unchanged base.
    """

    base: Evaluation
    strata: tuple[LogicalScenario, ...] = ()
    recorded: tuple[int, ...] = ()
    drive: BaseDrive | None = None


class SpacePoint(Model):
    """A point of a space: a stratum by name, and a share of the range of each of its parameters. ``screened``: the
    planner runs only if it has to react and could.
    """

    stratum: str
    shares: tuple[float, ...]
    screened: bool = False


class FailureCell(Model):
    """What failures have in common that count as the same: counterpart and manoeuvre, contact, the ego's speed, cause.

    ``speed`` is a band: ``slow`` below 3 m/s, ``middle`` below 10 m/s, ``fast`` above; ``any`` if it is not known.
    """

    counterpart: str = Field(description="counterpart and manoeuvre")
    contact: str = Field(description="kind of contact, or how the run ended without one")
    speed: SpeedBand = Field(description="speed band of the ego")
    cause: str = Field("", description="cause of the collision; empty if not known")

    @property
    def key(self) -> str:
        """A text that is different for each cell."""
        return " | ".join([self.counterpart, self.contact, self.speed, self.cause or "no cause"])

    def in_words(self) -> str:
        """Return the cell with its speed and cause named."""
        speed = f" at {_BANDS[self.speed]} speed" if self.speed in _BANDS else ""
        cause = f"attributed to {_CAUSES[self.cause]}" if self.cause in _CAUSES else "not attributed"
        return f"{self.counterpart}, {kind_in_words(self.contact)}{speed}, {cause}"


class PointScore(Model):
    """The score of a point; lower scores are nearer to a failure, and None means that the point is implausible.
    ``cell``: the cell of a failure. ``demand``: 1 if the drive through the unchanged base would collide here although
    a careful driver would not, 0.5 if a careful driver would collide too, 0 if it would not; None if unknown.
    """

    value: float | None
    cell: FailureCell | None = None
    demand: float | None = None


class ProposalsRequest(Model):
    """The input for the next points of a search: strata with their number of parameters, the seed, and all scores."""

    strata: tuple[tuple[str, int], ...] = Field(min_length=1)
    seed: int
    scores: tuple[PointScore, ...] = ()


class ProposedPoints(Model):
    """The next points of a search."""

    points: tuple[SpacePoint, ...]


class SpacePointsRequest(Model):
    """Points to evaluate; ``strata`` must include those of the points. ``recorded``, ``drive``: those of the space."""

    setting: EncounterSetting
    strata: tuple[LogicalScenario, ...]
    points: tuple[SpacePoint, ...]
    recorded: tuple[int, ...] = ()
    drive: BaseDrive | None = None


class EvaluatedPoint(Model):
    """A point with its edits, how the planner fares there, and the score for the search.

    ``edits`` is empty if a template does not fit.
    """

    point: SpacePoint
    edits: tuple[Edit, ...] = ()
    evaluation: Evaluation
    score: PointScore


class EvaluatedPoints(Model):
    """Evaluated points, in the order of the request."""

    points: tuple[EvaluatedPoint, ...]


class ShrinkRequest(Model):
    """A failure to reduce; ``most_runs`` is the maximum number of candidates to run."""

    setting: EncounterSetting
    stratum: LogicalScenario
    point: SpacePoint
    recorded: tuple[int, ...] = ()
    most_runs: int = 40


class Shrunk(Model):
    """A failure reduced to what it needs.

    ``edits``: the whole list, which replaces the failure's. ``kept``: the road users that the failure needs in addition
    to the counterpart and added road users. ``needed``: the parameters that cannot return to their ordinary value.
    ``is_minimal``: no further road user can be left out; False if the runs were used up before this was shown.
    ``lanelets``: those that are left of ``lanelets_before``. ``area_m``: length and width of the part of the map around
    the ego's start. ``duration_s``: the end of the time span. These two are None if nothing could be cut.
    """

    edits: tuple[Edit, ...]
    values: dict[str, float]
    evaluation: Evaluation
    runs: int
    road_users_before: int
    road_users: int
    kept: tuple[int, ...] = ()
    needed: tuple[str, ...] = ()
    is_minimal: bool = True
    lanelets_before: int = 0
    lanelets: int = 0
    area_m: tuple[float, float] | None = None
    duration_s: float | None = None


class FindFailuresArguments(Arguments):
    """Search for plausible changes of a scenario in which a planner fails and a careful driver would not."""

    scenario_id: str = Field("latest", description="the base; the planner must pass it")
    config: str = Field("current", description="config id, PLANNER[:PRESET]")
    runs: int = Field(150, ge=1, le=5000, description="budget; a larger one goes on")
    until_first: bool = False
    """Stop at the first failure."""
    shrink: bool = Field(False, description="reduce each failure to what it needs")
    horizon_s: float = Field(6.0, ge=2.0, le=30.0)
    """How long each run lasts at most."""
    prediction: Prediction = "constant_velocity"
    """The prediction of others that the planner receives."""
    traffic: Traffic = "recorded"
    """Whether others follow their recording or react to the ego."""
    world: str = Field(PERFECT_NAME, description="as in run_planner")
    wait_s: float = Field(45, ge=0, le=50)
    """How long to wait, in s. Afterwards the answer gives the job's id."""
    seed: int = 0
    """The seed of the search."""


class ShrunkFailure(Model):
    """A failure reduced to what it needs, as a stored scenario and its run."""

    scenario_id: str
    run_id: str
    edits: tuple[Edit, ...] = Field(description="the edits of the base")
    road_users_before: int = Field(description="road users of the failure")
    road_users: int = Field(description="road users that are left")
    lanelets_before: int = Field(0, description="lanelets of the base")
    lanelets: int = Field(0, description="lanelets that are left")
    needed: tuple[str, ...] = Field((), description="parameters that matter, with their values")
    runs: int = Field(description="runs that the reduction took")
    is_minimal: bool = Field(True, description="whether no single road user can be left out")


class FoundFailure(Model):
    """A failure with its own cell: a scenario made from the base by modify_scenario and stored, and the planner's run
    on it.
    """

    scenario_id: str
    run_id: str
    cell: FailureCell = Field(description="counterpart and manoeuvre, contact, the ego's speed band, cause")
    change: str = Field(description="the change of the base in words")
    values: dict[str, float] = Field(description="the parameters of the change")
    edits: tuple[Edit, ...] = Field(description="the edits of the base")
    reason: str = Field(description="how the run ended")
    time_s: float | None = Field(None, description="time of the failure since the start")
    prevented_by: tuple[str, ...] = Field((), description="reference drivers that avoid it")
    found_after: int = Field(description="number of the run that found it")
    hits: int = Field(description="points of the search in this cell")
    shrunk: ShrunkFailure | None = Field(None, description="the reduced failure; null without `shrink`")


class FailureSearchRecord(Model):
    """A finished search: the base, the budget used, and one failure per cell, in the order in which they were found."""

    base_id: str = Field(description="id of the varied scenario")
    config_id: str
    config_name: str
    runs: int = Field(description="runs made")
    implausible: int = Field(description="proposals refused as implausible; they cost no run")
    unavoidable: int = Field(description="runs with a failure that no careful driver avoids")
    strata: tuple[str, ...] = Field(description="what was varied")
    failures: tuple[FoundFailure, ...] = Field((), description="the distinct failures")
    batch_id: str | None = Field(None, description="their runs, reduced if `shrink`, as a batch; null without any")
    world: str = Field(
        PERFECT_NAME, description="what the sensors report", exclude_if=lambda world: world == PERFECT_NAME
    )


class FindFailuresResult(Result):
    """The failures found, or the job."""

    state: JobState
    job_id: str | None = None
    search: FailureSearchRecord | None = Field(None, description="the search; null until it is done")
    message: str = Field("", description="progress in words")
    next_step: str

    def answer(self) -> Answer:
        """Return the failures with their change, run and verdict."""
        search = self.search
        if search is None:
            return Answer(state_in_words(self.job_id, self.state, self.message), next_step=self.next_step)
        found = counted(len(search.failures), "distinct failure")
        other = (
            f"Runs with failures that no careful driver avoids: {search.unavoidable}. "
            f"Implausible proposals, which were not run: {search.implausible}."
        )
        more = len(search.strata) - _MOST_STRATA
        world = "" if search.world == PERFECT_NAME else f" (world {search.world})"
        varied = ", ".join(search.strata[:_MOST_STRATA]) + (f" and {more} more" if more > 0 else "")
        return Answer(
            f"{search.config_name} near {search.base_id}{world}: "
            f"{found} that a careful driver avoids, in {search.runs} runs.",
            decided=[f"Varied: {varied}.", other],
            listed=first_of(
                [line for failure in search.failures for line in _lines(failure)],
                2 * _MOST_FAILURES,
                "the structured answer has all",
            ),
            next_step=self.next_step,
        )


_MOST_FAILURES, _MOST_STRATA = 6, 12
"""How many failures and strata the text lists (chosen for an answer below 600 tokens)."""


def _lines(failure: FoundFailure) -> Iterator[str]:
    """Yield a failure: what was changed and its run, then how it ended and what it needs."""
    yield f"{failure.run_id} on {failure.scenario_id}: {failure.change}"
    drivers = careful_drivers_in_words(failure.prevented_by)
    shrunk = failure.shrunk
    reduced = (
        ""
        if shrunk is None
        else f" Reduced to {shrunk.scenario_id}: {shrunk.road_users_before} → {shrunk.road_users} road users"
        f"{_lanelets(shrunk)}"
        f"{f'; still needed for the failure: {_listed(shrunk.needed)}' if shrunk.needed else ''}."
    )
    yield f"  {failure.reason}; {drivers} would not fail. Type: {failure.cell.in_words()}.{reduced}"


def _lanelets(shrunk: ShrunkFailure) -> str:
    fewer = shrunk.lanelets < shrunk.lanelets_before
    return f", {shrunk.lanelets_before} → {shrunk.lanelets} lanelets" if fewer else ""


CAREFUL_WORDS: Final[dict[str, str]] = dict(zip(CAREFUL_DRIVERS, ("careful", "fuzzy"), strict=True))
"""The careful drivers of UN regulation R157 as answers call them."""


def careful_drivers_in_words(drivers: Iterable[str]) -> str:
    """Return the careful drivers among drivers as text: ``the careful and fuzzy drivers of UN regulation R157``."""
    names = [CAREFUL_WORDS[name] for name in dict.fromkeys(drivers) if name in CAREFUL_WORDS]
    return f"the {' and '.join(names)} driver{'s' * (len(names) > 1)} of UN regulation R157"


def _listed(words: Sequence[str]) -> str:
    return ", ".join(words)
