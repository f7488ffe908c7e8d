"""Exploration: logical scenarios, concrete points of them, and how a planner fares at a point.

A logical scenario is a base with edit templates and parameters with ranges and units. Values for its parameters give
an ordinary list of edits, so a point is repeated with ``modify_scenario`` and ``run_planner``.
"""

import math
from bisect import bisect_right
from pathlib import Path
from statistics import NormalDist
from typing import Any, Literal

from pydantic import Field, model_validator

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


_MOST_COUNTED = 10_000
"""The largest mean of a Poisson distribution, which is summed (chosen)."""


class Distribution(Model):
    """How often the values of a parameter occur.

    - ``uniform``: equally often in the parameter's range
    - ``normal``, ``lognormal``: with the values' own ``mean`` and ``variance``
    - ``poisson``: with ``mean``
    - ``histogram``: ``bins`` (low, high, weight); a bin with ``low`` = ``high`` is a single value

    ``source``: where it was recorded or published.
    """

    kind: Literal["uniform", "normal", "lognormal", "poisson", "histogram"]
    mean: float = 0.0
    variance: float = Field(0.0, ge=0.0)
    bins: tuple[tuple[float, float, float], ...] = Field((), max_length=1_000)
    source: str = ""

    @model_validator(mode="after")
    def _has_all_figures(self) -> "Distribution":
        if self.kind in ("normal", "lognormal") and not self.variance > 0.0:
            raise ValueError(f"a {self.kind} distribution needs a variance above 0")
        if self.kind in ("lognormal", "poisson") and not self.mean > 0.0:
            raise ValueError(f"a {self.kind} distribution needs a mean above 0")
        if self.kind == "poisson" and self.mean > _MOST_COUNTED:
            raise ValueError(f"a poisson distribution needs a mean up to {_MOST_COUNTED:,}; use a normal distribution")
        if self.kind == "histogram":
            if any(low > high or weight < 0.0 for low, high, weight in self.bins):
                raise ValueError("a bin is (low, high, weight) with low <= high and weight >= 0")
            if not sum(weight for *_, weight in self.bins) > 0.0:
                raise ValueError("a histogram needs bins with weights above 0")
        return self

    def share_below(self, value: float) -> float:
        """Return the share of values up to a value, from 0 to 1; not for ``uniform``, which depends on the range."""
        if self.kind == "normal":
            return NormalDist(self.mean, math.sqrt(self.variance)).cdf(value)
        if self.kind == "lognormal":
            spread = math.log(1.0 + self.variance / self.mean**2)
            middle = math.log(self.mean) - spread / 2
            return NormalDist(middle, math.sqrt(spread)).cdf(math.log(value)) if value > 0.0 else 0.0
        if self.kind == "poisson":
            far = self.mean + 50.0 * math.sqrt(self.mean) + 50.0  # no double is above this
            counts = range(math.floor(min(value, far)) + 1)
            logs = (count * math.log(self.mean) - self.mean - math.lgamma(count + 1) for count in counts)
            return min(sum(map(math.exp, logs)), 1.0)
        total = sum(weight for *_, weight in self.bins)
        below = 0.0
        for low, high, weight in self.bins:
            if value >= high:
                below += weight
            elif value > low:
                below += weight * (value - low) / (high - low)
        return below / total


_STATED = {
    "aside_m": "{} aside",
    "begin_s": "starts at {}",
    "early_s": "arrives {} before the ego|arrives {} after the ego",
    "later_s": "{} later|{} earlier",
    "lateral_s": "lasts {}",
    "lead_s": "starts {} before that",
    "meet_s": "meets the ego at {}",
    "percent": "to {} of its speed",
    "rate_mps2": "at {}",
    "ratio": "{} of the ego's speed",
    "reach_s": "{} ahead of the ego",
}
"""Parameters as phrases, where the name and value would not be understood; after ``|`` for a negative value."""


class Parameter(Model):
    """A parameter of a logical scenario with its range. ``base``: the value of an ordinary encounter.

    ``distribution``: how often values occur, if that is known.
    """

    name: str = Field(pattern=r"^[a-z][a-z0-9_]*$")
    low: float
    high: float
    unit: str = ""
    base: float | None = None
    summary: str = ""
    distribution: Distribution | None = Field(None, exclude_if=lambda distribution: distribution is None)

    @property
    def is_fixed(self) -> bool:
        """Whether the range is a single value, so that the parameter varies only in a given range."""
        return self.low == self.high

    @property
    def base_value(self) -> float:
        """The value of an ordinary encounter, by default the middle of the range."""
        return (self.low + self.high) / 2 if self.base is None else self.base

    def share_below(self, share: float) -> float:
        """Return the share of the values in the range up to a fraction of the range, from 0 to 1.

        Without a distribution, all values are equally frequent.
        """
        if self.distribution is None or self.distribution.kind == "uniform" or not 0.0 < share < 1.0:
            return min(max(share, 0.0), 1.0)
        below = self.distribution.share_below
        # A single value at the lower end belongs to the range.
        first, last = below(self.low - 1e-9 * (self.high - self.low)), below(self.high)
        return (below(self.at_share(share)) - first) / (last - first) if last > first else share

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
        """Return a value as text, such as ``ego speed 13.9 m/s`` or ``arrives 0.3 s after the ego``."""
        positive, _, negative = _STATED.get(self.name, f"{self.quantity} {{}}").partition("|")
        if value < 0 and negative:
            positive, value = negative, -value
        return positive.format(f"{value:.3g}{'' if self.unit == '%' else ' '}{self.unit}".rstrip())

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
    respond to the planner's ego. ``source``: the source of the parameters. ``notes``: what was left out of the source.
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
    notes: tuple[str, ...] = Field((), exclude_if=lambda notes: not notes)

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
    def avoided_by(self) -> tuple[DriverModelName, ...]:
        """The reference drivers that avoid the failure, by the rule for ``failed_avoidably``.

        They avoid a collision from both starts. If the ego cut in or hit nothing, only the start of the run counts.
        """
        drivers = dict.fromkeys(one.driver for one in self.prevented_by)
        needed = {"start"} if self.contact in (None, "cut_in_by_ego") else {"start", "before_contact"}
        starts = {name: {one.start for one in self.prevented_by if one.driver == name} for name in drivers}
        return tuple(name for name in drivers if starts[name] >= needed)

    @property
    def has_failed(self) -> bool:
        """Whether the planner failed."""
        return self.outcome in FAILURES

    @property
    def counts_as_run(self) -> bool:
        """Whether a run was driven, so that it counts towards a budget."""
        return self.steps > 0
