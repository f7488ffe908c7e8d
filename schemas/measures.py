"""The measures of a run, defined once for answers, reports, tables and ``docs/measures.md``.

Nearness, time and severity are measured between the ego and others, motion on the ego alone. Measures that are fields
of ``RunMetrics`` are stored with every run and are called *metrics*. The others are computed on request from the driven
steps and the tracks of the others (``engine/analysis/measures.py``).

To add a measure, define it in ``MEASURES``. To store it with every run, give ``RunMetrics`` a field of its name (None
by default, because older runs lack it). Compute figures of the ego's own motion in ``engine/motion_figures.py``, for
runs and analysis alike. Compute nearness to others in ``engine/criticality.py`` if it is stored, otherwise in
``engine/analysis/measures.py``. Schemas, comparisons, limits, tables, charts, reports and the Python library take their
names from the definitions.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from pydantic import Field, field_validator

from .base import Model
from .text import RISK_SCALE, RISK_UNIT

Relation = Literal["ahead", "behind", "beside", "oncoming", "crossing"]
"""The relation of a road user to the ego: the side if its heading is within 45° of the ego's, otherwise its heading."""
Basis = Literal["valid", "both_reached_goal"]
_NOT_AHEAD = "no vehicle ahead on the ego's path"
NO_OTHER_NEAR = "no other road user came within 60 m"
LEFT_THE_ROAD = "the ego left the road"
_OLD = "an older version made the run and did not measure it"
_NEVER_CLOSING = "never closing in on a vehicle ahead on the ego's path"
_TOO_SHORT = "the run has too few steps"


@dataclass(frozen=True)
class Measure:
    """One measure of a run.

    - ``words``: its name in prose
    - ``abbreviation``: the field's abbreviation, or empty
    - ``better``: the better direction, or None
    - ``meaning``: an explanation for readers who did not make the runs
    - ``method``: how it is computed, with parameters
    - ``source``: the source of the definition
    - ``span``: its possible values
    - ``cap``: the bound beyond which it is undefined or clipped, or empty
    - ``none``: why a run may not have it

    The remaining fields are for comparisons of stored measures. ``basis`` selects the pairs: progress and comfort count
    only if the two runs of a pair reached the goal, because a run that ends in a collision is short and never brakes
    for its goal. Nearness to others counts in every valid run. ``within_one_configuration`` means that it depends on
    the weights. Values that differ by at most ``tolerance`` are equal: a hundredth of a commonly visible difference,
    and less than the error of positions rounded to centimetres.
    """

    name: str
    words: str
    unit: str
    better: Literal["lower", "higher"] | None
    meaning: str
    method: str
    source: str
    span: str
    none: str
    abbreviation: str = ""
    cap: str = ""
    basis: Basis = "valid"
    within_one_configuration: bool = False
    tolerance: float = 0.0

    @property
    def stored(self) -> bool:
        """Whether the measure is stored with every run."""
        return self.name in RunMetrics.model_fields


class MeasuredValue(Model):
    """A measure of one run: a value, or the reason why it is undefined.

    ``time_s`` is the decisive time of the run. ``obstacle_id``, ``obstacle_class`` and ``relation`` describe the
    decisive other road user, or are None, for example for the ego's own motion. ``note`` adds a remark.
    """

    name: str = Field(description="name of the measure")
    value: float | None = Field(
        None, description="its value, in the measure's unit (docs/measures.md); null if it is not defined"
    )
    why: str = Field("", description="why it is undefined")
    time_s: float | None = None
    obstacle_id: int | None = None
    obstacle_class: str = ""
    relation: Relation | None = None
    note: str = ""

    @property
    def partner(self) -> str:
        """Text such as ``car 39 ahead``; empty if there is no other road user."""
        if self.obstacle_id is None:
            return ""
        where = "alongside" if self.relation == "beside" else self.relation or ""
        return f"{self.obstacle_class} {self.obstacle_id} {where}".strip()


class MeasureSpread(Model):
    """A measure over several runs: median, range, and the run with the worst value.

    ``runs`` counts the runs in which it is defined. ``why`` gives the reason if there are none.
    """

    name: str = Field(description="name of the measure")
    runs: int
    median: float | None = Field(None, description="median over the runs; null if no run defines it")
    lowest: float | None = Field(None, description="smallest value of a run")
    highest: float | None = Field(None, description="largest value of a run")
    worst: MeasuredValue | None = Field(None, description="its worst value")
    worst_run_id: str = Field("", description="id of that run")
    why: str = ""


_LARGEST_FIGURE = 1e150


class RunMetrics(Model):
    """The stored figures of a run; None if undefined, for example if there is no obstacle or the ego never moved."""

    duration_s: float
    """The time from the first to the last driven state."""
    distance_m: float
    """The length of the driven path."""
    mean_speed_mps: float
    """The distance divided by the duration."""
    minimum_distance_m: float | None = Field(description="smallest gap between the ego's and any obstacle's rectangle")
    minimum_time_to_collision_s: float | None
    """The smallest time to collision with any obstacle."""
    minimum_time_headway_s: float | None = Field(None, description="to the vehicle ahead in the ego's path")
    risk_score: int | None = Field(None, description="0 collision … 5 negligible; the most dangerous moment counts")
    minimum_time_gap_s: float | None = Field(
        None, description="to the vehicle ahead in the ego's path, bumper to bumper"
    )
    maximum_jerk_mps3: float
    """The largest absolute change of the longitudinal acceleration between steps, starting with the initial state."""
    mean_squared_jerk: float
    """The mean squared jerk over the steps, in m²/s⁶."""
    maximum_planar_jerk_mps3: float | None = Field(
        None, description="of the acceleration's vector, lateral part included"
    )
    maximum_braking_mps2: float | None = Field(None, description="largest deceleration, as a positive number")
    maximum_lateral_acceleration_mps2: float
    """The largest product of speed and yaw rate."""
    maximum_steering_rate_radps: float | None = Field(
        None, description="that the driven path requires of the front wheels"
    )
    mean_total_cost: float | None
    """The mean weighted cost of the chosen candidates; None for planners without costs."""

    @field_validator("*")
    @classmethod
    def _has_finite_square(cls, value: float | None) -> float | None:
        """Refuse a figure without a finite square: an archive may contain any number, and deviations use squares."""
        if value is not None and abs(value) > _LARGEST_FIGURE:
            raise ValueError(f"larger than {_LARGEST_FIGURE:g}, so not a figure of a run")
        return value


MEASURES: tuple[Measure, ...] = (
    Measure(
        "minimum_distance_m",
        "minimum distance",
        "m",
        "higher",
        "smallest gap between the bodies of the ego and any other over the run",
        "smallest distance between the rectangles of the ego and another road user over the driven steps (distance of "
        "closest encounter)",
        "Eggert 2014 (DCE)",
        "0 to 60",
        NO_OTHER_NEAR,
        abbreviation="DCE",
        cap="only road users with a centre up to 60 m from the ego's count",
        tolerance=0.01,
    ),
    Measure(
        "minimum_time_to_collision_s",
        "time to collision",
        "s",
        "higher",
        "the shortest time, over the run, until the ego and another would touch if both kept course and speed "
        "(Hayward 1972)",
        "both rectangles move on along their headings without turning; the first contact is found with separating axes",
        "Hayward 1972",
        "0 to 100",
        "never on a collision course within 100 s",
        abbreviation="planar TTC",
        cap="undefined beyond 100 s",
        tolerance=0.01,
    ),
    Measure(
        "leader_time_to_collision_s",
        "time to collision with the leader",
        "s",
        "higher",
        "the shortest time in which the ego, at its speed, would have closed the gap to the vehicle ahead on its path",
        "gap to the leader ÷ closing speed, both along the ego's driven path, at constant speeds",
        "Hayward 1972; Minderhoud and Bovy 2001",
        "0 to 100",
        _NEVER_CLOSING,
        abbreviation="TTC",
        cap="undefined beyond 100 s",
    ),
    Measure(
        "time_to_brake_s",
        "time to brake",
        "s",
        "higher",
        "the shortest time left to begin full braking and still avoid the conflicting road user; 0: too late",
        "for the leader, (gap − Δv² ÷ 2a) ÷ Δv with a = 8 m/s²; for a crossing vehicle on a collision course within "
        "10 s, the latest time at which full braking still avoids contact until 3 s after the predicted collision "
        "(found by bisection)",
        "Hillenbrand et al. 2006; Tamke et al. 2011",
        "0 to 10",
        "no leader or crossing vehicle was on a collision course within 10 s",
        abbreviation="TTB",
        cap="only conflicts within 10 s count",
    ),
    Measure(
        "time_to_react_s",
        "time to react",
        "s",
        "higher",
        "the shortest time left for the best of braking, swerving and accelerating; 0: nothing would have helped",
        "the longest of the times to brake, to swerve (at 8 m/s² lateral; 3.5 m sideways for a crossing vehicle) and, "
        "for a crossing vehicle, to accelerate (as far as engine power allows); third parties and the roadside are "
        "ignored",
        "Tamke et al. 2011",
        "0 to 10",
        "no leader or crossing vehicle was on a collision course within 10 s",
        abbreviation="TTR",
        cap="only conflicts within 10 s count",
    ),
    Measure(
        "minimum_time_headway_s",
        "time headway",
        "s",
        "higher",
        "the shortest time until the ego is where the vehicle ahead is now",
        "distance from the ego's front to the leader's front along the ego's driven path ÷ the ego's speed",
        "Vogel 2003",
        "0 to 100",
        _NOT_AHEAD,
        abbreviation="THW",
        cap="undefined beyond 100 s and below 0.1 m/s",
        tolerance=0.01,
    ),
    Measure(
        "minimum_time_gap_s",
        "time gap",
        "s",
        "higher",
        "the shortest time until the ego's front is where the rear of the vehicle ahead is now",
        "distance from bumper to bumper along the ego's driven path ÷ the ego's speed",
        "ISO 15622",
        "0 to 100",
        _NOT_AHEAD,
        cap="undefined beyond 100 s and below 0.1 m/s",
        tolerance=0.01,
    ),
    Measure(
        "post_encroachment_time_s",
        "post-encroachment time",
        "s",
        "higher",
        "the shortest time between one leaving the area where the paths cross and the other reaching it; 0: both "
        "were there at once",
        "time between one body leaving the common area and the other entering it. The area is the overlap of the bands "
        "that both bodies sweep, with headings at least 45° apart; times are interpolated linearly to 0.005 s",
        "Allen, Shin and Cooper 1978",
        "0 to 10",
        "no other road user's path crossed the ego's within 10 s",
        abbreviation="PET",
        cap="undefined beyond 10 s",
    ),
    Measure(
        "encroachment_time_s",
        "encroachment time",
        "s",
        "lower",
        "how long the ego was in the crossing area with the shortest post-encroachment time",
        "time from the first to the last contact of the ego's body with the band that the other's body sweeps",
        "Allen, Shin and Cooper 1978",
        "above 0",
        "no other road user's path crossed the ego's within 10 s, or the run began or ended in the crossing area",
        abbreviation="ET",
    ),
    Measure(
        "time_exposed_s",
        "time-exposed time to collision",
        "s",
        "lower",
        "how long the time to collision with the leader was 3 s or less",
        "(number of driven steps that end with a time to collision with the leader of 3 s or less) × step length",
        "Minderhoud and Bovy 2001",
        "0 to the run's duration",
        _NOT_AHEAD,
        abbreviation="TET",
    ),
    Measure(
        "time_integrated_s2",
        "time-integrated time to collision",
        "s²",
        "lower",
        "how far and how long the time to collision with the leader was below 3 s",
        "sum over these steps of (3 s − time to collision with the leader) × step length",
        "Minderhoud and Bovy 2001",
        "0 to 3 times the run's duration",
        _NOT_AHEAD,
        abbreviation="TIT",
    ),
    Measure(
        "worst_time_to_collision_s",
        "worst time to collision",
        "s",
        "higher",
        "the shortest time until the ego and another could touch if both did the worst that tyres allow",
        "each body is covered by three discs, which grow by 8 m/s² · t² ÷ 2 and keep their centres' velocity; the "
        "discs of static obstacles do not grow",
        "Wachenfeld et al. 2016",
        "0 to 3",
        NO_OTHER_NEAR,
        abbreviation="WTTC",
    ),
    Measure(
        "deceleration_to_avoid_mps2",
        "deceleration to avoid a crash",
        "m/s²",
        "lower",
        "the largest constant deceleration that the ego needed to reach the leader's speed before touching it",
        "Δv² ÷ (2 · gap), both along the ego's driven path, at the leader's constant speed; steps in contact are "
        "excluded",
        "Cooper and Ferguson 1976",
        "0 to 20",
        _NEVER_CLOSING,
        abbreviation="DRAC",
        cap="20 means 20 or more",
    ),
    Measure(
        "brake_threat_number",
        "brake threat number",
        "1",
        "lower",
        "the deceleration that the ego needed, given the leader's, divided by the tyres' limit; from 1 on, braking "
        "alone is too weak",
        "needed deceleration ÷ 8 m/s². The needed deceleration is Δv² ÷ (2 · gap) − the leader's acceleration, or "
        "v² ÷ (2 · (gap + the leader's stopping distance)) if the leader stops first. The leader's acceleration is the "
        "central difference of its speeds, within ±8 m/s²",
        "Jansson 2005; Brännström et al. 2008",
        "0 to 5",
        _NOT_AHEAD,
        abbreviation="BTN",
        cap="5 means 5 or more",
    ),
    Measure(
        "steer_threat_number",
        "steer threat number",
        "1",
        "lower",
        "the lateral acceleration that the ego needed to pass the leader, divided by the tyres' limit; from 1 on, "
        "steering is too late",
        "2 × lateral overlap of the bodies ÷ (time to collision with the leader)² ÷ 8 m/s²; the leader keeps its "
        "lateral position, and the ego passes on the nearer side",
        "Jansson 2005; Brännström et al. 2008",
        "0 to 5",
        _NEVER_CLOSING,
        abbreviation="STN",
        cap="5 means 5 or more",
    ),
    Measure(
        "rss_margin_m",
        "Responsibility-Sensitive Safety margin",
        "m",
        "higher",
        "the smallest difference between the gap to the vehicle ahead and RSS's safe distance; below 0 the ego was too "
        "near",
        "gap to the leader − safe distance. Safe distance = v · 0.75 s + v² ÷ (2 · 4 m/s²) − v_ahead² ÷ (2 · 8 m/s²), "
        "but at least 0; the ego keeps its speed during the response time of 0.75 s",
        "Shalev-Shwartz, Shammah and Shashua 2017, definition 1",
        "any, in practice −150 to 60",
        _NOT_AHEAD,
    ),
    Measure(
        "delta_v_mps",
        "change of velocity in the crash",
        "m/s",
        "lower",
        "the change of the ego's velocity in the collision",
        "velocity difference at first contact × the other's mass ÷ the total mass (perfectly inelastic collision). "
        "Masses: car 1,500 kg, truck and bus 12,000 kg, motorcycle 250 kg, bicycle 90 kg, pedestrian 75 kg, all other "
        "classes 1,500 kg; static obstacles do not move",
        "Shelby 2011; the masses are our choice",
        "0 to 140",
        "no collision with a road user with a known track",
        abbreviation="ΔV",
    ),
    Measure(
        "risk_score",
        "risk score",
        RISK_UNIT,
        "higher",
        f"the most dangerous time of a run by gap and time to collision ({RISK_SCALE})",
        "one level for distance and one for time to collision (thresholds 0, 0.5, 1, 3, 5 m or s); the mean of the "
        "two, rounded down; the minimum over road users and time steps",
        "From Words to Collisions (TUM-AVS, ITSC 2025)",
        "0 to 5",
        f"{NO_OTHER_NEAR}, or {LEFT_THE_ROAD}",
    ),
    Measure(
        "duration_s",
        "duration",
        "s",
        "lower",
        "time from the first to the last driven state",
        "time steps × the scenario's step length",
        "",
        "0 and more",
        "the problem is invalid",
        basis="both_reached_goal",
        tolerance=0.01,
    ),
    Measure(
        "distance_m",
        "distance driven",
        "m",
        None,
        "length of the driven path",
        "sum of the distances between the centres of successive states",
        "",
        "0 and more",
        "the problem is invalid",
        basis="both_reached_goal",
        tolerance=0.01,
    ),
    Measure(
        "progress",
        "progress",
        "1",
        "higher",
        "the share of the path to the goal that the ego covered: 1 only in the goal",
        "arc length to the farthest state ÷ arc length to the start of the goal, along the planners' reference path; "
        "for an ego that passed next to the goal, 1 − (distance from its nearest state to the goal ÷ the arc length to "
        "the start of the goal)",
        "",
        "0 to 1",
        "the goal has no position, or its path is not known",
        cap="not above 1",
    ),
    Measure(
        "mean_speed_mps",
        "mean speed",
        "m/s",
        None,
        "driven distance divided by time",
        "distance driven ÷ duration",
        "",
        "0 and more",
        "the problem is invalid",
        basis="both_reached_goal",
        tolerance=0.01,
    ),
    Measure(
        "maximum_jerk_mps3",
        "largest jerk",
        "m/s³",
        "lower",
        "largest change of the longitudinal acceleration between steps, felt as a jolt",
        "difference of successive accelerations ÷ step length, starting from the initial state's acceleration; the "
        "largest absolute value",
        "",
        "0 and more",
        _TOO_SHORT,
        basis="both_reached_goal",
        tolerance=0.01,
    ),
    Measure(
        "mean_squared_jerk",
        "mean squared jerk",
        "m²/s⁶",
        "lower",
        "mean of the squared jerk over the run: how jerky it was as a whole",
        "mean of the squared jerk over the steps",
        "",
        "0 and more",
        _TOO_SHORT,
        basis="both_reached_goal",
        tolerance=0.01,
    ),
    Measure(
        "maximum_lateral_jerk_mps3",
        "largest lateral jerk",
        "m/s³",
        "lower",
        "largest change of the lateral acceleration between steps",
        "difference of successive lateral accelerations ÷ step length",
        "",
        "0 and more",
        _TOO_SHORT,
    ),
    Measure(
        "maximum_planar_jerk_mps3",
        "largest combined jerk",
        "m/s³",
        "lower",
        "largest jerk of the longitudinal and lateral motion together",
        "magnitude of the difference of successive acceleration vectors ÷ step length; for the first step, only the "
        "longitudinal part",
        "",
        "0 and more",
        _OLD,
        basis="both_reached_goal",
        tolerance=0.01,
    ),
    Measure(
        "maximum_acceleration_mps2",
        "largest acceleration",
        "m/s²",
        "lower",
        "largest acceleration along the path",
        "largest longitudinal acceleration of the driven states after the first",
        "",
        "0 to 11.5",
        _TOO_SHORT,
    ),
    Measure(
        "maximum_braking_mps2",
        "hardest braking",
        "m/s²",
        "lower",
        "largest deceleration of the run",
        "largest longitudinal deceleration of the driven states after the first; 0 if the ego never slows down",
        "",
        "0 to 11.5",
        _OLD,
        basis="both_reached_goal",
        tolerance=0.01,
    ),
    Measure(
        "maximum_lateral_acceleration_mps2",
        "largest lateral acceleration",
        "m/s²",
        "lower",
        "largest lateral acceleration: speed times yaw rate",
        "absolute value of speed × change of heading ÷ step length",
        "",
        "0 and more",
        _TOO_SHORT,
        basis="both_reached_goal",
        tolerance=0.01,
    ),
    Measure(
        "maximum_planar_acceleration_mps2",
        "largest planar acceleration",
        "m/s²",
        "lower",
        "largest planar acceleration, longitudinal and lateral combined, which the tyres must hold",
        "magnitude of the combined longitudinal and lateral acceleration",
        "",
        "0 and more",
        _TOO_SHORT,
    ),
    Measure(
        "maximum_steering_rate_radps",
        "peak steering rate",
        "rad/s",
        "lower",
        "fastest turning of the front wheels that the driven path requires",
        "difference between the steering angles that the kinematic single-track model needs before and after a state ÷ "
        "step length",
        "Althoff and Würsching 2020",
        "0 and more",
        _OLD,
        basis="both_reached_goal",
        tolerance=0.001,
    ),
    Measure(
        "drivable_share",
        "share of drivable steps",
        "1",
        "higher",
        "the share of the steps that the vehicle can drive as driven: 1 for a feasible motion",
        "share of steps that a kinematic single-track model can drive within the tolerances of CommonRoad's "
        "drivability checker (0.02 m, 0.03 rad), the friction and the steering-rate limit; the time given is that of "
        "the first infeasible step",
        "Althoff and Würsching 2020",
        "0 to 1",
        _TOO_SHORT,
    ),
    Measure(
        "mean_total_cost",
        "mean total cost",
        "1",
        "lower",
        "mean cost of the trajectories that the planner chose; it depends on the weights",
        "mean of the sum of the weighted cost terms over the planning steps",
        "",
        "0 and more",
        "the planner has no costs, or planned nothing",
        basis="both_reached_goal",
        within_one_configuration=True,
    ),
)
"""All measures: nearness and time, then severity, then the ego's motion."""
_BY_NAME = {measure.name: measure for measure in MEASURES}


def measure_named(name: str) -> Measure | None:
    """Return the measure with this name, or None if there is no such measure."""
    return _BY_NAME.get(name)


def metric_of_label(text: str) -> str:
    """Return the name of the measure that an answer, table or legend prints as ``text``, otherwise the text itself.

    The printed forms are the name, its words with and without the explanation in brackets, and the abbreviation. Case,
    spaces and signs do not matter.
    """
    return _BY_PRINTED_NAME.get(_letters(text), text)


def _letters(text: str) -> str:
    return re.sub(r"[^a-z0-9]", "", text.casefold())


def _printed_names(measure: Measure) -> Iterator[str]:
    short = measure.words.partition(" (")[0]
    yield from (measure.name, measure.words, short)
    if measure.abbreviation:
        yield from (
            measure.abbreviation,
            f"{measure.words} ({measure.abbreviation})",
            f"{short} ({measure.abbreviation})",
        )


_BY_PRINTED_NAME = {_letters(printed): one.name for one in reversed(MEASURES) for printed in _printed_names(one)}
"""If two measures have the same printed form, the first in the list counts."""


def metric_words(name: str) -> str:
    """Return the measure's name in prose."""
    known = _BY_NAME.get(name)
    return name if known is None else known.words


def definition_rows(measures: Sequence[Measure] = MEASURES) -> tuple[tuple[str, ...], ...]:
    """Return a row per measure: name, words, unit, method, source, span with cap, and why it may be undefined."""
    return tuple(
        (
            f"`{one.name}`{', stored' if one.stored else ''}",
            f"{one.words}{f' ({one.abbreviation})' if one.abbreviation else ''}",
            f"{one.unit}, {f'{one.better} is better' if one.better else 'neither is better'}",
            one.method,
            one.source or "–",
            f"{one.span}{f'; {one.cap}' if one.cap else ''}",
            one.none,
        )
        for one in measures
    )
