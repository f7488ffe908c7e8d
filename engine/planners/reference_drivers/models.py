"""Reference drivers as pure models: what each one perceives, when it reacts, and how hard it brakes.

A driver is a frozen dataclass. ``react(memory, moment)`` takes the driver's memory and its perception at one time, and
returns the new memory and the wanted deceleration in m/s², or None if the driver does not react. This module knows no
tracks, planners or simulations. The vehicle's :class:`Brakes` limit how fast and how far a wanted deceleration builds
up.

* :class:`CarefulDriver`: the competent and careful human driver of UN Regulation No. 157 (ECE/TRANS/WP.29/2020/81,
  Annex 4, Appendix 3; Annex 3 since Supplement 1, and performance model 1 there since the 01 series of amendments).
  Table 1 is checked against all three versions. The triggers are those of esmini and the Joint Research Centre; the
  paragraphs (3.3 and 3.4 of the first version) are not checked against the regulation's text.
* :class:`FuzzyDriver`: the fuzzy safety model (FSM; performance model 2 there). Mattas and others, "Fuzzy surrogate
  safety metrics for real-time assessment of rear-end collision risk", Accident Analysis and Prevention 148, 2020, and
  "Driver models for the definition of safety requirements of automated vehicles in international regulations", volume
  174, 2022. The parameters are those of the code that the European Commission's Joint Research Centre publishes
  (JRC-FSM); the formulas also match those of the 01 series of amendments.
* :class:`RssDriver`: Responsibility-Sensitive Safety. Shalev-Shwartz, Shammah, Shashua, "On a formal model of safe and
  scalable self-driving cars", arXiv:1708.06374, definitions 1, 2, 6 and 7; IEEE 2846-2022 has the same parameters and
  leaves their values open.
* :class:`FullBraking`: full braking at once, and :class:`KeepLane`: no reaction at all. They bound the others.

Distances are in m, speeds in m/s, accelerations in m/s², times in s.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol

from ....schemas.reviews import ReferenceDriverName

GRAVITY_MPS2 = 9.81


@dataclass(frozen=True)
class Brakes:
    """The largest deceleration of a vehicle, and the time in which it builds up evenly."""

    full_mps2: float
    build_up_s: float

    @property
    def jerk_mps3(self) -> float:
        """The rate at which the deceleration builds up, in m/s³."""
        return self.full_mps2 / self.build_up_s

    def on_road(self, friction: float | None) -> "Brakes":
        """Return the brakes on a road with this friction; the deceleration builds up at the same rate."""
        full = self.full_mps2 if friction is None else min(self.full_mps2, friction * GRAVITY_MPS2)
        return self if full == self.full_mps2 else Brakes(full, full / self.jerk_mps3)

    def after(self, braking_mps2: float, target_mps2: float, step_s: float) -> float:
        """Return the deceleration one step later, given the wanted deceleration; releasing the pedal takes no time."""
        return min(braking_mps2 + self.jerk_mps3 * step_s, self.full_mps2, target_mps2)


CAR_BRAKES = Brakes(0.774 * GRAVITY_MPS2, 0.6)
"""UN R157, Annex 4, Appendix 3, table 1: 0.774 g after 0.6 s on a dry road."""
HEAVY_BRAKES = Brakes(5.0, 0.6 / 0.75)
"""Trucks and buses: 5 m/s² is the least performance of the service brakes of categories M2, M3, N2 and N3 (UN R13,
Annex 4; adopted by UN R157 in its Supplement 3, ECE/TRANS/WP.29/2021/143/Rev.1; UN R79, annex 3, requires the same).
The build-up is that of UN R13, Annex 6, 0.6 s until the pressure reaches 75%, not checked against its text.
"""
_HEAVY = ("truck", "bus")


def brakes_of(kind: str) -> Brakes:
    """Return the brakes of a vehicle class, given as a CommonRoad obstacle type; cars by default."""
    return HEAVY_BRAKES if kind in _HEAVY else CAR_BRAKES


@dataclass(frozen=True)
class Seen:
    """Another road user along a driver's path, as the driver perceives it at one time.

    ``gap_m``: distance from the driver's front to its nearest end, negative alongside and behind; ``past_m``: distance
    until the driver's rear is past its far end. ``aside_m``: lateral gap between both bodies, at most 0 if it is in the
    path; ``nearing_mps``: closing rate of that gap; ``along_mps`` and ``slowing_mps2``: its speed along the path and
    its deceleration. ``hider_gap_m``: the gap to the road user that hides it; None if it is visible.
    """

    key: int
    gap_m: float
    past_m: float
    aside_m: float
    nearing_mps: float
    along_mps: float
    slowing_mps2: float
    hider_gap_m: float | None = None

    @property
    def is_in_way(self) -> bool:
        """True if the road user is in the path, ahead of the driver or alongside its front."""
        return self.aside_m <= 0 and not self.is_passed

    @property
    def is_passed(self) -> bool:
        """True if the driver is past it."""
        return self.past_m <= 0

    def is_in_way_before_passed(self, closing_mps: float, later_s: float = 0.0) -> bool:
        """Return True if it enters the path from the side before the driver is past it (plus a delay)."""
        if self.nearing_mps <= 0 or closing_mps <= 0:
            return False
        return self.aside_m / self.nearing_mps <= self.past_m / closing_mps + later_s

    def time_to_collision_s(self, own_mps: float) -> float:
        """Return the time until the driver reaches it along the path if both keep their speeds; infinite if never."""
        closing = own_mps - self.along_mps
        return max(self.gap_m, 0.0) / closing if closing > 0 else math.inf

    def time_headway_s(self, own_mps: float) -> float:
        """Return the time in which the driver covers the gap; infinite if the driver stands."""
        return _headway_s(self.gap_m, own_mps)


def _headway_s(gap_m: float, own_mps: float) -> float:
    return max(gap_m, 0.0) / own_mps if own_mps > 0 else math.inf


@dataclass(frozen=True)
class Moment:
    """A driver's perception: the time, its own speed and acceleration, and the road users ahead, hidden or not."""

    time_s: float
    own_mps: float
    own_mps2: float
    seen: tuple[Seen, ...]

    @property
    def visible(self) -> tuple[Seen, ...]:
        """The road users that the driver can see."""
        return tuple(seen for seen in self.seen if seen.hider_gap_m is None)


class ReferenceDriver(Protocol):
    """A driver model. ``begin`` returns the memory of a driver that takes over."""

    @property
    def name(self) -> ReferenceDriverName:
        """The name of the driver in verdicts, docs and configurations."""

    def begin(self) -> Any:
        """Return an empty memory."""

    def react(self, memory: Any, moment: Moment) -> tuple[Any, float | None]:
        """Return the new memory and the wanted deceleration; None if the driver does not react."""


_SLOWER_MPS = 0.1
"""Speed resolution: a vehicle slower than this stands, as in the time headway."""
_STILL_SLOWING_MPS2 = 1.0
"""A stronger deceleration counts as braking, as in the description of contacts."""
_ROUNDING_S = 1e-9


@dataclass(frozen=True)
class _Hazard:
    """The careful driver's knowledge of one road user: the start of each trigger, and the time of the decision.

    ``followed_closely``: True if the driver followed the hiding vehicle within the critical time headway.
    """

    farthest_m: float
    followed_closely: bool = False
    coming_since_s: float | None = None
    slowing_since_s: float | None = None
    slower_since_s: float | None = None
    decided_s: float | None = None


@dataclass(frozen=True)
class CarefulDriver:
    """UN R157's competent and careful driver with its three triggers.

    The driver *notices* a road user in three cases. Cut-in (3.4.1): it has come nearer to the path by ``wandering_m``
    or is in it. Deceleration (3.4.3): it brakes in the path by more than ``hard_mps2``. Cut-out (3.4.2): it is in the
    path and slower than the driver. In the regulation, this is the vehicle that a cut-out reveals; here a leader that
    has become slower is treated the same. A broad road user in the path hides those behind it until its centre is more
    than ``wandering_m`` off the path. In the regulation, others change from the adjacent lane, ``lane_m`` wide (JRC-FSM
    lets vehicles 1.9 m wide start 1.6 m apart). A road user farther away is noticed only if, at its present rate, it
    enters the path before the driver passes it.

    After ``perception_s`` the driver *perceives* the risk. It is *critical* if the time to collision is below
    ``critical_ttc_s`` (cut-in), if the time headway is below ``critical_thw_s`` (deceleration, cut-out), or if the
    headway to the vehicle that cut out was (cut-out). In the regulation's data sheets the driver follows that vehicle
    at 2 s. ``delay_s`` later the driver brakes fully, until the other is neither slower nor braking, or has left the
    path.
    """

    wandering_m: float = 0.375
    perception_s: float = 0.4
    delay_s: float = 0.75
    critical_ttc_s: float = 2.0
    critical_thw_s: float = 2.0
    hard_mps2: float = 5.0
    lane_m: float = 3.5

    @property
    def name(self) -> ReferenceDriverName:
        """The name of this driver."""
        return "r157_careful"

    def begin(self) -> Mapping[int, _Hazard]:
        """Return the memory of a driver that has not noticed any road user yet."""
        return {}

    def react(self, memory: Mapping[int, _Hazard], moment: Moment) -> tuple[Mapping[int, _Hazard], float | None]:
        """Brake fully if any perceived risk has been critical for the delay."""
        hazards = {seen.key: self._hazard(memory.get(seen.key), seen, moment) for seen in moment.seen}
        decided = [hazard.decided_s for hazard in hazards.values() if hazard.decided_s is not None]
        brakes = any(moment.time_s - since >= self.delay_s - _ROUNDING_S for since in decided)
        return hazards, math.inf if brakes else None

    def _hazard(self, before: _Hazard | None, seen: Seen, moment: Moment) -> _Hazard:
        if seen.hider_gap_m is not None:
            headway_s = _headway_s(seen.hider_gap_m, moment.own_mps)
            return _Hazard(seen.aside_m, headway_s <= self.critical_thw_s + _ROUNDING_S)
        known = before or _Hazard(seen.aside_m)
        if known.decided_s is not None:
            acts = moment.time_s - known.decided_s >= self.delay_s + _ROUNDING_S
            return _Hazard(seen.aside_m) if acts and self._is_over(seen, moment) else known
        now, closing = moment.time_s, moment.own_mps - seen.along_mps
        farthest = max(known.farthest_m, seen.aside_m)
        coming = seen.is_in_way or (farthest - seen.aside_m > self.wandering_m and self._may_come(seen, closing))
        hard = seen.is_in_way and (seen.slowing_mps2 > self.hard_mps2 or known.slowing_since_s is not None)
        hazard = _Hazard(
            farthest,
            known.followed_closely,
            coming_since_s=_since(known.coming_since_s, now, coming),
            slowing_since_s=_since(known.slowing_since_s, now, hard and (closing > 0 or seen.slowing_mps2 > 0)),
            slower_since_s=_since(known.slower_since_s, now, seen.is_in_way and closing > _SLOWER_MPS),
        )
        return replace(hazard, decided_s=now) if self._is_critical(hazard, seen, moment) else hazard

    def _is_critical(self, hazard: _Hazard, seen: Seen, moment: Moment) -> bool:
        def perceived(since_s: float | None) -> bool:
            return since_s is not None and moment.time_s - since_s >= self.perception_s - _ROUNDING_S

        if seen.is_passed or moment.own_mps <= seen.along_mps:
            return False
        near = seen.time_headway_s(moment.own_mps) < self.critical_thw_s
        if near and perceived(hazard.slowing_since_s):
            return True
        if (near or hazard.followed_closely) and perceived(hazard.slower_since_s):
            return True
        return perceived(hazard.coming_since_s) and seen.time_to_collision_s(moment.own_mps) < self.critical_ttc_s

    def _may_come(self, seen: Seen, closing_mps: float) -> bool:
        """Return True if an approaching road user is in the adjacent lane, or will enter the path in time."""
        if seen.aside_m <= self.lane_m:
            return True
        return seen.is_in_way_before_passed(closing_mps)

    def _is_over(self, seen: Seen, moment: Moment) -> bool:
        """Return True if the cause of the braking is over."""
        if seen.is_passed:
            return True
        if seen.aside_m > 0:
            return seen.nearing_mps <= 0
        return moment.own_mps <= seen.along_mps and seen.slowing_mps2 <= _STILL_SLOWING_MPS2


def _since(before_s: float | None, now_s: float, holds: bool) -> float | None:
    """Return the start of the uninterrupted time for which a condition has held, or None if it does not hold."""
    return None if not holds else now_s if before_s is None else before_s


@dataclass(frozen=True)
class _Alertness:
    """The times since which a situation has been unsafe, or safe again; a time is None if it does not apply."""

    unsafe_since_s: float | None = None
    safe_since_s: float | None = None

    def after(self, is_unsafe: bool, now_s: float, calm_s: float) -> "_Alertness":
        """Return the alertness after one more step; a driver becomes calm after a while without danger."""
        if is_unsafe:
            return _Alertness(now_s if self.unsafe_since_s is None else self.unsafe_since_s)
        if self.unsafe_since_s is None:
            return self
        safe_since_s = now_s if self.safe_since_s is None else self.safe_since_s
        return _Alertness() if now_s - safe_since_s >= calm_s else _Alertness(self.unsafe_since_s, safe_since_s)

    def responds(self, now_s: float, response_s: float) -> bool:
        """Return True if the response time has passed since the situation became unsafe."""
        return self.unsafe_since_s is not None and now_s - self.unsafe_since_s >= response_s - _ROUNDING_S


@dataclass(frozen=True)
class _RespondingDriver(ABC):
    """A driver that brakes as hard as the most dangerous road user requires, after ``response_s``."""

    response_s: float = 0.75

    def begin(self) -> _Alertness:
        """Return the memory of a calm driver."""
        return _Alertness()

    def react(self, memory: _Alertness, moment: Moment) -> tuple[_Alertness, float | None]:
        """Brake according to the danger, after the response time."""
        wanted = max((self.target_mps2(seen, moment) for seen in moment.visible), default=0.0)
        memory = memory.after(wanted > 0, moment.time_s, self.response_s)
        return memory, wanted if wanted > 0 and memory.responds(moment.time_s, self.response_s) else None

    @abstractmethod
    def target_mps2(self, seen: Seen, moment: Moment) -> float:
        """Return the deceleration that one road user requires of the driver; 0 if it is safe."""


@dataclass(frozen=True)
class FuzzyDriver(_RespondingDriver):
    """The driver of the fuzzy safety model, which brakes early and gently, and harder in more unsafe situations.

    ``gentle_mps2``, ``hard_mps2``: its own comfortable and hardest deceleration. ``front_mps2``: that of the leader.
    ``standstill_m``: the gap that it keeps when standing. ``margin_m``: added to the safe distance. ``earlier_s``: the
    largest delay, after the driver is past, with which a road user may still enter the path.
    """

    gentle_mps2: float = 4.0
    hard_mps2: float = 6.0
    front_mps2: float = 7.0
    standstill_m: float = 2.0
    margin_m: float = 2.0
    earlier_s: float = 0.1

    @property
    def name(self) -> ReferenceDriverName:
        """The name of this driver."""
        return "fsm"

    def target_mps2(self, seen: Seen, moment: Moment) -> float:
        """Return the deceleration that one road user requires of the driver; 0 if it is safe."""
        if seen.is_passed:
            return 0.0
        closing = moment.own_mps - seen.along_mps
        if seen.aside_m > 0 and not seen.is_in_way_before_passed(closing, self.earlier_s):
            return 0.0
        gap = max(seen.gap_m, 0.0)
        critical = self.critical_share(gap, moment.own_mps, seen.along_mps, moment.own_mps2)
        if critical > 0:
            return self.gentle_mps2 + critical * (self.hard_mps2 - self.gentle_mps2)
        return self.unsafe_share(gap, moment.own_mps, seen.along_mps) * self.gentle_mps2

    def unsafe_share(self, gap_m: float, own_mps: float, front_mps: float) -> float:
        """Return the proactive metric if the leader brakes hard: 0 if gentle braking suffices, 1 if hard fails."""
        front_m = max(front_mps, 0.0) ** 2 / (2 * self.front_mps2)
        response_m = own_mps * self.response_s
        safe = response_m + own_mps**2 / (2 * self.gentle_mps2) - front_m + self.margin_m
        unsafe = response_m + own_mps**2 / (2 * self.hard_mps2) - front_m
        return _share_between(gap_m - self.standstill_m, safe, unsafe)

    def critical_share(self, gap_m: float, own_mps: float, front_mps: float, felt_mps2: float) -> float:
        """Return the critical metric.

        For a leader at constant speed, it is 0 if gentle braking suffices, and 1 if hard braking does not."""
        if own_mps <= front_mps:
            return 0.0
        going_on = max(felt_mps2, -self.gentle_mps2)
        closing = own_mps + going_on * self.response_s - front_mps
        if closing < 0:
            return float(gap_m < (own_mps - front_mps) ** 2 / (2 * abs(felt_mps2)))
        response_m = (own_mps + going_on * self.response_s / 2 - front_mps) * self.response_s
        safe = response_m + closing**2 / (2 * self.gentle_mps2)
        return _share_between(gap_m, safe, response_m + closing**2 / (2 * self.hard_mps2))


def _share_between(value: float, none: float, all_: float) -> float:
    """Return 0 for a value of ``none`` or more, 1 for ``all_`` (which is smaller) or less, and interpolate linearly
    between.
    """
    return float(value < all_) if none <= all_ else min(max((none - value) / (none - all_), 0.0), 1.0)


@dataclass(frozen=True)
class RssDriver(_RespondingDriver):
    """The driver of Responsibility-Sensitive Safety, which brakes fully while both distances to a road user are unsafe.

    The longitudinal distance is definition 1 for a road user in the driver's direction, without acceleration during the
    response (a driver that keeps its speed), and definition 2 for an oncoming road user. The lateral distance is
    definition 6 with a driver that keeps its lane. RSS leaves the values open: ``response_s`` is UN R157's delay,
    ``own_mps2`` and ``front_mps2`` are the decelerations that the driver assumes for itself and for others,
    ``across_mps2`` and ``fluctuation_m`` are those of the Joint Research Centre's comparison of the driver models.
    """

    own_mps2: float = 4.0
    front_mps2: float = 8.0
    across_mps2: float = 1.0
    fluctuation_m: float = 0.3

    @property
    def name(self) -> ReferenceDriverName:
        """The name of this driver."""
        return "rss"

    def target_mps2(self, seen: Seen, moment: Moment) -> float:
        """Return full braking if the distances to a road user are unsafe; 0 if they are safe."""
        return math.inf if self.is_unsafe(seen, moment.own_mps) else 0.0

    def is_unsafe(self, seen: Seen, own_mps: float) -> bool:
        """Return True if both distances to a road user are below the safe distances."""
        if seen.is_passed or 0 < seen.aside_m >= self.safe_aside_m(seen.nearing_mps):
            return False
        return max(seen.gap_m, 0.0) < self.safe_distance_m(own_mps, seen.along_mps)

    def safe_distance_m(self, own_mps: float, front_mps: float) -> float:
        """Return the safe longitudinal distance to a road user with a speed along the path (negative if oncoming)."""
        own = own_mps * self.response_s + own_mps**2 / (2 * self.own_mps2)
        if front_mps >= 0:
            return max(own - front_mps**2 / (2 * self.front_mps2), 0.0)
        theirs = -front_mps * self.response_s + front_mps**2 / (2 * self.own_mps2)
        return own + theirs

    def safe_aside_m(self, nearing_mps: float) -> float:
        """Return the safe lateral distance to a road user that approaches at a speed; 0 if it does not approach."""
        if nearing_mps <= 0:
            return 0.0
        later = nearing_mps + self.across_mps2 * self.response_s
        responding_m = (nearing_mps + later) / 2 * self.response_s
        return self.fluctuation_m + responding_m + later**2 / (2 * self.across_mps2)


@dataclass(frozen=True)
class FullBraking:
    """Full braking as soon as the driver takes over, without any delay."""

    @property
    def name(self) -> ReferenceDriverName:
        """The name of this driver."""
        return "full_braking"

    def begin(self) -> None:
        """Return no memory, since there is nothing to remember."""

    def react(self, memory: None, moment: Moment) -> tuple[None, float | None]:
        """Brake fully, whatever the driver perceives."""
        del memory, moment
        return None, math.inf


@dataclass(frozen=True)
class KeepLane:
    """A driver that always keeps its lane and speed."""

    @property
    def name(self) -> ReferenceDriverName:
        """The name of this driver."""
        return "keep_lane"

    def begin(self) -> None:
        """Return no memory, since there is nothing to remember."""

    def react(self, memory: None, moment: Moment) -> tuple[None, float | None]:
        """Do nothing."""
        del memory, moment
        return None, None
