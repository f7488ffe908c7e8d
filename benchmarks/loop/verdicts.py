"""Checks verdicts of reference drivers on collisions against an independent implementation.

The seed draws encounters in the frame of a road, straight or a curve of 40 to 200 m. They have a braking leader, a
slower one, a follower that catches up, a cut-in, a cut-out before a standing car, a crossing pedestrian and cyclist,
and a car that turns across the ego's path from ahead. Some egos speed up before they meet another road user. The egos
are cars, trucks and buses. Everything is given in closed form along the road, so that the judge projects nothing. It
moves each driver in steps of 10 ms, detects contacts by separating axes, and follows each drive until the ego stands
and the other is gone. It shares nothing with the product; parameters and rules are those of
``docs/reference_drivers.md``.

A verdict counts if it is away from edges. It must stay the same if all bodies are 0.1 m longer or shorter, the ego is
2 % slower or faster, and the driver responds 0.2 s later or 0.05 s earlier (the product's steps are 0.1 s long).

Keys:

- ``verdicts_right``: share of correct verdicts (driver, start, encounter) and of correct closed forms. The closed forms
  are the latest full braking before a standing car, and two statements of UN R157's data sheets (Annex 4, Appendix 3)
  about its driver at a time headway of 2 s and up to 60 km/h. The driver avoids every standing car that a cut-out
  reveals (5.2), and every leader that brakes by up to 1 g (5.3). The headway is checked against the sheets. That the
  driver avoids them all, and the paragraph numbers, are not checked against the regulation's text.
- ``window_errors``: drivers reported to prevent a collision although they touch the other later.
- ``verdicts_told``, ``verdicts_at_edges``: numbers of verdicts that count, and that are left out.
"""

import math
import random
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from plannerforge.engine.analysis.prevention import Surroundings, prevention_of
from plannerforge.engine.commonroad import Track

from ..harness import Figures, SeededBench, share
from ..planners.driver_models import BRAKES, STEP_S, TOUCH_M, Careful, G, Responding, View, fuzzy_asks, rss_asks

FINE_S, SHOWN_S, LONGEST_S = 0.01, 30.0, 30.0
SIZES = {"car": (4.5, 1.8), "truck": (10.0, 2.5), "bus": (12.0, 2.5)}
DRIVERS = ("full_braking", "r157_careful", "fsm", "rss", "keep_lane")


@dataclass(frozen=True)
class Body:
    """Another road user: how far along the road, how far left, turned against it, and how fast it is, over time."""

    kind: str
    length: float
    width: float
    along: Callable[[float], float]
    aside: Callable[[float], float]
    turned: Callable[[float], float]
    speed: Callable[[float], float]

    def rate(self, t: float) -> float:
        """Return its speed along the road's direction."""
        return self.speed(t) * math.cos(self.turned(t))


@dataclass(frozen=True)
class Made:
    """An encounter: the road's curvature, the ego, how fast it was driven, the other road user, and a hider."""

    name: str
    curvature: float
    ego: str
    speed: Callable[[float], float]
    met: Body
    hider: Body | None = None
    shown_s: float = SHOWN_S


@dataclass(frozen=True)
class Variant:
    """A variation of an encounter: extra length of the bodies, a factor on the ego's speed, a later response."""

    longer: float = 0.0
    faster: float = 1.0
    later: float = 0.0


VARIANTS = (
    Variant(),
    Variant(longer=0.1),
    Variant(longer=-0.1),
    Variant(faster=0.98),
    Variant(faster=1.02),
    Variant(later=0.2),
    Variant(later=-0.05),
)


def steady(speed: float) -> Callable[[float], float]:
    """Return a constant speed."""
    return lambda _: speed


def even(kind: str, size: tuple[float, float], at: float, aside: float, speed: float) -> Body:
    """Return a road user that keeps its lane and speed."""
    return Body(kind, *size, lambda t: at + speed * t, lambda _: aside, lambda _: 0.0, lambda _: speed)


def braking(at: float, speed: float, begins: float, by: float) -> Body:
    """Return a car that brakes from a time on to a stop."""

    def along(t: float) -> float:
        after = min(max(t - begins, 0.0), speed / by)
        return at + speed * min(t, begins) + speed * after - by * after**2 / 2

    return Body(
        "car", 4.5, 1.8, along, lambda _: 0.0, lambda _: 0.0, lambda t: max(speed - by * max(t - begins, 0.0), 0.0)
    )


def catching_up(at: float, speed: float, begins: float, by: float, gain: float) -> Body:
    """Return a car behind that is slower at first and then speeds up for good."""

    def along(t: float) -> float:
        faster = min(max(t - begins, 0.0), gain / by)
        return at + speed * t + by * faster**2 / 2 + gain * max(t - begins - gain / by, 0.0)

    return Body(
        "car",
        4.5,
        1.8,
        along,
        lambda _: 0.0,
        lambda _: 0.0,
        lambda t: speed + by * min(max(t - begins, 0.0), gain / by),
    )


def changing(at: float, speed: float, begins: float, across: float, before: float, after: float) -> Body:
    """Return a car that moves evenly across from one offset to another from a time on."""
    ends = begins + abs(after - before) / across
    way = math.copysign(across, after - before)

    def aside(t: float) -> float:
        return before + way * (min(max(t, begins), ends) - begins)

    def turned(t: float) -> float:
        return math.atan2(way, speed) if begins <= t < ends else 0.0

    return Body(
        "car",
        4.5,
        1.8,
        lambda t: at + speed * t,
        aside,
        turned,
        lambda t: math.hypot(speed, across) if begins <= t < ends else speed,
    )


def crossing(kind: str, size: tuple[float, float], at: float, from_m: float, begins: float, speed: float) -> Body:
    """Return a road user that stands at the roadside and crosses at a right angle from a time on."""
    heading = math.copysign(math.pi / 2, -from_m)
    return Body(
        kind,
        *size,
        lambda _: at,
        lambda t: from_m - math.copysign(speed * max(t - begins, 0.0), from_m),
        lambda _: heading,
        lambda t: speed if t >= begins else 0.0,
    )


def turning(at: float, begins: float, speed: float) -> Body:
    """Return a car that comes the other way 3.5 m aside and turns across the ego's lane at a right angle."""
    return Body(
        "car",
        4.5,
        1.8,
        lambda t: at - speed * min(t, begins),
        lambda t: 3.5 - speed * max(t - begins, 0.0),
        lambda t: math.pi if t < begins else -math.pi / 2,
        lambda _: speed,
    )


def drawn(choice: random.Random) -> Iterator[Made]:
    """Yield one encounter of each kind; not all of them end in a collision."""
    u = choice.uniform
    ego = choice.choice(("car", "car", "truck", "bus"))
    half = SIZES[ego][0] / 2 + 2.25
    bend = choice.choice((0.0, 1.0, -1.0)) / u(40, 200)
    v = u(8, 14) if bend else u(8, 28)
    begins = u(0.5, 2)
    shown = choice.choice((SHOWN_S, 0.0))
    yield Made("braking", 0.0, ego, lambda _: v, braking(half + v * u(0.3, 2.6), v, begins, u(1.5, 9)), None, shown)
    slow = u(0, 0.7) * v
    yield Made("slower", bend, ego, lambda _: v, even("car", (4.5, 1.8), half + u(20, 120), u(-0.4, 0.4), slow))
    w, across, starts = u(12, 28), u(0.5, 2.0), u(0.5, 2.0)
    cut = changing(half + u(2, 40) + 4, w - u(1, 10), starts, across, choice.choice((3.5, -3.5)), 0.0)
    yield Made("cut_in", 0.0, ego, lambda _: w, cut)
    gap, room = w * u(0.8, 2.6), u(10, 90)
    lead = changing(half + gap, w, starts, u(1.0, 2.0), 0.0, 3.5)
    stands = half + gap + w * starts + 4.5 + room
    yield Made("cut_out", 0.0, ego, lambda _: w, even("car", (4.5, 1.8), stands, 0.0, 0.0), lead)
    town, side, walks = u(5, 16), choice.choice((1.0, -1.0)), u(0.8, 2.2)
    steps, enters = u(2.5, 5), side * u(3, 6)
    to_way = steps + (abs(enters) - SIZES[ego][1] / 2 - 0.4) / walks
    at = SIZES[ego][0] / 2 + town * (to_way + u(0, 1.6)) + 0.5
    yield Made("pedestrian", bend, ego, lambda _: town, crossing("pedestrian", (0.4, 0.6), at, enters, steps, walks))
    rides, far = u(3, 6), side * u(6, 14)
    to_way = steps + (abs(far) - SIZES[ego][1] / 2 - 1.0) / rides
    at = SIZES[ego][0] / 2 + town * (to_way + u(0, 1.0)) + 0.5
    yield Made("cyclist", 0.0, ego, lambda _: town, crossing("bicycle", (1.8, 0.6), at, far, steps, rides))
    comes, turns = u(4, 9), u(2.5, 4.5)
    meets = town * (turns + 1.2 + u(-0.2, 1.0)) + half
    yield Made("turning", 0.0, ego, lambda _: town, turning(meets + comes * turns, turns, comes))
    back, hurry, gains = u(20, 60), u(1.5, 4), u(4, 10)
    yield Made("follower", 0.0, ego, lambda _: town, catching_up(-half - back, town - u(0, 2), begins, hurry, gains))
    first, gain, until = u(4, 8), u(2, 4), u(2, 3)

    def faster(t: float) -> float:
        return first + gain * min(t, until)

    ahead = half + u(25, 60)
    yield Made("sped_up", 0.0, ego, faster, even("car", (4.5, 1.8), ahead, 0.0, first + u(-1.5, 2.5)))


def overlap(one: Any, other: Any) -> bool:
    """Return True if two rectangles (x, y, heading, length, width) overlap, by separating axes."""
    boxes = []
    for x, y, heading, length, width in (one, other):
        c, s = math.cos(heading), math.sin(heading)
        ends = [(a * length / 2, b * width / 2) for a in (-1, 1) for b in (-1, 1)]
        boxes.append([(x + a * c - b * s, y + a * s + b * c) for a, b in ends])
    for _, _, heading, _, _ in (one, other):
        for axis in (heading, heading + math.pi / 2):
            c, s = math.cos(axis), math.sin(axis)
            spans = [[x * c + y * s for x, y in box] for box in boxes]
            if max(spans[0]) < min(spans[1]) or max(spans[1]) < min(spans[0]):
                return False
    return True


def placed(curvature: float, along: float, aside: float, turned: float) -> tuple[float, float, float]:
    """Return the pose in the plane of a place along a road that begins at the origin along the x axis."""
    if not curvature:
        return along, aside, turned
    bearing, radius = along * curvature, 1 / curvature
    x, y = radius * math.sin(bearing), radius * (1 - math.cos(bearing))
    return x - aside * math.sin(bearing), y + aside * math.cos(bearing), bearing + turned


def touches(made: Made, variant: Variant, body: Body, station: float, t: float, less: float) -> bool:
    """Return True if the ego, shortened by twice ``less``, touches another road user."""
    if abs(body.along(t) - station) > 20 or abs(body.aside(t)) > 20:
        return False
    length, width = SIZES[made.ego]
    own = (*placed(made.curvature, station, 0.0, 0.0), length - 2 * less, width)
    pose = placed(made.curvature, body.along(t), body.aside(t), body.turned(t))
    return overlap(own, (*pose, body.length + variant.longer, body.width))


def hit_s(made: Made) -> float | None:
    """Return the first step of a run at which the driven ego touches the other, or None within 15 s."""
    way, variant = 0.0, Variant()
    for index in range(round(15 / STEP_S)):
        if touches(made, variant, made.met, way, index * STEP_S, 0.0):
            return index * STEP_S if index > 5 else None
        way += (made.speed(index * STEP_S) + made.speed((index + 1) * STEP_S)) / 2 * STEP_S
    return None


def view(made: Made, variant: Variant, body: Body, station: float, t: float) -> View:
    """Return another as the ego sees it along the road, in closed form."""

    def gap_aside(at: float) -> float:
        turn = body.turned(at)
        across = ((body.length + variant.longer) * abs(math.sin(turn)) + body.width * abs(math.cos(turn))) / 2
        return abs(body.aside(at)) - across - SIZES[made.ego][1] / 2

    turn, ahead = body.turned(t), body.along(t) - station
    long = (body.length + variant.longer) * abs(math.cos(turn)) + body.width * abs(math.sin(turn))
    reach = (long + SIZES[made.ego][0]) / 2
    before = max(t - STEP_S, 0.0)
    rate = (gap_aside(before) - gap_aside(t)) / STEP_S if t > 0 else 0.0
    slowing = (body.speed(before) - body.speed(t)) / STEP_S
    return View(ahead - reach, ahead + reach, gap_aside(t), rate, body.rate(t), slowing)


def prevents(made: Made, driver: str, start: str, variant: Variant, touch: float, begins: float = 0.0) -> bool:
    """Return True if a driver keeps clear until 30 s after the contact; ``begins``: the start of full braking."""
    t, way = 0.0, 0.0
    v = made.speed(0.0) * variant.faster
    others = [made.met] if made.hider is None else [made.met, made.hider]
    careful = [Careful(variant.later) for _ in others]
    responding, force, felt, free = Responding(variant.later), 0.0, 0.0, True
    full, ramp = BRAKES[made.ego]
    while t < touch + LONGEST_S:
        views = [view(made, variant, other, way, t) for other in others]
        seen = [0]
        if made.hider is not None and views[0].aside <= 0:
            front = views[1]
            if front.aside <= 0 and abs(made.hider.aside(t)) <= 0.375 and 0 <= front.gap < views[0].gap:
                seen = []
                careful[0].hidden(views[0].aside, front.gap, v)
        if start == "start" and made.hider is not None:
            seen.append(1)
        if driver == "full_braking":
            asked = math.inf if t >= begins else 0.0
        elif driver == "r157_careful":
            asked = max((careful[i].wants(t, v, felt, views[i]) for i in seen), default=0.0)
        elif driver == "fsm":
            asked = responding.allowed(t, max((fuzzy_asks(v, felt, views[i]) for i in seen), default=0.0))
        elif driver == "rss":
            asked = responding.allowed(t, max((rss_asks(v, views[i]) for i in seen), default=0.0))
        else:
            asked = 0.0
        free = free and asked <= 0
        if free:
            new = made.speed(t + FINE_S) * variant.faster if start == "before_contact" else v
            force = 0.0
        else:
            force = min(force + full / ramp * FINE_S, full, asked) if asked > 0 else 0.0
            new = max(v - force * FINE_S, 0.0)
        felt = (new - v) / FINE_S
        way += (v + new) / 2 * FINE_S
        v, t = new, t + FINE_S
        if any(touches(made, variant, other, way, t, 0.0 if free else TOUCH_M) for other in others):
            return False
        met = views[0]
        if made.name != "follower" and met.past <= 0 and met.speed <= v:
            return True
    return True


def told(made: Made, touch: float) -> Any:
    """Return the product's statements about a run of this encounter."""
    length, width = SIZES[made.ego]
    count = round(touch / STEP_S) + 1
    times = np.arange(count) * STEP_S
    speeds = np.array([made.speed(t) for t in times])
    ways = np.concatenate([[0.0], np.cumsum((speeds[1:] + speeds[:-1]) / 2 * STEP_S)])
    poses = [placed(made.curvature, way, 0.0, 0.0) for way in ways]
    ego = _track(-1, made.ego, (length, width), poses, speeds)
    shown = max(made.shown_s, touch + 0.2)
    met = _shown(7, made, made.met, shown)
    others = [] if made.hider is None else [_shown(8, made, made.hider, shown)]
    return prevention_of(ego, met, count - 1, STEP_S, Surroundings(others, None, _lane(made)))


def _lane(made: Made) -> Any:
    """Return the middle of the lane, from before the ego on."""
    return np.array([placed(made.curvature, way, 0.0, 0.0)[:2] for way in np.arange(-5.0, 250.0, 1.0)])


def _shown(key: int, made: Made, body: Body, until_s: float) -> Track:
    times = np.arange(round(until_s / STEP_S) + 1) * STEP_S
    poses = [placed(made.curvature, body.along(t), body.aside(t), body.turned(t)) for t in times]
    return _track(key, body.kind, (body.length, body.width), poses, np.array([body.speed(t) for t in times]))


def _track(key: int, kind: str, size: tuple[float, float], poses: Sequence[Any], speeds: Any) -> Track:
    places = np.array(poses)
    return Track(key, kind, *size, 0, places[:, :2], np.unwrap(places[:, 2]), speeds)


def latest_full_braking_s(speed: float, gap: float, kind: str) -> float:
    """Return when the ego has to brake fully before a standing car, from the gap less the stopping distance."""
    full, ramp = BRAKES[kind]
    jerk = full / ramp
    lost = full * ramp / 2
    ramp_m = speed * ramp - jerk * ramp**3 / 6
    return (gap - ramp_m - (speed - lost) ** 2 / (2 * full)) / speed


def closed_forms(choice: random.Random, count: int) -> Iterator[tuple[str, bool]]:
    """Yield checks of the latest full braking before a standing car, and of our reading of UN R157's data sheets."""
    for _ in range(count):
        kind = choice.choice(("car", "truck", "bus"))
        speed, gap = choice.uniform(8, 25), choice.uniform(90, 140)
        half = SIZES[kind][0] / 2 + 2.25
        made = Made("standing", 0.0, kind, steady(speed), even("car", (4.5, 1.8), half + gap, 0.0, 0.0))
        yield "standing", _is_latest(made, latest_full_braking_s(speed, gap, kind))
    for kilometres_an_hour in (20, 30, 40, 50, 60):
        v = kilometres_an_hour / 3.6
        ahead = 4.5 + 2.0 * v
        for by in (0.2, 0.4, 0.6, 0.8, 1.0):
            made = Made("r157_5.3", 0.0, "car", steady(v), braking(ahead, v, 1.0, by * G))
            yield "r157_5.3", _careful_prevents(made)
        for across in (1.0, 1.8):
            for room in (5.0, 10.0, 20.0):
                lead = changing(ahead, v, 1.0, across, 0.0, 3.5)
                stands = ahead + v * (1.0 + 1.35 / across) + 4.5 + room
                met = even("car", (4.5, 1.8), stands, 0.0, 0.0)
                yield "r157_5.2", _careful_prevents(Made("r157_5.2", 0.0, "car", steady(v), met, lead))


def _is_latest(made: Made, expected: float) -> bool:
    """Return True if two times agree within two steps: one between tried times, one of the build-up of braking."""
    touch = hit_s(made)
    found = None if touch is None else told(made, touch)
    return found is not None and abs(float(found.by_braking_until_s) - expected) <= 2 * STEP_S


def _careful_prevents(made: Made) -> bool:
    touch = hit_s(made)
    found = None if touch is None else told(made, touch)
    return found is not None and bool(found.by_careful_driver)


def _reported_verdicts(found: Any) -> dict[tuple[str, str], bool]:
    return {(verdict.driver, verdict.start): verdict.prevents for verdict in found.drivers}


def _truth(made: Made, driver: str, start: str, touch: float) -> bool | None:
    """Return whether a driver prevents the collision; None at an edge."""
    found = set()
    for variant in VARIANTS:
        if driver == "full_braking":
            found.add(_brakes_in_time(made, start, variant, touch))
        else:
            found.add(prevents(made, driver, start, variant, touch))
        if len(found) > 1:
            return None
    return found.pop()


def _brakes_in_time(made: Made, start: str, variant: Variant, touch: float) -> bool:
    """Return True if full braking from any time before the contact prevents it; coarse steps suffice off edges."""
    begins = [0.0] if made.met.kind == "car" and made.name != "turning" else [touch * k / 12 for k in range(13)]
    return any(prevents(made, "full_braking", start, variant, touch, begin) for begin in begins)


def measure(bench: SeededBench) -> Figures:
    """Draw 16 collisions of each of the 9 kinds, or the bench's limit, and compare all verdicts with the truth."""
    choice, each = random.Random(bench.seed), bench.limit or 16  # noqa: S311 - reproducible, not secret
    right, edges, window = list[bool](), 0, 0
    counts, tried, kinds = Counter[str](), 0, Counter[str]()
    while min((counts[name] for name in kinds), default=0) < each and tried < 40 * each:
        tried += 1
        for made in drawn(choice):
            kinds[made.name] += 1
            touch = None if counts[made.name] >= each else hit_s(made)
            if touch is None:
                continue
            counts[made.name] += 1
            found = told(made, touch)
            if found is None:
                right.append(False)
                sys.stderr.write(f"{made.name}: no verdict\n")
                continue
            for (driver, start), prevented in _reported_verdicts(found).items():
                truth = _truth(made, driver, start, touch)
                if truth is None:
                    edges += 1
                    continue
                right.append(prevented == truth)
                window += prevented and not truth
                if prevented != truth:
                    sys.stderr.write(f"{made.name} ({made.ego}) {driver} from {start}: {truth}, told {prevented}\n")
    for name, holds in closed_forms(choice, each):
        right.append(holds)
        if not holds:
            sys.stderr.write(f"{name}: not as the closed form says\n")
    return {
        "verdicts_right": share(right),
        "window_errors": window,
        "verdicts_told": len(right),
        "verdicts_at_edges": edges,
    }
