"""Drawn edits of motions, each with a judge of the written file: stations, offsets and speeds in numpy."""

import math
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..written_tracks import Array, Lane, RoadUser, WrittenFile
from .red_lights import crossed

Edit = dict[str, Any]
Judge = Callable[[WrittenFile, WrittenFile, "StatedVerdicts"], str]
"""Maps base, new file and answer to the fault, or to an empty text."""
_MOVING_MPS = 3.0


@dataclass(frozen=True)
class StatedVerdicts:
    """The parts of the answer that a judge cannot derive: the ids of added vehicles by edit, and the verdicts."""

    added: tuple[tuple[int, ...], ...]
    verdicts: tuple[str, ...]
    handed_over: frozenset[int]


@dataclass(frozen=True)
class Drawn:
    """A request, the judge of its result, and the vehicles that may cross at red because their motion is prescribed."""

    kind: str
    edits: tuple[Edit, ...]
    judge: Judge
    may_cross: frozenset[int] = frozenset()
    refusal_is_right: bool = field(default=False)


def path_of(user: RoadUser) -> Lane:
    """Return the path of a road user's centre as a lane of zero width, so that others can be placed along it."""
    kept = [user.places[0]]
    for place in user.places[1:]:
        if np.linalg.norm(place - kept[-1]) > 0.3:
            kept.append(place)
    if len(kept) < 2:
        kept.append(kept[0] + user.forward[0])
    line = np.array(kept)
    return Lane(0, line, line, (), (), {}, (), frozenset())


def movers(file: WrittenFile, least: int = 40) -> list[RoadUser]:
    """Return vehicles that drive for at least some steps, and exist when the ego starts."""
    start = file.ego.step if file.ego else 0
    found = [user for user in file.users.values() if not user.is_static and user.kind not in ("pedestrian", "bicycle")]
    return [
        user
        for user in found
        if len(user.places) >= least and user.first <= start and user.speeds[:least].min() > _MOVING_MPS
    ]


def on_lane(file: WrittenFile, user: RoadUser) -> Lane | None:
    """Return the initial lane of a road user, if it drives along it."""
    key = file.lane_of(user.places[0], float(user.headings[0]))
    if key is None:
        return None
    lane = file.lanes[key]
    _, offset, direction = (value[0] for value in lane.along(user.places[:1]))
    turned = abs(math.remainder(float(direction) - float(user.headings[0]), math.tau))
    return lane if abs(offset) < 1.0 and turned < 0.2 else None


def offsets_from(path: Lane, user: RoadUser, since: int) -> tuple[Array, Array]:
    """Return arc lengths and offsets of a road user's centre along a path from a time step on."""
    stations, offsets, _ = path.along(user.places[max(since - user.first, 0) :])
    return stations, offsets


def draw_swerve(file: WrittenFile, rng: random.Random) -> Drawn | None:
    """Draw a swerve of a driving vehicle."""
    users = movers(file)
    if not users:
        return None
    user, far, side = rng.choice(users), rng.choice([0.5, 0.8, 1.2]), rng.choice(["left", "right"])
    begin = rng.choice([0.5, 1.0])
    sign = 1.0 if side == "left" else -1.0
    edit = {
        "op": "swerve",
        "vehicles": [str(user.key)],
        "side": side,
        "offset_m": far,
        "lateral_s": 1.5,
        "duration_s": 0.5,
        "time_s": round(user.first * file.step_s + begin, 3),
    }

    def judge(base: WrittenFile, new: WrittenFile, told: StatedVerdicts) -> str:  # noqa: ARG001
        before, after = base.users[user.key], new.users[user.key]
        _, offsets = offsets_from(path_of(before), after, before.first)
        reached = float((offsets * sign).max())
        return "" if abs(reached - far) <= max(0.12, 0.12 * far) else f"swerves {reached:.2f} m, not {far}"

    return Drawn("swerve", (edit,), judge, frozenset([user.key]))


def draw_rate(file: WrittenFile, rng: random.Random) -> Drawn | None:
    """Draw a prescribed deceleration."""
    users = [user for user in movers(file) if user.speeds[:40].min() > 6.0]
    if not users:
        return None
    user, rate, final = rng.choice(users), rng.choice([2.0, 4.0, 6.0]), rng.choice([0.0, 2.0])
    begin = user.first + 5
    edit = {
        "op": "set_speed",
        "vehicles": [str(user.key)],
        "speed": f"{final}m/s",
        "rate_mps2": rate,
        "time_s": round(begin * file.step_s, 3),
    }

    def judge(base: WrittenFile, new: WrittenFile, told: StatedVerdicts) -> str:
        after = new.users[user.key]
        speeds = after.speeds[begin - after.first :]
        due = (float(base.users[user.key].speeds[5]) - final) / rate + 1.0
        window = round(0.5 / new.step_s)
        hardest = float(((speeds[:-window] - speeds[window:]) / 0.5).max()) if len(speeds) > window else 0.0
        has_time = len(speeds) * new.step_s > due
        if has_time and abs(float(speeds[round(due / new.step_s) - 1]) - final) > 0.35:
            return f"speed {speeds[round(due / new.step_s) - 1]:.2f} after {due:.1f} s, not {final}"
        if not has_time and told.verdicts[0] == "done" and abs(float(speeds[-1]) - final) > 0.35:
            return "reported done, but the speed is not reached"
        return "" if abs(hardest - rate) <= 0.12 * rate + 0.1 else f"brakes with {hardest:.2f} m/s², not {rate}"

    return Drawn("rate", (edit,), judge, frozenset([user.key]))


def draw_relative(file: WrittenFile, rng: random.Random) -> Drawn | None:
    """Draw a share of the previous speed."""
    users = movers(file, 50)
    if not users:
        return None
    user, percent = rng.choice(users), rng.choice([-20, -10, 10, 15])
    edit = {"op": "set_speed", "vehicles": [str(user.key)], "speed": f"{percent:+d}%"}

    def judge(base: WrittenFile, new: WrittenFile, told: StatedVerdicts) -> str:
        before, after = base.users[user.key], new.users[user.key]
        path = path_of(before)
        there = path.along(before.places)[0]
        stations = path.along(after.places)[0]
        inside = (stations > there[15]) & (stations < there[-2])
        if inside.sum() < 5:
            return ""
        was = np.interp(stations[inside], np.maximum.accumulate(there), before.speeds)
        ratio = float(np.median(after.speeds[inside] / np.maximum(was, 0.5)))
        is_right = abs(ratio - 1.0 - percent / 100.0) <= 0.03
        if is_right or told.verdicts[0] != "done":
            return ""
        return f"drives {ratio:.3f} of its speed, not {1 + percent / 100:g}, but is reported done"

    return Drawn("relative", (edit,), judge)


def _side_lanes(file: WrittenFile, user: RoadUser) -> dict[str, Lane]:
    lane = on_lane(file, user)
    if lane is None:
        return {}
    found = {}
    for side, (key, direction) in lane.beside.items():
        if direction == "same" and key in file.lanes:
            station = float(lane.along(user.places[:1])[0][0])
            if lane.length_m - station > 12.0 * float(user.speeds[0]) * 0.4:
                found[side] = file.lanes[key]
    return found


def draw_lane_change(file: WrittenFile, rng: random.Random) -> Drawn | None:
    """Draw a lane change in a prescribed time."""
    options = [
        (user, side, lane) for user in movers(file, 60) for side, lane in sorted(_side_lanes(file, user).items())
    ]
    if not options:
        return None
    user, side, lane = rng.choice(options)
    taken = rng.choice([2.5, 3.0, 4.0])
    begin = user.first + 5
    edit = {
        "op": "change_lane",
        "vehicles": [str(user.key)],
        "lane": side,
        "lateral_s": taken,
        "time_s": round(begin * file.step_s, 3),
    }

    def judge(base: WrittenFile, new: WrittenFile, told: StatedVerdicts) -> str:  # noqa: ARG001
        before, after = base.users[user.key], new.users[user.key]
        offsets = np.abs(offsets_from(path_of(before), after, begin)[1])
        wanted = abs(float(lane.along(before.places[5:6])[1][0]))
        end = min(round((taken + 1.0) / new.step_s), len(offsets) - 1)
        if abs(float(offsets[end]) - wanted) > 0.5:
            return f"is {offsets[end]:.2f} m aside after {taken + 1:g} s, not {wanted:.2f}"
        return _duration_fault(offsets, new.step_s, taken)

    return Drawn("lane_change", (edit,), judge, frozenset([user.key]))


def _duration_fault(offsets: Array, step_s: float, taken: float) -> str:
    """Return the fault in the time from 5 % to 95 % of the lateral motion, which takes most of a prescribed duration.

    At constant lateral speed this is nine tenths of the time, along a half-period sine seven tenths.
    """
    total = float(offsets.max())
    first = int(np.argmax(offsets > 0.05 * total))
    last = int(np.argmax(offsets > 0.95 * total))
    measured = (last - first) * step_s
    return "" if 0.65 * taken <= measured <= 1.0 * taken else f"takes {measured:.1f} s aside, not {taken:g}"


def draw_cut_in(file: WrittenFile, rng: random.Random) -> Drawn | None:
    """Draw a cut-in on another recorded vehicle of the next lane."""
    users = movers(file, 60)
    options = []
    for user in users:
        beside = {lane.key for lane in _side_lanes(file, user).values()}
        for other in users:
            lane = on_lane(file, other)
            if other is user or lane is None or lane.key not in beside:
                continue
            along = float((user.places[0] - other.places[0]) @ other.forward[0])
            if -15.0 < along < 40.0 and abs(float(user.speeds[0] - other.speeds[0])) < 6.0:
                options.append((user, other))
    if not options:
        return None
    user, other = rng.choice(options)
    gap, taken = rng.choice([0.8, 1.0, 1.5]), rng.choice([2.5, 3.0])
    edit = {"op": "cut_in", "vehicles": [str(user.key)], "at": f"vehicle:{other.key}", "gap_s": gap, "lateral_s": taken}

    def judge(base: WrittenFile, new: WrittenFile, told: StatedVerdicts) -> str:
        after, target = new.users[user.key], new.users[other.key]
        path = path_of(base.users[other.key])
        first = max(after.first, target.first)
        last = min(after.last, target.last, base.users[other.key].last)
        steps = np.arange(first, last + 1)
        offsets = path.along(after.places[steps - after.first])[1]
        over = np.flatnonzero(np.abs(offsets) < 0.05 * float(np.abs(offsets).max()))
        if not len(over):
            return "never gets over"
        stations = path.along(after.places[steps - after.first])[0]
        behind = path.along(target.places[steps - target.first])[0]
        speeds = target.speeds[steps - target.first]
        room = stations - behind - (after.length_m + target.length_m) / 2
        near = slice(max(int(over[0]) - 2, 0), int(over[0]) + round(0.8 / new.step_s))
        gaps = room[near] / np.maximum(speeds[near], 0.5)
        best = float(gaps[np.argmin(np.abs(gaps - gap))])
        if abs(best - gap) > 0.15 and told.verdicts[0] == "done":
            return f"gap {best:.2f} s, not {gap}, but is reported done"
        # Drivers do not keep exactly to their lanes, and lanes converge: what counts is the share of the way between
        # the two recorded paths.
        from_own = np.abs(path_of(base.users[user.key]).along(after.places[steps - after.first])[1])
        share = from_own / np.maximum(from_own + np.abs(offsets), 0.1)
        return _duration_fault(share[: int(over[0]) + round(1.0 / new.step_s)], new.step_s, taken)

    return Drawn("cut_in", (edit,), judge, frozenset([user.key]))


def draw_wrong_way(file: WrittenFile, rng: random.Random) -> Drawn | None:
    """Draw an added vehicle against the direction of a free lane."""
    lanes = [lane for lane in file.lanes.values() if lane.length_m > 30.0 and _is_free(file, lane)]
    if not lanes:
        return None
    lane, speed = rng.choice(lanes), rng.choice([5.0, 8.0])
    edit = {"op": "wrong_way", "at": str(lane.key), "position": "0.8", "speed": f"{speed}m/s"}

    def judge(base: WrittenFile, new: WrittenFile, told: StatedVerdicts) -> str:  # noqa: ARG001
        (key,) = told.added[0]
        user = new.users[key]
        stations, offsets, directions = lane.along(user.places)
        gone = np.flatnonzero(stations <= 1.0)
        inside = np.arange(len(stations)) < (int(gone[0]) if len(gone) else len(stations))
        turned = np.abs(np.abs(np.remainder(user.headings - directions + np.pi, 2 * np.pi) - np.pi) - np.pi)
        if float(turned[0]) > 0.05 or not (np.diff(stations[inside]) < 1e-3).all():
            return "does not drive against the lane"
        if float(np.abs(offsets[inside]).max()) > 0.6:
            return "leaves the lane"
        return "" if abs(float(np.median(user.speeds)) - speed) < 0.3 else "has another speed"

    return Drawn("wrong_way", (edit,), judge)


def _is_free(file: WrittenFile, lane: Lane) -> bool:
    for user in file.users.values():
        stations, offsets, _ = lane.along(user.places[:1])
        if -10.0 < float(stations[0]) < lane.length_m + 10.0 and abs(float(offsets[0])) < 4.0:
            return False
    return True


def draw_run_red_light(file: WrittenFile, rng: random.Random) -> Drawn | None:
    """Make a vehicle cross its light, which is red for long."""
    options = []
    for user in movers(file, 60):
        lane = on_lane(file, user)
        if lane is None or not lane.successors:
            continue
        ahead = lane.length_m - float(lane.along(user.fronts[:1])[0][0])
        if 12.0 < ahead < 3.0 * float(user.speeds[0]) and _drives_over(user, lane):
            options.append((user, lane))
    if not options:
        return None
    user, lane = rng.choice(options)
    edits = (
        {"op": "set_light", "to": [str(lane.key)], "params": ["red=90", "green=20"]},
        {"op": "run_red_light", "vehicles": [str(user.key)]},
    )

    def judge(base: WrittenFile, new: WrittenFile, told: StatedVerdicts) -> str:  # noqa: ARG001
        after, here = new.users[user.key], new.lanes[lane.key]
        step = crossed(after, here)
        if step is None:
            return "" if told.verdicts[1] != "done" else "does not cross, but is reported done"
        colours = {new.lights[key].colour(step) for key in here.lights if key in new.lights}
        return "" if colours == {"red"} else f"crosses at {colours}"

    return Drawn("run_red_light", edits, judge, frozenset([user.key]))


def _drives_over(user: RoadUser, lane: Lane) -> bool:
    return crossed(user, lane) is not None


MOTION_KINDS = (
    draw_swerve,
    draw_rate,
    draw_relative,
    draw_lane_change,
    draw_cut_in,
    draw_wrong_way,
    draw_run_red_light,
)
