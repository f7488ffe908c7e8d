"""What a look at a run finds, beyond what is stored with it: who hit whom, whose fault, pace, comfort, broken rules.

Computed from the steps of a run and its scenario when it is asked for (``engine/analysis``), and told in words here.
"""

from collections.abc import Sequence
from typing import ClassVar, Literal

from pydantic import Field

from .base import Model
from .text import measured

ContactKind = Literal[
    "rear_end_by_other",
    "rear_end_by_ego",
    "cut_in",
    "cut_in_by_ego",
    "oncoming",
    "crossing",
    "side",
    "into_standing",
    "onto_standing_ego",
    "road_boundary",
    "unclear",
]
"""Who hit whom, and from where; the rules that decide are in ``docs/runs.md``."""
BodySide = Literal["front", "rear", "left", "right"]
"""A side of a road user, as its driver sees it."""
RelativeHeading = Literal["same", "oncoming", "crossing"]
"""How another heads, seen from the ego: within 45° of it, within 45° of against it, or between."""
SeenCourse = Literal["same", "oncoming", "crossing", "standing"]
"""The course of another, seen from the ego; ``standing``: it does not move, and heads another way than the ego."""


DriverModelName = Literal["full_braking", "r157_careful", "fsm", "rss", "keep_lane"]
"""Reference drivers that are models of a driver, and planners of the same name."""
ReferenceDriverName = Literal[DriverModelName, "evading"]
"""Drivers in the ego's place: full braking, UN R157's careful and fuzzy ones, RSS, one that keeps lane and speed, and
one that steers aside by a lane's width (``docs/reference_drivers.md``)."""
DriverStart = Literal["before_contact", "start"]
"""What a driver does until it reacts: it follows the ego's own motion up to the contact, or it keeps the lane and the
speed of the start."""


REFERENCE_DRIVERS_DO = (
    "full braking at once, or UN R157's careful and fuzzy drivers or RSS, which keep the ego's speed until they see a "
    "danger"
)
"""The drivers of a verdict and what they do, for each statement that no driver prevents a collision."""


class DriverVerdict(Model):
    """Whether one reference driver prevents a collision from one start; times are those of the run, in s.

    ``until_s``: the latest moment at which it may take over and still prevents it; null: it does not prevent it.
    ``reacts_at_s``: when it first brakes or steers if it takes over at the start; null: it does not react at all.
    """

    driver: ReferenceDriverName = Field(description="the reference driver")
    start: DriverStart = Field(description="where it takes over")
    prevents: bool = Field(description="whether it prevents the collision")
    until_s: float | None = None
    reacts_at_s: float | None = None


class Prevention(Model):
    """Whether reference drivers in the ego's place prevent a collision (``docs/runs.md``), the others as they moved.

    ``drivers``: the verdict on each driver from each start; empty in what versions before stored. The other fields are
    those from ``before_contact``: ``by_braking_until_s``: the latest moment of the run at which full braking prevents
    it; None: none does. ``by_steering_until_s``: the same of steering aside, which is no reference driver and stands
    beside them; ``steering_tried``: whether it was asked, which it is not of egos that were hit from behind.
    """

    by_braking_until_s: float | None = Field(
        description="latest moment of the run at which full braking prevents it; null: it does not"
    )
    by_careful_driver: bool = Field(description="whether the careful driver of UN R157 prevents it")
    by_rss: bool = Field(description="whether a driver by RSS prevents it")
    by_fuzzy_driver: bool = Field(False, description="whether the fuzzy driver of UN R157 prevents it")
    by_steering_until_s: float | None = None
    steering_tried: bool = False
    drivers: tuple[DriverVerdict, ...] = Field((), description="each driver from each start; empty: an older version")

    @property
    def possible(self) -> bool:
        """Return whether any reference driver prevents it, from the moment before the contact or from the start."""
        by_driver = self.by_careful_driver or self.by_rss or self.by_fuzzy_driver
        return self.by_braking_until_s is not None or by_driver or bool(self._from_start(prevents=True))

    @property
    def attributable(self) -> bool:
        """Return whether UN R157's careful or its fuzzy driver prevents it from both starts."""
        if not self.drivers:
            return self.by_careful_driver or self.by_fuzzy_driver
        return any(self.prevented_by(name, "both") for name in ("r157_careful", "fsm"))

    def prevented_by(self, driver: ReferenceDriverName, start: Literal["before_contact", "start", "both"]) -> bool:
        """Return whether a driver prevents it from a start, or from both."""
        starts = ("before_contact", "start") if start == "both" else (start,)
        found = {verdict.start for verdict in self.drivers if verdict.driver == driver and verdict.prevents}
        return found.issuperset(starts)

    def in_words(self) -> str:
        """Return which drivers prevent it from which start, and until when."""
        until = self.by_steering_until_s
        aside = "" if until is None else f"; steering aside until {until:.1f} s does"
        if not self.possible:
            starts = " or from the start" if self.drivers else ""
            return f"from the moment before it{starts} no reference driver prevents it ({REFERENCE_DRIVERS_DO}){aside}"
        prevents = [] if self.by_braking_until_s is None else [f"full braking until {self.by_braking_until_s:.1f} s"]
        prevents += [] if until is None else [f"steering aside until {until:.1f} s"]
        prevents += self._drivers(prevents=True)
        if self.by_braking_until_s is None and not self._drivers(prevents=True):
            none = f"from the moment before it no reference driver prevents it ({REFERENCE_DRIVERS_DO}){aside}"
            return f"{none}{self._start_in_words()}"
        others = [*self._drivers(prevents=False), *(["steering"] if self.steering_tried and until is None else [])]
        without = f", not by {_listed(others, 'or')}" if others else ""
        return f"preventable by {_listed(prevents, 'and')}{without}{self._start_in_words()}"

    def _start_in_words(self) -> str:
        """Return which drivers prevent it from the start; empty for versions that did not examine it."""
        if not self.drivers:
            return ""
        yes, no = self._from_start(prevents=True), self._from_start(prevents=False)
        if not yes:
            return "; from the start none does"
        if not no:
            return "; from the start all do"
        return f"; from the start {_listed(yes, 'and')} {'do' if len(yes) > 1 else 'does'}"

    def _from_start(self, *, prevents: bool) -> list[str]:
        """Return the reference drivers that prevent it from the start, or do not; steering aside is not one of them."""
        return [
            _DRIVERS_IN_WORDS[verdict.driver]
            for verdict in self.drivers
            if verdict.start == "start" and verdict.prevents == prevents and verdict.driver != "evading"
        ]

    def _drivers(self, *, prevents: bool) -> list[str]:
        """Return the reference drivers beside full braking that prevent it, or do not."""
        named = {"careful": self.by_careful_driver, "fuzzy": self.by_fuzzy_driver}
        of_r157 = [name for name, does in named.items() if does == prevents]
        drivers = [f"UN R157's {' and '.join(of_r157)} driver{'s' * (len(of_r157) - 1)}"] if of_r157 else []
        return [*drivers, *(["RSS"] if self.by_rss == prevents else [])]


_DRIVERS_IN_WORDS: dict[ReferenceDriverName, str] = {
    "full_braking": "full braking",
    "r157_careful": "UN R157's careful driver",
    "fsm": "UN R157's fuzzy driver",
    "rss": "RSS",
    "keep_lane": "keeping lane and speed",
    "evading": "steering aside",
}


def _listed(parts: Sequence[str], conjunction: str) -> str:
    """Return ``a, b and c``."""
    return f" {conjunction} ".join([*([", ".join(parts[:-1])] if parts[:-1] else []), parts[-1]])


PaceCode = Literal[
    "stood_at_red",
    "stood_before_red",
    "stood_at_light",
    "stood_at_stop_sign",
    "stood_to_give_way",
    "stood_in_queue",
    "stood_behind_vehicle",
    "stood_in_goal",
    "stood_at_green",
    "stood_without_cause",
    "held_up",
    "braked_for_vehicle",
    "braked_to_give_way",
    "braked_for_light",
    "braked_for_stop_sign",
    "braked_for_curve",
    "braked_for_limit",
    "braked_for_goal",
    "braked_for_road_end",
    "braked_for_course",
    "braked_too_hard",
    "braked_without_cause",
]
"""Why an ego stood, drove slowly or braked; the rules that decide are in ``docs/runs.md``."""
EGOS_OWN: tuple[PaceCode, ...] = ("stood_at_green", "stood_without_cause", "braked_too_hard", "braked_without_cause")
"""What nothing on the road asked of the ego."""


class PaceMoment(Model):
    """A stretch of a run in which the ego stood, was held up by a slower vehicle, or braked by 2 m/s² or more, and why.

    ``obstacle_id``: the other that it is about; ``distance_m``: the gap to it, or from the ego's front to the line, at
    the beginning; ``largest_mps2``: the hardest braking, as a positive number.
    """

    code: PaceCode = Field(description="stable code: what the ego did, and why")
    since_s: float = Field(description="when it began")
    until_s: float = Field(description="when it ended")
    obstacle_id: int | None = None
    obstacle_class: str = ""
    distance_m: float | None = Field(None, description="to the other or the line, when it began")
    largest_mps2: float | None = Field(None, description="the hardest braking in it; null if the ego stood")

    @property
    def is_the_egos(self) -> bool:
        """Return whether nothing on the road asked for it."""
        return self.code in EGOS_OWN

    @property
    def duration_s(self) -> float:
        """How long it lasted."""
        return self.until_s - self.since_s

    def in_words(self) -> str:
        """Return ``stood at a green light from 14.5 s to 23.8 s, 2.1 m before its line``."""
        other = "" if self.obstacle_id is None else f"{self.obstacle_class} {self.obstacle_id}".strip()
        far = "" if self.distance_m is None else f"{self.distance_m:.1f} m"
        span = f"from {self.since_s:.1f} s to {self.until_s:.1f} s"
        by = "" if self.largest_mps2 is None else f" by up to {self.largest_mps2:.1f} m/s²"
        before = f", {far} before its line" if far else ""
        words: dict[PaceCode, str] = {
            "stood_at_red": f"stood at a red light {span}{before}",
            "stood_before_red": f"stood {span} on the way to a red light{before}",
            "stood_at_light": f"stood {span} at a light whose colour the file does not hold{before}",
            "stood_at_stop_sign": f"stood at a stop sign {span}{before}",
            "stood_to_give_way": f"stood {span} while {other} crossed its way",
            "stood_in_queue": f"stood in a queue {span}, {far} behind {other}",
            "stood_behind_vehicle": f"stood {span}, {far} behind {other}",
            "stood_in_goal": f"stood in its goal {span}, before the goal's time",
            "stood_at_green": f"stood at a green light {span}{before}, with no other in its way",
            "stood_without_cause": f"stood {span} with no other in its way and no light or sign to wait for",
            "held_up": f"followed slower {other} {span}",
            "braked_for_vehicle": f"braked{by} {span} for {other} ahead",
            "braked_to_give_way": f"braked{by} {span} for {other}, which came across its way",
            "braked_for_light": f"braked{by} {span} for a light",
            "braked_for_stop_sign": f"braked{by} {span} for a stop sign",
            "braked_for_curve": f"braked{by} {span} for a curve",
            "braked_for_limit": f"braked{by} {span} for the speed limit",
            "braked_for_goal": f"braked{by} {span} for the speed or time of its goal",
            "braked_for_road_end": f"braked{by} {span} for the end of the road",
            "braked_for_course": f"braked{by} {span} for {other}, which was on a course to meet it",
            "braked_too_hard": f"braked{by} {span}, much harder than {other or 'anything on its way'} asked for",
            "braked_without_cause": f"braked{by} {span} with nothing on its way that asked for it",
        }
        return words[self.code]


LaidTo = Literal["ego", "recording", "prediction", "planning", "neither"]
"""What a collision is laid to: what the ego did before it without a reason; another that follows a recording and would
have braked; a prediction that had the other elsewhere; a plan that had it there, although the collision is
attributable; nothing, since it is not attributable (neither UN R157's careful nor its fuzzy driver prevents it from
both starts)."""
OwnFault = Literal["slowed", "cut_in", "wrong_side", "red_light", "right_of_way"]
"""How an ego makes a collision that no reference driver on its path prevents: it stood or braked without a reason, cut
in, was on the lane of oncoming traffic, passed a red light, or took the right of way."""


class EgoFault(Model):
    """What the ego did that led to a collision, and when; ``moment``: the stand or braking, if it is one."""

    code: OwnFault = Field(description="stable code of what the ego did")
    time_s: float = Field(description="when it did it")
    moment: PaceMoment | None = None

    def in_words(self) -> str:
        """``the ego, which stood from 4.0 s to 9.0 s with no other in its way and no light or sign to wait for``."""
        if self.moment is not None:
            return f"the ego, which {self.moment.in_words()}"
        words: dict[OwnFault, str] = {
            "slowed": "the ego, which slowed down without a reason",
            "cut_in": "the ego, which cut in",
            "wrong_side": "the ego, which was on a lane of the opposite direction",
            "red_light": "the ego, which passed a red light",
            "right_of_way": "the ego, which did not give way",
        }
        return f"{words[self.code]} at {self.time_s:.1f} s"


class Contact(Model):
    """How the collision of a run came about: speeds at its step, places at the last step before it.

    ``ego_side``, ``other_side``: the sides that met. ``closing_mps``: length of the difference of both velocities.
    ``ego_stood_since_s``: where the ego stood, since when. ``braked_since_s``: from when on the ego braked by more than
    1 m/s² without a break until the contact; None: it did not. ``came_in_s``: for a cut-in, when the one ahead came
    into the way of the one behind. ``also_touched``: others that overlap the ego at the same step. ``prevention``: None
    where the tracks do not hold the one that was hit.
    ``predicted_gap_m``: how far apart the two would have been at the collision, had the other moved as the run's
    predictor said a second before; None if it was not there then, or is not known to have been predicted.
    ``laid_to``: None if that decides, or the prevention is not known. ``fault``: what the ego did, where it is laid
    to the ego.
    """

    kind: ContactKind = Field(description="how the two met")
    time_s: float = Field(description="when they met")
    ego_speed_mps: float = Field(description="speed of the ego then")
    obstacle_id: int | None = None
    obstacle_class: str = ""
    other_speed_mps: float | None = Field(None, description="speed of the other then; null of what has none")
    closing_mps: float | None = None
    ego_side: BodySide | None = Field(None, description="side of the ego that was hit; null if it is not known")
    other_side: BodySide | None = None
    ego_stood_since_s: float | None = None
    braked_since_s: float | None = None
    came_in_s: float | None = None
    also_touched: tuple[int, ...] = ()
    prevention: Prevention | None = None
    predicted_gap_m: float | None = None
    laid_to: LaidTo | None = None
    fault: EgoFault | None = Field(None, description="what the ego did, where the collision is laid to it")

    @property
    def is_unpreventable(self) -> bool:
        """Return whether no reference driver prevents it and the ego did not make it."""
        return self.prevention is not None and not self.prevention.possible and self.laid_to != "ego"

    @property
    def unforeseen(self) -> bool:
        """Return whether the two would have stayed apart, had the other moved as it was predicted a second before."""
        return self.predicted_gap_m is not None and self.predicted_gap_m > 0

    def in_words(self) -> str:
        """Who hit whom, from where, when, at which speeds, and whether the ego had braked before."""
        if self.other_speed_mps is None:
            where = "left the road" if self.obstacle_id is None else f"collided with {self._other}"
            return f"{where} at {self.time_s:.1f} s, at {self.ego_speed_mps:.1f} m/s{self._braked}"
        speeds = f"ego {self.ego_speed_mps:.1f} m/s{self._braked}; {self._other} {self.other_speed_mps:.1f} m/s"
        also = f"; also touched then: {', '.join(map(str, self.also_touched))}" if self.also_touched else ""
        # What drivers on the ego's path prevent says nothing where the ego made it by how it drove along that path.
        told = self.prevention if self.laid_to != "ego" else None
        judged = "" if told is None else f"; {told.in_words()}"
        if self.unforeseen:
            judged += f"; unforeseen: {self.predicted_gap_m:.1f} m apart as predicted a second before"
        if self.fault is not None:
            judged += f"; laid to {self.fault.in_words()}"
        elif self.laid_to is not None:
            judged += f"; laid to {'the recording' if self.laid_to == 'recording' else self.laid_to}"
        return f"{self._what} at {self.time_s:.1f} s ({speeds}){also}{judged}"

    @property
    def _other(self) -> str:
        return f"{self.obstacle_class} {self.obstacle_id}"

    @property
    def _braked(self) -> str:
        if self.kind == "onto_standing_ego":
            return "" if self.ego_stood_since_s is None else f", standing since {self.ego_stood_since_s:.1f} s"
        return ", not braking" if self.braked_since_s is None else f", braking since {self.braked_since_s:.1f} s"

    @property
    def _beside(self) -> str:
        """Return whether both were side by side, or one came in at an angle, as where lanes merge."""
        sides = {self.ego_side, self.other_side}
        return "alongside" if sides <= {"left", "right"} else "of the same direction"

    @property
    def _what(self) -> str:
        other, came = self._other, "" if self.came_in_s is None else f", in the way since {self.came_in_s:.1f} s"
        whence = {"front": "ahead", "rear": "behind", "left": "the left", "right": "the right", None: "nowhere"}
        words: dict[ContactKind, str] = {
            "rear_end_by_other": f"hit from behind by {other}",
            "rear_end_by_ego": f"ran into the back of {other}",
            "cut_in": f"ran into {other} that cut in{came}",
            "cut_in_by_ego": f"cut in ahead of {other}{came}, and was hit by it",
            "oncoming": f"met oncoming {other}, ego's {self.ego_side} to its {self.other_side}",
            "crossing": f"met crossing {other}, ego's {self.ego_side} to its {self.other_side}",
            "side": f"touched {other} {self._beside}, ego's {self.ego_side} to its {self.other_side}",
            "into_standing": f"drove into standing {other}, ego's {self.ego_side} to its {self.other_side}",
            "onto_standing_ego": f"hit while standing by {other} from {whence[self.ego_side]}",
            "road_boundary": "left the road",
            "unclear": f"collided with {other}",
        }
        return words[self.kind]


class Encounter(Model):
    """The ego and another at one moment: ``side``: on which side of the ego it is.

    ``time_to_collision_s``: with both keeping course and speed; None: they would not meet.
    """

    time_s: float = Field(description="when that was")
    obstacle_id: int
    obstacle_class: str
    gap_m: float = Field(description="distance between the two")
    side: BodySide
    direction: SeenCourse = Field(description="course of the other, seen from the ego")
    ego_speed_mps: float = Field(description="speed of the ego")
    other_speed_mps: float = Field(description="speed of the other")
    time_to_collision_s: float | None

    @property
    def other(self) -> str:
        """Class and id."""
        return f"{self.obstacle_class} {self.obstacle_id}"

    @property
    def place(self) -> str:
        """``ahead``, ``behind``, ``on the left``, ``oncoming on the right``, ``standing on the right``."""
        where = {"front": "ahead", "rear": "behind", "left": "on the left", "right": "on the right"}[self.side]
        return where if self.direction == "same" else f"{self.direction} {where}"


class LargestMotion(Model):
    """The largest value of one motion of the ego, and when; braking and jerk are given as positive numbers."""

    name: Literal["acceleration", "braking", "lateral acceleration", "jerk"] = Field(description="the motion")
    value: float = Field(description="its largest value, in `unit`")
    unit: str
    time_s: float = Field(description="when that was")


class ComfortExcess(Model):
    """A motion above a comfort limit: its largest mean over ``window_s`` (0: at a step) and where that window ends."""

    name: Literal["acceleration", "braking", "braking jerk", "lateral acceleration", "lateral jerk"] = Field(
        description="the motion"
    )
    value: float = Field(description="its largest mean, in `unit`")
    limit: float = Field(description="the comfort limit, in `unit`")
    unit: str
    window_s: float = Field(description="length of the window that is averaged; 0: a single step")
    time_s: float = Field(description="when that window ends")
    source: str = Field(description="where the limit comes from")

    def in_words(self) -> str:
        """Return ``braking 4.2 m/s² over 2 s, until 3.1 s (limit 3.5, ISO 15622:2018)``."""
        when = f"over {self.window_s:g} s, until {self.time_s:.1f} s" if self.window_s else f"at {self.time_s:.1f} s"
        return f"{self.name} {self.value:.1f} {self.unit} {when} (limit {self.limit:.2g}, {self.source})"


class RunReview(Model):
    """The decisive moments of one run; a moment that there was not is None.

    ``closest``: the smallest gap; ``most_urgent``: the smallest time to collision. ``uncomfortable``: motions above the
    limits of ``docs/runs.md``, whatever the outcome. ``pace``: where the ego stood, was held up or braked, and why.
    """

    run_id: str
    contact: Contact | None = Field(None, description="the collision; null without one")
    closest: Encounter | None = None
    most_urgent: Encounter | None = None
    largest: tuple[LargestMotion, ...] = Field((), description="the largest motions of the ego")
    uncomfortable: tuple[ComfortExcess, ...] = ()
    pace: tuple[PaceMoment, ...] = Field((), description="where the ego stood, was held up or braked, and why")

    def pace_in_words(self) -> str:
        """Return what the ego did by itself; empty if nothing."""
        own = [moment.in_words() for moment in self.pace if moment.is_the_egos]
        return f"The ego's own doing: {'; '.join(own)}." if own else ""

    def nearness_in_words(self) -> str:
        """Return the closest moment and the shortest time to a collision, in one line; what there was not is said."""
        if self.closest is None:
            return "Closest: none: no other within 60 m."
        near, urgent = self.closest, self.most_urgent
        line = f"Closest: {near.gap_m:.2f} m to {near.other} {near.place} at {near.time_s:.1f} s"
        line += f" (ego {near.ego_speed_mps:.1f}, it {near.other_speed_mps:.1f} m/s)"
        if urgent is None:
            return f"{line}; time to collision: none: never on a collision course."
        least = f"least time to collision {measured(urgent.time_to_collision_s)} s"
        if (urgent.obstacle_id, urgent.time_s) == (near.obstacle_id, near.time_s):
            return f"{line}; {least}, then."
        whom = "it" if urgent.obstacle_id == near.obstacle_id else urgent.other
        return f"{line}; {least} with {whom} {urgent.place} at {urgent.time_s:.1f} s."

    def motion_in_words(self) -> str:
        """Return the largest motions with their times; empty without steps."""
        parts = [f"{one.name} {measured(one.value)} {one.unit} at {one.time_s:.1f} s" for one in self.largest]
        return f"Largest: {', '.join(parts)}." if parts else ""


class RuleVerdict(Model):
    """What a run makes of a traffic rule (``docs/traffic_rules.md``).

    ``robustness``: how far the rule is from being broken at the worst step, in its unit, negative where it is broken;
    None: the run had nothing that it is about. ``time_s``: of the worst step; ``first_s``: from when on it is broken.
    """

    TOLERANCE: ClassVar[float] = 0.01
    """Files hold centimetres: a rule is broken by more than this."""

    rule: str = Field(description="stable name of the rule")
    name: str = Field(description="the rule in words")
    unit: str = Field(description="unit of `robustness`")
    robustness: float | None
    time_s: float | None = None
    first_s: float | None = None
    obstacle_id: int | None = None

    @property
    def violated(self) -> bool:
        """Return whether the run broke the rule."""
        return self.first_s is not None

    @property
    def degree(self) -> float:
        """By how much the rule is broken at worst; 0 if it is kept."""
        return -self.robustness if self.violated and self.robustness is not None else 0.0

    def in_words(self) -> str:
        """Return ``R_G1 safe distance by 12.3 m at 2.0 s (from 1.2 s on, obstacle 42)``."""
        more = [f"from {self.first_s:.1f} s on"] if self.first_s != self.time_s else []
        more += [f"obstacle {self.obstacle_id}"] if self.obstacle_id is not None else []
        told = f" ({', '.join(more)})" if more else ""
        return f"{self.rule} {self.name} by {measured(self.degree)} {self.unit} at {self.time_s:.1f} s{told}"


class RunLook(Model):
    """What one look at a run's steps and scenario gives, as it is kept beside the run: its moments, and about its goal.

    ``out_of_reach``: whether no ego could be there in time; ``trivial``: why the goal asked for no driving, empty if it
    did.
    """

    VERSION: ClassVar[int] = 3
    """Of the rules that decide; what is kept of another version is not read."""

    review: RunReview
    out_of_reach: bool = False
    trivial: str = ""


class LooksResponse(Model):
    """A look at each run, in the order of the request."""

    looks: tuple[RunLook, ...]


class ReviewResponse(Model):
    """The decisive moments of each run, in the order of the request."""

    reviews: tuple[RunReview, ...]
