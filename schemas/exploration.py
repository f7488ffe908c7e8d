"""Exploration: logical scenarios, concrete points of them, and how a planner fares at a point.

A logical scenario is a base with edit templates and parameters with ranges and units. Values for its parameters give
an ordinary list of edits, so a point is repeated with ``modify_scenario`` and ``run_planner``.
"""

from bisect import bisect_right
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from .base import Model
from .modification import Edit
from .planning import PlannerConfiguration
from .reviews import BodySide, CollisionCause, ContactKind, DriverModelName, DriverStart
from .runs import Outcome, Prediction, Traffic
from .worlds import PERFECT, World

PointOutcome = Literal["safe", "failed_avoidably", "failed_unavoidably", "implausible", "invalid"]
"""How a planner fares at a point.

- ``safe``: it hit nothing, stayed on the road, and always had a trajectory
- ``failed_avoidably``: it failed, and UN R157's careful or fuzzy driver in its place does not
- ``failed_unavoidably``: it failed, and neither of them prevents it
- ``implausible``: the edits are refused, others would collide, a motion cannot be driven, or the ego starts in contact
- ``invalid``: the planning problem has no solution, so the planner was not called"""
FAILURES: tuple[PointOutcome, ...] = ("failed_avoidably", "failed_unavoidably")
"""The outcomes that are failures of the planner."""


class Parameter(Model):
    """A parameter of a logical scenario with its range. ``base``: the value of an ordinary encounter."""

    name: str = Field(pattern=r"^[a-z][a-z0-9_]*$")
    low: float
    high: float
    unit: str = ""
    base: float | None = None
    summary: str = ""

    @property
    def base_value(self) -> float:
        """The value of an ordinary encounter, by default the middle of the range."""
        return (self.low + self.high) / 2 if self.base is None else self.base

    @property
    def quantity(self) -> str:
        """The name as words, without its unit: ``ego speed`` for ``ego_speed_mps``."""
        words = self.name.split("_")
        if len(words) > 1 and words[-1] == self.unit.replace("/", "p").replace("²", "2"):
            words.pop()
        return " ".join(words)

    @property
    def title(self) -> str:
        """The quantity with its unit, such as ``ego speed (m/s)``."""
        return f"{self.quantity} ({self.unit})" if self.unit else self.quantity

    def stated(self, value: float) -> str:
        """Return a value as text, such as ``ego speed 13.9 m/s``."""
        return f"{self.quantity} {value:.3g} {self.unit}".rstrip()

    def at_share(self, share: float) -> float:
        """Return the value at a fraction of the range, from 0 to 1."""
        return self.low + (self.high - self.low) * share


class Curve(Model):
    """A derived value that is looked up by another value.

    ``of``: the name of the other value. ``at``: its places, ascending. ``values``: the values there. Numbers are
    interpolated linearly. With ``steps``, the value is that of the last place passed; texts need ``steps``.
    """

    of: str
    at: tuple[float, ...] = Field(min_length=1)
    values: tuple[float, ...] | tuple[str, ...]
    steps: bool = False

    def value(self, place: float) -> float | str:
        """Return the value at a place; outside the range of places, return the first or the last value."""
        index = max(bisect_right(self.at, place) - 1, 0)
        here = self.values[index]
        if self.steps or isinstance(here, str) or index + 1 >= len(self.at) or place <= self.at[0]:
            return here
        share = (place - self.at[index]) / (self.at[index + 1] - self.at[index])
        return here + (float(self.values[index + 1]) - here) * share


class LogicalScenario(Model):
    """A base, parameters, and edits that contain them.

    ``base``: the id of a stored scenario, or the name of a road. The values of an edit template may refer to
    parameters: ``"$gap_s"`` is a parameter's value, ``"${speed_mps}m/s"`` a text that contains it. ``derived``: further
    values by name, as formulas of parameters with ``+ - * /``, parentheses and earlier derived values, or as curves.
    ``horizon_s``: the maximum duration of the encounter. ``traffic``: reactive if edits have triggers, which then
    respond to the planner's ego. ``source``: the source of the parameters.
    """

    name: str
    summary: str
    base: str
    parameters: tuple[Parameter, ...] = Field(min_length=1)
    derived: dict[str, str | Curve] = Field(default_factory=dict)
    edits: tuple[dict[str, Any], ...] = Field(min_length=1)
    horizon_s: float = Field(8.0, gt=0.0, le=60.0)
    traffic: Traffic = "recorded"
    source: str = ""

    def parameter(self, name: str) -> Parameter:
        """Return the parameter with a name; raise KeyError if there is no such parameter."""
        return next(one for one in self.parameters if one.name == name)


class PreCrashType(Model):
    """A type of NHTSA's pre-crash typology of light vehicles (DOT HS 810 767, 2007).

    ``crashes``: in the United States in a year (General Estimates System, 2004). ``percent``: their share of all
    crashes. ``scenarios``: the logical scenarios with this encounter, the usual one first. ``reason``: why there is no
    such logical scenario.
    """

    number: int = Field(ge=1, le=37)
    name: str
    crashes: int
    percent: float
    scenarios: tuple[str, ...] = ()
    reason: str = ""

    def in_words(self) -> str:
        """Return the name, the share of crashes, and the logical scenarios or the reason why there is no such one."""
        return f"{self.name} ({self.percent:.2f} % of crashes): {', '.join(self.scenarios) or self.why_not}"

    @property
    def why_not(self) -> str:
        """The reason why there is no logical scenario, as a phrase."""
        return f"not covered, because {self.reason}"


class EncounterSetting(Model):
    """The data that all points of an exploration share, as a worker receives it.

    ``xml``: the base's file. ``earlier``: edits that the base already has; a point's edits follow them. ``horizon_s``:
    the time after which a run is stopped.
    """

    xml: Path
    configuration: PlannerConfiguration
    problem_id: int | None = None
    earlier: tuple[Edit, ...] = ()
    traffic: Traffic = "recorded"
    prediction: Prediction = "constant_velocity"
    seed: int = 0
    world: World = PERFECT
    horizon_s: float = Field(6.0, gt=0.0)


class AvoidingDriver(Model):
    """A reference driver that would prevent a failure, and the start from which it does."""

    driver: DriverModelName
    start: DriverStart


class Evaluation(Model):
    """How a planner fares at a point.

    ``reason``: why the point is implausible or how the run ended. ``run_outcome``: the outcome of the run; None if it
    was stopped because the encounter was over. ``counterpart_id``: the road user that the ego hit, or came closest to.
    ``manoeuvre``: the edits that prescribe the counterpart's motion, or ``recorded`` if there are none.
    ``least_gap_m``: 0 in a collision. ``steps``: the driven time steps. ``end``: what ended the run.
    """

    outcome: PointOutcome
    reason: str
    run_outcome: Outcome | None = None
    end: Literal["judged", "encounter_over", "horizon", "not_run"] = "judged"
    time_s: float | None = Field(None, description="time of the failure since the start")
    counterpart_id: int | None = None
    counterpart_class: str = ""
    manoeuvre: str = ""
    contact: ContactKind | None = None
    ego_side: BodySide | None = None
    other_side: BodySide | None = None
    ego_speed_mps: float | None = Field(None, description="at the contact, or at the least gap")
    other_speed_mps: float | None = None
    cause: CollisionCause | None = None
    least_gap_m: float | None = None
    least_time_to_collision_s: float | None = None
    prevented_by: tuple[AvoidingDriver, ...] = ()
    steps: int = 0

    @property
    def has_failed(self) -> bool:
        """Whether the planner failed."""
        return self.outcome in FAILURES

    @property
    def counts_as_run(self) -> bool:
        """Whether a run was driven, so that it counts towards a budget."""
        return self.steps > 0
