"""Reviews of runs, in addition to their records: who hit whom, who was at fault, pace, comfort and broken rules.

``engine/analysis`` computes reviews on request from a run's steps and its scenario. This module puts them into words.
"""

from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal

from pydantic import Field

from .base import Model
from .text import REFERENCE_DRIVERS_DO, class_noun, measured
from .worlds import SightCode

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
"""Who hit whom, and from where; ``docs/runs.md`` states the rules."""
_KINDS = {"rear_end_by_ego": "rear-end by the ego", "rear_end_by_other": "rear-end by another vehicle"}
BodySide = Literal["front", "rear", "left", "right"]
"""A side of a road user, as its driver sees it."""
RelativeHeading = Literal["same", "oncoming", "crossing"]
"""The heading of another road user relative to the ego's: within 45° of it, within 45° of the opposite, or between."""
SeenCourse = Literal["same", "oncoming", "crossing", "standing"]
"""The course of another road user, seen from the ego; ``standing``: it does not move and has a different heading."""


DriverModelName = Literal["full_braking", "r157_careful", "fsm", "rss", "keep_lane"]
"""Reference drivers that are driver models; for each, there is also a planner of the same name."""
CAREFUL_DRIVERS: tuple[DriverModelName, ...] = ("r157_careful", "fsm")
"""The drivers that make a failure avoidable if one of them prevents it: UN R157's careful and fuzzy drivers."""
ReferenceDriverName = Literal[DriverModelName, "evading"]
"""Drivers in the ego's place: full braking, UN R157's careful and fuzzy drivers, RSS, keeping lane and speed, and
steering aside by a lane's width (``docs/reference_drivers.md``)."""
DriverStart = Literal["before_contact", "start"]
"""What a driver does until it reacts: it follows the ego's own motion, or it keeps its initial lane and speed."""


def kind_in_words(kind: str) -> str:
    """Return a kind of contact, or an outcome without contact, as words."""
    return _KINDS.get(kind, kind.replace("_", " "))


class DriverVerdict(Model):
    """The verdict on one reference driver: whether it prevents a collision from one start. Times are in s of the run.

    ``until_s`` is the latest time at which it can take over and still prevent the collision, or null if it cannot.
    ``reacts_at_s`` is when it first brakes or steers if it takes over at the start, or null if it does not react.
    """

    driver: ReferenceDriverName = Field(description="the reference driver")
    start: DriverStart = Field(description="where it takes over")
    prevents: bool = Field(description="whether it prevents the collision")
    until_s: float | None = None
    reacts_at_s: float | None = None


class Prevention(Model):
    """The verdicts of reference drivers on a collision: whether they prevent it in the ego's place (see docs/runs.md).

    ``drivers`` holds the verdict on each driver from each start, and is empty in runs of older versions. The other
    fields state the verdicts from ``before_contact``. ``by_braking_until_s`` is the latest time at which full braking
    prevents the collision, or None. ``by_steering_until_s`` is the same for steering aside, which is not a reference
    driver. ``steering_tried`` is False if the ego was hit from behind, because steering aside is not examined then.
    """

    by_braking_until_s: float | None = Field(
        description="latest time at which full braking prevents it; null: it does not"
    )
    by_careful_driver: bool = Field(description="whether the careful driver of UN R157 prevents it")
    by_rss: bool = Field(description="whether a driver by RSS prevents it")
    by_fuzzy_driver: bool = Field(False, description="whether the fuzzy driver of UN R157 prevents it")
    by_steering_until_s: float | None = None
    steering_tried: bool = False
    drivers: tuple[DriverVerdict, ...] = Field(
        (), description="verdict on each driver from each start; empty: older version"
    )

    @property
    def possible(self) -> bool:
        """Whether a reference driver prevents the collision if it takes over mid-run or at the start."""
        by_driver = self.by_careful_driver or self.by_rss or self.by_fuzzy_driver
        return self.by_braking_until_s is not None or by_driver or bool(self._from_start(prevents=True))

    @property
    def attributable(self) -> bool:
        """Whether UN R157's careful or fuzzy driver prevents the collision from both starts."""
        if not self.drivers:
            return self.by_careful_driver or self.by_fuzzy_driver
        return any(self.prevented_by(name, "both") for name in CAREFUL_DRIVERS)

    def prevented_by(self, driver: ReferenceDriverName, start: Literal["before_contact", "start", "both"]) -> bool:
        """Return whether a driver prevents the collision from a start, or from both."""
        starts = ("before_contact", "start") if start == "both" else (start,)
        found = {verdict.start for verdict in self.drivers if verdict.driver == driver and verdict.prevents}
        return found.issuperset(starts)

    def in_words(self) -> str:
        """Return as text which drivers prevent the collision, from which start, and how late they still can."""
        until = self.by_steering_until_s
        braking = self.by_braking_until_s
        aside = "" if until is None else f"; swerving no later than {until:.1f} s prevents it"
        if not self.possible:
            starts = ", whether it takes over mid-run or at the start" if self.drivers else ""
            return f"no reference driver prevents it{starts} ({REFERENCE_DRIVERS_DO}){aside}"
        prevents = [] if braking is None else [f"full braking (no later than {braking:.1f} s)"]
        prevents += [] if until is None else [f"swerving (no later than {until:.1f} s)"]
        prevents += self._drivers(prevents=True)
        is_r157_named = self.by_careful_driver or self.by_fuzzy_driver
        if braking is None and not self._drivers(prevents=True):
            none = "no reference driver that takes over mid-run prevents it"
            return f"{none} ({REFERENCE_DRIVERS_DO}){aside}{self._start_in_words()}"
        others = self._drivers(prevents=False, short=is_r157_named)
        others += ["swerving"] if self.steering_tried and until is None else []
        verb = "prevents" if _is_singular(prevents) else "prevent"
        without = f", but {_listed(others, 'and')} {'does' if _is_singular(others) else 'do'} not" if others else ""
        by = f"{_listed(prevents, 'and')} {verb} it"
        return f"if a reference driver takes over mid-run, {by}{without}{self._start_in_words()}"

    def _start_in_words(self) -> str:
        """Return which drivers prevent the collision from the start, as text; empty for runs of older versions."""
        if not self.drivers:
            return ""
        at_start = "; if a driver takes over at the start,"
        yes, no = self._from_start(prevents=True), self._from_start(prevents=False)
        if not yes:
            return f"{at_start} no reference driver prevents it"
        if not no:
            return f"{at_start} all prevent it"
        driven = [word for name, word in _DRIVERS_IN_SHORT.items() if name in yes]
        named = [f"the {_listed(driven, 'and')} driver{'s' * (len(driven) > 1)}"] if driven else []
        listed = [*(words for name, words in _MANOEUVRES.items() if name in yes), *named]
        verb = "prevent" if len(yes) > 1 else "prevents"
        return f"{at_start} {_listed(listed, 'and')} {verb} it"

    def _from_start(self, *, prevents: bool) -> list[ReferenceDriverName]:
        """Return the reference drivers that do or do not prevent the collision from the start; steering is left out."""
        return [
            verdict.driver
            for verdict in self.drivers
            if verdict.start == "start" and verdict.prevents == prevents and verdict.driver != "evading"
        ]

    def _drivers(self, *, prevents: bool, short: bool = False) -> list[str]:
        """Return the reference drivers, other than full braking, that do or do not prevent the collision."""
        named = {"careful": self.by_careful_driver, "fuzzy": self.by_fuzzy_driver}
        of_r157 = [name for name, does in named.items() if does == prevents]
        owner = "the" if short else "UN regulation R157's"
        drivers = [f"{owner} {' and '.join(of_r157)} driver{'s' * (len(of_r157) - 1)}"] if of_r157 else []
        return [*drivers, *(["the Responsibility-Sensitive Safety (RSS) driver"] if self.by_rss == prevents else [])]


_DRIVERS_IN_SHORT: dict[ReferenceDriverName, str] = {"r157_careful": "careful", "fsm": "fuzzy", "rss": "RSS"}
"""The drivers after their first mention, which spells them out."""
_MANOEUVRES: dict[ReferenceDriverName, str] = {"full_braking": "full braking", "keep_lane": "keeping lane and speed"}
"""The verdicts that answers call by the manoeuvre."""


def _listed(parts: Sequence[str], conjunction: str) -> str:
    """Return text such as ``a, b and c``."""
    return f" {conjunction} ".join([*([", ".join(parts[:-1])] if parts[:-1] else []), parts[-1]])


def _is_singular(parts: Sequence[str]) -> bool:
    """Return whether a list of drivers and manoeuvres takes a singular verb."""
    return len(parts) == 1 and not parts[0].endswith("drivers")


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
"""Why an ego stood, drove slowly or braked; ``docs/runs.md`` states the rules."""
EGOS_OWN: tuple[PaceCode, ...] = ("stood_at_green", "stood_without_cause", "braked_too_hard", "braked_without_cause")
"""Actions of the ego that nothing on the road required."""


class PaceMoment(Model):
    """A span of a run in which the ego stood, was held up, or braked at 2 m/s² or more, and the reason.

    ``obstacle_id`` is the road user that caused it. ``distance_m`` is the gap to it, or from the ego's front to the
    stop line, at the beginning. ``largest_mps2`` is the hardest braking, as a positive number.
    """

    code: PaceCode = Field(description="stable code: what the ego did, and why")
    since_s: float = Field(description="when it began")
    until_s: float = Field(description="when it ended")
    obstacle_id: int | None = None
    obstacle_class: str = ""
    distance_m: float | None = Field(None, description="gap to the other or to the stop line when it began")
    largest_mps2: float | None = Field(None, description="the hardest braking in it; null if the ego stood")

    @property
    def is_the_egos(self) -> bool:
        """Whether nothing on the road required the ego to stand or brake."""
        return self.code in EGOS_OWN

    @property
    def duration_s(self) -> float:
        """The duration in s."""
        return self.until_s - self.since_s

    def in_words(self) -> str:
        """Return text such as ``stood at a green light from 14.5 s to 23.8 s, 2.1 m before its line``."""
        other = "" if self.obstacle_id is None else f"{self.obstacle_class} {self.obstacle_id}".strip()
        far = "" if self.distance_m is None else f"{self.distance_m:.1f} m"
        span = f"from {self.since_s:.1f} s to {self.until_s:.1f} s"
        by = "" if self.largest_mps2 is None else f" by up to {self.largest_mps2:.1f} m/s²"
        before = f", {far} before its line" if far else ""
        texts: dict[PaceCode, str] = {
            "stood_at_red": f"stood at a red light {span}{before}",
            "stood_before_red": f"stood {span} while approaching a red light{before}",
            "stood_at_light": f"stood {span} at a light with no colour in the file{before}",
            "stood_at_stop_sign": f"stood at a stop sign {span}{before}",
            "stood_to_give_way": f"stood {span} while {other} crossed its path",
            "stood_in_queue": f"stood in a queue {span}, {far} behind {other}",
            "stood_behind_vehicle": f"stood {span}, {far} behind {other}",
            "stood_in_goal": f"stood in its goal {span}, before the goal's time",
            "stood_at_green": f"stood at a green light {span}{before}, with a clear path",
            "stood_without_cause": f"stood {span} with a clear path and no light or sign to wait for",
            "held_up": f"followed the slower {other} {span}",
            "braked_for_vehicle": f"braked{by} {span} for {other} ahead",
            "braked_to_give_way": f"braked{by} {span} for {other}, which crossed its path",
            "braked_for_light": f"braked{by} {span} for a light",
            "braked_for_stop_sign": f"braked{by} {span} for a stop sign",
            "braked_for_curve": f"braked{by} {span} for a curve",
            "braked_for_limit": f"braked{by} {span} for the speed limit",
            "braked_for_goal": f"braked{by} {span} for the speed or time of its goal",
            "braked_for_road_end": f"braked{by} {span} for the end of the road",
            "braked_for_course": f"braked{by} {span} for {other}, which was on a collision course",
            "braked_too_hard": f"braked{by} {span}, much harder than {other or 'anything on its path'} required",
            "braked_without_cause": f"braked{by} {span} although nothing on its path required it",
        }
        return texts[self.code]


CollisionCause = Literal["ego", "recording", "perception", "prediction", "planning", "neither"]
"""What a collision is attributed to.

- ``ego``: something that the ego did earlier without a reason
- ``recording``: another road user that follows its recording, and would otherwise have braked
- ``perception``: in an imperfect world, the planner did not get the other road user when it could last have braked
- ``prediction``: the prediction placed the other road user elsewhere
- ``planning``: the prediction placed the other road user correctly, and the collision is attributable
- ``neither``: the collision is not attributable: neither UN R157's careful nor its fuzzy driver prevents it from both
  starts"""
COLLISION_CAUSES: Mapping[CollisionCause, str] = {
    "ego": "the ego",
    "recording": "the recording",
    "perception": "the perception",
    "prediction": "the prediction",
    "planning": "the plan",
    "neither": "neither side",
}
"""Noun phrases for the causes."""
OwnFault = Literal["slowed", "cut_in", "wrong_side", "red_light", "right_of_way"]
"""How an ego causes a collision that no reference driver on its path prevents.

It stood or braked without a reason, cut in, was on an oncoming lane, ran a red light, or did not give way."""


class EgoFault(Model):
    """The ego's action that led to a collision, and its time; ``moment`` is the stop or braking, if there was one."""

    code: OwnFault = Field(description="stable code of what the ego did")
    time_s: float = Field(description="when it did it")
    moment: PaceMoment | None = None

    def in_words(self) -> str:
        """Return text such as ``the ego, which stood from 4.0 s to 9.0 s with a clear path and no light …``."""
        if self.moment is not None:
            return f"the ego, which {self.moment.in_words()}"
        texts: dict[OwnFault, str] = {
            "slowed": "the ego, which slowed down without a reason",
            "cut_in": "the ego, which cut in",
            "wrong_side": "the ego, which was on a lane of the opposite direction",
            "red_light": "the ego, which ran a red light",
            "right_of_way": "the ego, which did not give way",
        }
        return f"{texts[self.code]} at {self.time_s:.1f} s"


class Sight(Model):
    """When a planner in an imperfect world began to receive the road user that it hit, and why it did not receive it
    earlier.

    ``code`` is the last reason for which the planner did not receive the road user; ``by`` and ``by_class`` describe
    the road user that hid the largest part of it. ``first_s`` is the time at which the planner first received it, and
    ``since_s`` the time from which it received it without a gap until the contact. Both are None if it never did.
    """

    code: SightCode = Field(description="stable code: why the planner did not get it")
    by: int | None = Field(None, description="the road user that hid it; null without one")
    by_class: str = ""
    first_s: float | None = Field(description="when the planner first got it; null if never")
    since_s: float | None = Field(description="since when it got it up to the contact; null if it did not")

    def in_words(self, other: str, time_s: float) -> str:
        """Return text such as ``bicycle 3074 was hidden by truck 12 until 1.2 s before the contact (occluded); …``."""
        until = (
            "up to the contact" if self.since_s is None else f"until {time_s - self.since_s:.1f} s before the contact"
        )
        lost = "" if self.first_s == self.since_s else ", then lost"
        first = "never seen" if self.first_s is None else f"first seen at {self.first_s:.1f} s{lost}"
        return f"{_sight_in_words(self.code, other, self.by, self.by_class)} {until} ({self.code}); {first}"


def _sight_in_words(code: SightCode, other: str, by: int | None, by_class: str) -> str:
    """Return a sentence without its time on how the sensors reported a road user, such as ``car 7 was hidden by …``."""
    hider = "other bodies" if by is None else f"{by_class} {by}".strip()
    texts: dict[SightCode, str] = {
        "seen": f"{other} was reported",
        "kept": f"{other} was reported only by extrapolation",
        "out_of_range": f"{other} was out of the sensors' range",
        "out_of_view": f"{other} was outside the field of view",
        "occluded": f"{other} was hidden by {hider}",
        "missed": f"{other} was in view but not detected",
        "unconfirmed": f"{other} was detected too recently to be reported",
    }
    return texts[code]


class Unseen(Model):
    """A time in which a planner in an imperfect world did not receive a road user within the sensors' range.

    ``code`` is the reason. ``by`` and ``by_class`` describe the road user that hid the largest part of it. ``until_s``
    is None if it was not received again.
    """

    obstacle_id: int
    obstacle_class: str
    code: SightCode = Field(description="stable code: why the planner did not get it")
    by: int | None = Field(None, description="the road user that hid it; null without one")
    by_class: str = ""
    from_s: float = Field(description="since when the planner did not get it")
    until_s: float | None = Field(description="when the planner got it again; null if it did not")
    nearest_m: float = Field(description="smallest distance between the centres in that time")

    def in_words(self) -> str:
        """Return text such as ``car 7 was hidden by truck 12 from 0.3 to 1.2 s, 9 m or more away (occluded)``."""
        other = f"{class_noun(self.obstacle_class)} {self.obstacle_id}"
        what = _sight_in_words(self.code, other, self.by, self.by_class)
        time = (
            f"from {self.from_s:.1f} s on"
            if self.until_s is None
            else f"from {self.from_s:.1f} to {self.until_s:.1f} s"
        )
        return f"{what} {time}, {self.nearest_m:.0f} m or more away ({self.code})"


class Contact(Model):
    """How the collision of a run happened: speeds at its time step, positions at the last step before it.

    - ``ego_side``, ``other_side``: the sides that touched
    - ``closing_mps``: magnitude of the difference of the velocities
    - ``ego_stood_since_s``: the start of the ego's standstill, if it was standing
    - ``braked_since_s``: the start of uninterrupted braking at more than 1 m/s²; None if the ego was not braking
    - ``came_in_s``: for a cut-in, when the vehicle ahead entered the path of the one behind
    - ``also_touched``: others that overlap the ego at the same step
    - ``prevention``: None if the tracks do not contain the road user that was hit
    - ``predicted_gap_m``: the gap at the collision if the other had moved as predicted 1 s earlier; None if it was not
      present then, or if it is not known whether it was predicted
    - ``laid_to``: the cause; None if that gap or the prevention is needed and not known
    - ``fault``: what the ego did, if the cause is the ego
    - ``sight``: in an imperfect world, when the planner began to receive the other; None if it always did
    """

    kind: ContactKind = Field(description="how the two met")
    time_s: float = Field(description="when they met")
    ego_speed_mps: float = Field(description="speed of the ego then")
    obstacle_id: int | None = None
    obstacle_class: str = ""
    other_speed_mps: float | None = Field(None, description="speed of the other then; null if it has none")
    closing_mps: float | None = None
    ego_side: BodySide | None = Field(None, description="side of the ego that was hit; null if not known")
    other_side: BodySide | None = None
    ego_stood_since_s: float | None = None
    braked_since_s: float | None = None
    came_in_s: float | None = None
    also_touched: tuple[int, ...] = ()
    prevention: Prevention | None = None
    predicted_gap_m: float | None = None
    laid_to: CollisionCause | None = None
    fault: EgoFault | None = Field(None, description="what the ego did, if the collision is attributed to it")
    sight: Sight | None = Field(
        None, exclude_if=lambda sight: sight is None, description="why and until when the planner did not get the other"
    )

    @property
    def is_unpreventable(self) -> bool:
        """Whether no reference driver prevents the collision and the ego did not cause it."""
        return self.prevention is not None and not self.prevention.possible and self.laid_to != "ego"

    @property
    def unforeseen(self) -> bool:
        """Whether the two would have stayed apart if the other had moved as predicted 1 s earlier."""
        return self.predicted_gap_m is not None and self.predicted_gap_m > 0

    def in_words(self) -> str:
        """Return who hit whom, from where, when, at which speeds, and whether the ego had braked."""
        if self.other_speed_mps is None:
            event = "left the road" if self.obstacle_id is None else f"collided with {self.other}"
            return f"{event} at {self.time_s:.1f} s, at {self.ego_speed_mps:.1f} m/s{self._braked}"
        speeds = f"ego {self.ego_speed_mps:.1f} m/s{self._braked}; {self.other}: {self.other_speed_mps:.1f} m/s"
        also = f"; also touched: {', '.join(map(str, self.also_touched))}" if self.also_touched else ""
        # If the ego caused it by driving along its path as it did, drivers on that path say nothing.
        prevention = self.prevention if self.laid_to != "ego" else None
        judged = ""
        if self.fault is not None:
            judged += f"; attributed to {self.fault.in_words()}"
        elif self.laid_to is not None:
            follows = f", in which {self.other} cannot react" if self.laid_to == "recording" else ""
            judged += f"; attributed to {COLLISION_CAUSES[self.laid_to]}{follows}"
        if self.unforeseen:
            judged += f"; unforeseen: the prediction 1 s earlier left them {self.predicted_gap_m:.1f} m apart"
        if self.sight is not None:
            judged += f"; {self.sight.in_words(self.other, self.time_s)}"
        judged += "" if prevention is None else f"; {prevention.in_words()}"
        return f"{self._what} at {self.time_s:.1f} s ({speeds}){also}{judged}"

    @property
    def other(self) -> str:
        """The class and id of the other road user."""
        return f"{class_noun(self.obstacle_class)} {self.obstacle_id}"

    @property
    def _braked(self) -> str:
        if self.kind == "onto_standing_ego":
            return "" if self.ego_stood_since_s is None else f", standing since {self.ego_stood_since_s:.1f} s"
        return ", not braking" if self.braked_since_s is None else f", braking since {self.braked_since_s:.1f} s"

    @property
    def _alignment(self) -> str:
        """How the two were aligned: side by side, or one at an angle, for example while merging."""
        sides = {self.ego_side, self.other_side}
        return "alongside" if sides <= {"left", "right"} else "while both drove in the same direction"

    @property
    def _what(self) -> str:
        other, came = self.other, "" if self.came_in_s is None else f" at {self.came_in_s:.1f} s"
        directions = {"front": "ahead", "rear": "behind", "left": "the left", "right": "the right", None: "nowhere"}
        sides = f"the ego's {self.ego_side} against its {self.other_side}"
        texts: dict[ContactKind, str] = {
            "rear_end_by_other": f"hit from behind by {other}",
            "rear_end_by_ego": f"ran into the back of {other}",
            "cut_in": f"ran into {other}, which had cut in{came},",
            "cut_in_by_ego": f"cut in ahead of {other}{came}, and was hit by it",
            "oncoming": f"hit oncoming {other} ({sides})",
            "crossing": f"hit crossing {other} ({sides})",
            "side": f"touched {other} {self._alignment} ({sides})",
            "into_standing": f"drove into standing {other} ({sides})",
            "onto_standing_ego": f"was hit by {other} from {directions[self.ego_side]} while stationary",
            "road_boundary": "left the road",
            "unclear": f"collided with {other}",
        }
        return texts[self.kind]


class Encounter(Model):
    """The ego and another road user at one time; ``side`` is the side of the ego on which the other is.

    ``time_to_collision_s`` assumes that the two keep their course and speed, and is None if they would not meet.
    """

    time_s: float = Field(description="time of the encounter")
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
        """The class and id of the other road user."""
        return f"{class_noun(self.obstacle_class)} {self.obstacle_id}"

    @property
    def place(self) -> str:
        """The position, such as ``ahead``, ``on the left``, ``oncoming on the right`` or ``standing on the right``."""
        where = {"front": "ahead", "rear": "behind", "left": "on the left", "right": "on the right"}[self.side]
        return where if self.direction == "same" else f"{self.direction} {where}"


class LargestMotion(Model):
    """The largest value of one quantity of the ego's motion, and its time; braking and jerk are positive numbers."""

    name: Literal["acceleration", "braking", "lateral acceleration", "jerk"] = Field(description="the motion")
    value: float = Field(description="its largest value, in `unit`")
    unit: str
    time_s: float = Field(description="time of that value")


class ComfortExcess(Model):
    """A motion above a comfort limit, averaged over ``window_s`` (0 for a single step), and the end of that window."""

    name: Literal["acceleration", "braking", "braking jerk", "lateral acceleration", "lateral jerk"] = Field(
        description="the motion"
    )
    value: float = Field(description="its largest mean, in `unit`")
    limit: float = Field(description="the comfort limit, in `unit`")
    unit: str
    window_s: float = Field(description="length of the window that is averaged; 0: a single step")
    time_s: float = Field(description="when that window ends")
    source: str = Field(description="source of the limit")

    def in_words(self) -> str:
        """Return text such as ``braking 4.2 m/s² over 2 s, until 3.1 s (limit 3.5, ISO 15622:2018)``."""
        when = f"over {self.window_s:g} s, until {self.time_s:.1f} s" if self.window_s else f"at {self.time_s:.1f} s"
        return f"{self.name} {self.value:.1f} {self.unit} {when} (limit {self.limit:.2g}, {self.source})"


class RunReview(Model):
    """The key moments of one run; None for an event that did not happen.

    ``closest`` has the smallest gap, ``most_urgent`` the smallest time to collision. ``uncomfortable`` lists motions
    above the limits of ``docs/runs.md``, for every outcome. ``pace`` lists where the ego stood, was held up or braked,
    and why.
    """

    run_id: str
    contact: Contact | None = Field(None, description="the collision; null without one")
    closest: Encounter | None = None
    most_urgent: Encounter | None = None
    largest: tuple[LargestMotion, ...] = Field((), description="the largest motions of the ego")
    uncomfortable: tuple[ComfortExcess, ...] = ()
    pace: tuple[PaceMoment, ...] = Field((), description="where the ego stood, was held up or braked, and why")
    unseen: tuple[Unseen, ...] = Field(
        (), exclude_if=lambda unseen: not unseen, description="road users that the planner did not get, nearest first"
    )
    unseen_times: int = Field(0, exclude_if=lambda count: not count, description="how many such times there are in all")

    def unseen_in_words(self) -> str:
        """Return a sentence on the road users that the planner did not receive; empty if it received all."""
        if not self.unseen:
            return ""
        more = self.unseen_times - len(self.unseen)
        rest = f"; and {more} more, farther away" if more > 0 else ""
        return f"Not received: {'; '.join(one.in_words() for one in self.unseen)}{rest}."

    def pace_in_words(self) -> str:
        """Return a sentence on stops, slow driving and braking without an external cause; empty if there are none."""
        own = [moment.in_words() for moment in self.pace if moment.is_the_egos]
        return f"The ego {'; '.join(own)}." if own else ""

    def nearness_in_words(self) -> str:
        """Return a line on the smallest gap and the shortest time to collision, or on why there is no such value."""
        if self.closest is None:
            return "Closest: no other road user within 60 m."
        near, urgent = self.closest, self.most_urgent
        line = f"Closest: {near.gap_m:.2f} m to {near.other} {near.place} at {near.time_s:.1f} s"
        line += f" (ego {near.ego_speed_mps:.1f}, other {near.other_speed_mps:.1f} m/s)"
        if urgent is None:
            return f"{line}; never on a collision course."
        least = f"shortest time to collision {measured(urgent.time_to_collision_s)} s"
        if (urgent.obstacle_id, urgent.time_s) == (near.obstacle_id, near.time_s):
            return f"{line}; {least}, at the same time."
        return f"{line}; {least} with {urgent.other} {urgent.place} at {urgent.time_s:.1f} s."

    def motion_in_words(self) -> str:
        """Return the peak accelerations and jerks with their times; empty if there are no steps."""
        parts = [f"{one.name} {measured(one.value)} {one.unit} at {one.time_s:.1f} s" for one in self.largest]
        return f"Largest: {', '.join(parts)}." if parts else ""


class RuleVerdict(Model):
    """The verdict on a run for one traffic rule (``docs/traffic_rules.md``).

    ``robustness`` is the smallest margin to a violation in the rule's unit, negative if the rule is broken, or None if
    the rule did not apply. ``time_s`` is the time of the smallest margin, and ``first_s`` the start of the violation.
    """

    TOLERANCE: ClassVar[float] = 0.01
    """Files store centimetres, so a rule counts as broken only beyond this."""

    rule: str = Field(description="stable name of the rule")
    name: str = Field(description="name of the rule")
    unit: str = Field(description="unit of `robustness`")
    robustness: float | None
    time_s: float | None = None
    first_s: float | None = None
    obstacle_id: int | None = None

    @property
    def violated(self) -> bool:
        """Whether the run broke the rule."""
        return self.first_s is not None

    @property
    def degree(self) -> float:
        """The largest violation; 0 if the rule is kept."""
        return -self.robustness if self.violated and self.robustness is not None else 0.0

    def in_words(self) -> str:
        """Return text such as ``R_G1 safe distance by 12.3 m at 2.0 s (from 1.2 s on, obstacle 42)``."""
        more = [f"from {self.first_s:.1f} s on"] if self.first_s != self.time_s else []
        more += [f"obstacle {self.obstacle_id}"] if self.obstacle_id is not None else []
        details = f" ({', '.join(more)})" if more else ""
        return f"{self.rule} ({self.name}) by {measured(self.degree)} {self.unit} at {self.time_s:.1f} s{details}"


def broken_in_words(verdicts: Sequence[RuleVerdict], shown: int, where: str) -> str:
    """Return a sentence on the broken rules of a run, with ``where`` to read about the rest; empty if it kept all."""
    broken = [verdict for verdict in verdicts if verdict.violated]
    if not broken:
        return ""
    rest = f"; {len(broken) - shown} more: {where}" if len(broken) > shown else ""
    return f"traffic rules broken: {'; '.join(verdict.in_words() for verdict in broken[:shown])}{rest}."


class RunLook(Model):
    """The stored review of a run, computed from its steps and its scenario.

    ``out_of_reach`` is True if no ego could reach the goal in time. ``trivial`` states why the goal required no
    driving, and is empty if it required some.
    """

    VERSION: ClassVar[int] = 4
    """The version of the rules. A look of another version is not read."""

    review: RunReview
    out_of_reach: bool = False
    trivial: str = ""


class LooksResponse(Model):
    """The review of each run, in the order of the request."""

    looks: tuple[RunLook, ...]


class ReviewResponse(Model):
    """The key moments of each run, in the order of the request; ``broken``: the traffic rules that it broke, by id."""

    reviews: tuple[RunReview, ...]
    broken: dict[str, tuple[RuleVerdict, ...]] = Field(default_factory=dict)
