"""What the modification bench keeps of each request and of each job."""

from dataclasses import dataclass, field

from .safety import Shift


@dataclass(frozen=True)
class Physical:
    """The drivability checker's verdicts on a touched vehicle.

    ``settled``: from its hand-over + 1 s on (an added one: from its start), None where nothing is left then;
    ``recorded``: on its old recording; ``handed_over``: no edit names it.
    """

    settled: bool | None
    whole: bool
    closed_form: bool
    recorded: bool | None
    handed_over: bool = False


@dataclass(frozen=True)
class Refusal:
    """A request that was to be carried out and was refused.

    ``is_right``: physics keep a vehicle from being rerouted so, or a road user is on the place that is said to be taken
    or cannot brake before it; None where the bench has no rule of its own, as for a class that a road does not allow.
    """

    task: str
    reason: str
    is_right: bool | None


@dataclass(frozen=True)
class Case:
    """What came of one request; ``refused`` holds the reason where nothing was made.

    ``tries``: those that were refused before it, and itself if it was. ``arrivals``: of each vehicle that was sent to
    a target, whether the written motion gets there. ``is_first``: the scenario was not edited before, so that
    its file was read for this. ``handovers``: m beyond v·dt and m/s of each vehicle that SUMO took over. ``valid`` lets
    vehicles enter later that were asked to, for which the schema has no form; ``enter_later`` counts them, and
    ``strictly_valid`` does not let them.
    """

    task: str
    name: str
    refused: str = ""
    tries: tuple[Refusal, ...] = ()
    checks: dict[str, bool] = field(default_factory=dict)
    arrivals: tuple[bool, ...] = ()
    valid: bool = False
    strictly_valid: bool = False
    enter_later: int = 0
    untouched_identical: bool = False
    touched: int = 0
    handed_over: int = 0
    collisions: int = 0
    unreported: int = 0
    handovers: tuple[tuple[float, float], ...] = ()
    physical: tuple[Physical, ...] = ()
    edit_s: float = 0.0
    edit_cpu_s: float = 0.0
    is_first: bool = False
    executed: bool | None = None
    in_several_calls_equal: bool | None = None


@dataclass(frozen=True)
class Measured:
    """All of one job: cases, refusals that were right and asked for, round trip, shifts of danger.

    ``no_request``: tasks of which the scenario allows nothing. ``not_to_refuse``: lines of the corpus for which going
    on is right too. ``off_lanes``: those of ``road_users`` off all lanelets: SUMO shows them in the round trip, while a
    re-simulation keeps their recording and leaves them out of SUMO.
    """

    cases: tuple[Case, ...] = ()
    refused_right: tuple[tuple[str, bool], ...] = ()
    round_trip_error: str | None = None
    shifts: tuple[Shift, ...] = ()
    no_request: tuple[str, ...] = ()
    not_to_refuse: tuple[str, ...] = ()
    road_users: int = 0
    off_lanes: int = 0


@dataclass(frozen=True)
class Effort:
    """What is measured besides the edits, which takes longer than they do.

    ``planner``: it drives what the drawn edits made; ``safety``: what the recipes of the safety table made too.
    ``every_vehicle``: the drivability checker judges all touched vehicles, not one that an edit names.
    """

    planner: bool = False
    safety: bool = False
    every_vehicle: bool = False
