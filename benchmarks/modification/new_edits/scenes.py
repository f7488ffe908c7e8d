"""Drawn edits of placement and scene, each with a judge of the written file."""

import math
import random

import numpy as np

from ..written_tracks import Lane, WrittenFile
from .motion import Drawn, StatedVerdicts, movers, on_lane


def _others_same(base: WrittenFile, new: WrittenFile, changed: set[str]) -> str:
    names = {key for key in {*base.elements, *new.elements} if base.elements.get(key) != new.elements.get(key)}
    return "" if names <= changed else f"changes {sorted(names - changed)[:3]} too"


def _point_on(lane: Lane, share: float) -> tuple[np.ndarray, float]:
    station = share * lane.length_m
    x, y = (float(np.interp(station, lane.stations, lane.center[:, axis])) for axis in (0, 1))
    index = min(max(int(np.searchsorted(lane.stations, station)) - 1, 0), len(lane.center) - 2)
    step = lane.center[index + 1] - lane.center[index]
    return np.array([x, y]), math.atan2(step[1], step[0])


def _is_clear(file: WrittenFile, place: np.ndarray, without: int = 0, reach: float = 14.0) -> bool:
    ego = [] if file.ego is None else [file.ego.place]
    others = [user.places[0] for key, user in file.users.items() if key != without]
    return all(float(np.linalg.norm(other - place)) > reach for other in [*others, *ego])


def _free_lanes(file: WrittenFile, least_m: float = 25.0) -> list[Lane]:
    return [
        lane
        for lane in file.lanes.values()
        if lane.length_m > least_m
        and _is_clear(file, _point_on(lane, 0.5)[0])
        and not lane.kinds & {"sidewalk", "crosswalk", "bicycleLane", "busLane"}
    ]


def draw_move(file: WrittenFile, rng: random.Random) -> Drawn | None:
    """Draw a vehicle at another place."""
    users, lanes = movers(file), _free_lanes(file)
    if not users or not lanes:
        return None
    user, lane = rng.choice(users), rng.choice(lanes)
    edit = {"op": "move", "vehicles": [str(user.key)], "at": str(lane.key), "position": "0.5"}

    def judge(base: WrittenFile, new: WrittenFile, told: StatedVerdicts) -> str:
        before, after = base.users[user.key], new.users[user.key]
        if (after.kind, after.length_m, after.width_m, after.first) != (
            before.kind,
            before.length_m,
            before.width_m,
            before.first,
        ):
            return "is not the same vehicle"
        if float(np.linalg.norm(after.places[0] - _point_on(lane, 0.5)[0])) > 0.3:
            return "is not at the place"
        count = min(len(before.speeds), len(after.speeds))
        if user.key not in told.handed_over and float(np.abs(before.speeds - 0.0)[:count].sum()) > 0.0:
            away = float(np.abs(before.speeds[:count] - after.speeds[:count]).mean())
            if away > 0.5:
                return f"drives {away:.2f} m/s otherwise"
        return _others_same(base, new, {str(user.key), "commonRoad", *map(str, told.handed_over)})

    return Drawn("move", (edit,), judge)


def draw_replace(file: WrittenFile, rng: random.Random) -> Drawn | None:
    """Draw a vehicle of another class."""
    users = [user for user in movers(file) if user.kind == "car"]
    if not users:
        return None
    user, kind = rng.choice(users), rng.choice(["truck", "bus", "motorcycle"])
    edit = {"op": "replace", "vehicles": [str(user.key)], "vehicle_class": kind}

    def judge(base: WrittenFile, new: WrittenFile, told: StatedVerdicts) -> str:
        before, after = base.users[user.key], new.users[user.key]
        if after.kind != kind or (after.length_m > before.length_m) != (kind != "motorcycle"):
            return f"is a {after.kind} of {after.length_m} m"
        if user.key in told.handed_over:
            return ""
        away = float(np.abs(before.places - after.places).max())
        return "" if away < 0.01 else f"drives {away:.2f} m elsewhere"

    return Drawn("replace", (edit,), judge)


def draw_gap(file: WrittenFile, rng: random.Random) -> Drawn | None:
    """Draw a vehicle that enters with a time gap ahead of a recorded one."""
    options = []
    for user in movers(file):
        lane = on_lane(file, user)
        start = file.ego.step if file.ego else 0
        index = user.at(start)
        if lane is None or index is None:
            continue
        station = float(lane.along(user.places[index : index + 1])[0][0])
        for gap in (1.0, 1.5, 2.0):
            ahead = gap * float(user.speeds[index]) + 6.0
            if station + ahead + 4.0 < lane.length_m and _is_clear(
                file, _point_on(lane, (station + ahead) / lane.length_m)[0], user.key, 8.0
            ):
                options.append((user, lane, gap, start))
    if not options:
        return None
    user, lane, gap, start = rng.choice(options)
    edit = {"op": "add_vehicle", "vehicle_class": "car", "at": f"vehicle:{user.key}", "gap_s": gap, "speed": "8m/s"}

    def judge(base: WrittenFile, new: WrittenFile, told: StatedVerdicts) -> str:
        (key,) = told.added[0]
        after, other = new.users[key], base.users[user.key]
        index = start - other.first
        ahead = float(lane.along(after.places[:1])[0][0] - lane.along(other.places[index : index + 1])[0][0])
        measured = (ahead - (after.length_m + other.length_m) / 2) / float(other.speeds[index])
        return "" if abs(measured - gap) < 0.08 else f"gap {measured:.2f} s, not {gap}"

    return Drawn("gap", (edit,), judge)


def draw_standing(file: WrittenFile, rng: random.Random) -> Drawn | None:
    """Add a vehicle that stands."""
    lanes = _free_lanes(file)
    if not lanes:
        return None
    lane = rng.choice(lanes)
    edit = {"op": "add_vehicle", "vehicle_class": "car", "at": str(lane.key), "position": "0.5", "speed": "0m/s"}

    def judge(base: WrittenFile, new: WrittenFile, told: StatedVerdicts) -> str:  # noqa: ARG001
        user = new.users[told.added[0][0]]
        rolled = float(np.linalg.norm(user.places - user.places[0], axis=1).max())
        return "" if rolled < 0.05 else f"moves {rolled:.2f} m"

    return Drawn("standing", (edit,), judge)


def draw_kerb(file: WrittenFile, rng: random.Random) -> Drawn | None:
    """Draw a parked vehicle at the right kerb of a road without a lane to the right."""
    lanes = [lane for lane in _free_lanes(file) if "right" not in lane.beside]
    if not lanes:
        return None
    lane = rng.choice(lanes)
    edit = {"op": "add_vehicle", "vehicle_class": "car", "at": str(lane.key), "position": "0.5", "side": "right"}

    def judge(base: WrittenFile, new: WrittenFile, told: StatedVerdicts) -> str:  # noqa: ARG001
        user = new.users[told.added[0][0]]
        place, heading = _point_on(lane, 0.5)
        right = np.array([math.sin(heading), -math.cos(heading)])
        bound = Lane(0, lane.right, lane.right, (), (), {}, (), frozenset())
        beside = -float(bound.along(user.places[:1])[1][0]) - user.width_m / 2
        turned = abs(math.remainder(float(user.headings[0]) - heading, math.tau))
        if not user.is_static or user.kind != "parkedVehicle":
            return "is not a parked vehicle"
        if turned > 0.1 or float((user.places[0] - place) @ right) < 0.0:
            return "is not along the kerb"
        return "" if -0.1 <= beside <= 0.6 else f"stands {beside:.2f} m from the kerb"

    return Drawn("kerb", (edit,), judge)


def draw_pedestrian(file: WrittenFile, rng: random.Random) -> Drawn | None:
    """Draw a pedestrian from one side."""
    lanes = _free_lanes(file)
    if not lanes:
        return None
    lane, side = rng.choice(lanes), rng.choice(["left", "right"])
    edit = {"op": "add_vehicle", "vehicle_class": "pedestrian", "at": str(lane.key), "position": "0.5", "side": side}

    def judge(base: WrittenFile, new: WrittenFile, told: StatedVerdicts) -> str:  # noqa: ARG001
        user = new.users[told.added[0][0]]
        offsets = lane.along(user.places)[1]
        sign = 1.0 if side == "left" else -1.0
        if float(offsets[0]) * sign < lane.width_m / 2:
            return f"does not begin on the {side}"
        return "" if float(offsets[-1] - offsets[0]) * sign < 0.0 else "walks away"

    return Drawn("pedestrian", (edit,), judge)


def draw_closure(file: WrittenFile, rng: random.Random) -> Drawn | None:
    """Draw a lane that is closed for a time."""
    lanes = _free_lanes(file)
    if not lanes or file.last_step < 40:
        return None
    lane, begin, lasts = rng.choice(lanes), rng.choice([0, 10]), rng.choice([20, 25])
    edit = {
        "op": "close_lane",
        "to": [str(lane.key)],
        "position": "0.5",
        "time_s": begin * file.step_s,
        "duration_s": lasts * file.step_s,
    }

    def judge(base: WrittenFile, new: WrittenFile, told: StatedVerdicts) -> str:  # noqa: ARG001
        user = new.users[told.added[0][0]]
        if (user.first, user.last) != (begin, begin + lasts):
            return f"is there from {user.first} to {user.last}"
        if float(np.linalg.norm(user.places[0] - _point_on(lane, 0.5)[0])) > 0.3:
            return "is at another place"
        return "" if user.width_m > 0.6 * lane.width_m else "does not close the lane"

    return Drawn("closure", (edit,), judge)


def draw_light(file: WrittenFile, rng: random.Random) -> Drawn | None:
    """Draw other phases of a lane's light."""
    lanes = [lane for lane in file.lanes.values() if any(light in file.lights for light in lane.lights)]
    lanes = lanes or [lane for lane in file.lanes.values() if len(lane.successors) > 1]
    if not lanes:
        return None
    lane, red, green = rng.choice(lanes), rng.choice([5, 12]), rng.choice([8, 20])
    edit = {"op": "set_light", "to": [str(lane.key)], "params": [f"red={red}", f"green={green}"]}

    def judge(base: WrittenFile, new: WrittenFile, told: StatedVerdicts) -> str:  # noqa: ARG001
        wanted = tuple((round(value / new.step_s), colour) for value, colour in ((red, "red"), (green, "green")))
        lights = [new.lights[key] for key in new.lanes[lane.key].lights if key in new.lights]
        if not lights or any(light.phases != wanted for light in lights):
            return "has other phases"
        return ""

    return Drawn("light", (edit,), judge)


def draw_crop_time(file: WrittenFile, rng: random.Random) -> Drawn | None:
    """Draw a part of the time."""
    if file.last_step < 40 or file.ego is None:
        return None
    begin, lasts = rng.choice([0, 10]), 25
    edit = {"op": "crop", "time_s": begin * file.step_s, "duration_s": lasts * file.step_s}

    def judge(base: WrittenFile, new: WrittenFile, told: StatedVerdicts) -> str:  # noqa: ARG001
        for key, user in base.users.items():
            if user.is_static or len(user.places) < 2:
                continue
            first, last = max(user.first, begin), min(user.last, begin + lasts)
            if last - first < 1:
                if key in new.users:
                    return f"{key} is still there"
                continue
            if key not in new.users:
                return f"{key} is gone"
            after = new.users[key]
            part = user.places[first - user.first : last - user.first + 1]
            if (
                after.first != first - begin
                or after.places.shape != part.shape
                or np.abs(after.places - part).max() > 1e-6
            ):
                return f"{key} moves otherwise"
        return ""

    return Drawn("crop_time", (edit,), judge)


def draw_crop_place(file: WrittenFile, rng: random.Random) -> Drawn | None:
    """Draw a large area around the ego."""
    if file.ego is None:
        return None
    size = rng.choice([[400.0, 300.0], [600.0, 400.0]])
    edit = {"op": "crop", "at": "ego", "rectangle_m": size}

    def judge(base: WrittenFile, new: WrittenFile, told: StatedVerdicts) -> str:  # noqa: ARG001
        ego = base.ego
        if ego is None:
            return "no ego"
        reach = math.hypot(*size) / 2
        for key, lane in base.lanes.items():
            near = float(np.linalg.norm(lane.center - ego.place, axis=1).min())
            if near > reach + 60.0 and key in new.lanes:
                return f"lanelet {key} is {near:.0f} m away and kept"
            if near < min(size) / 2 - 1.0 and key not in new.lanes:
                return f"lanelet {key} is {near:.0f} m away and gone"
        known = set(new.lanes)
        dangling = [k for k, lane in new.lanes.items() if not {*lane.successors, *lane.predecessors} <= known]
        return f"lanelet {dangling[0]} leads to one that is gone" if dangling else ""

    return Drawn("crop_place", (edit,), judge, refusal_is_right=True)


def draw_mirror(file: WrittenFile, rng: random.Random) -> Drawn | None:  # noqa: ARG001
    """Draw the mirrored scene."""

    def judge(base: WrittenFile, new: WrittenFile, told: StatedVerdicts) -> str:  # noqa: ARG001
        flip = np.array([1.0, -1.0])
        for key, user in base.users.items():
            after = new.users[key]
            turned = np.abs(np.remainder(user.headings + after.headings + np.pi, 2 * np.pi) - np.pi).max()
            if np.abs(user.places * flip - after.places).max() > 1e-6 or turned > 1e-6:
                return f"road user {key} is not mirrored"
        for key, lane in base.lanes.items():
            after_lane = new.lanes[key]
            if np.abs(lane.left * flip - after_lane.right).max() > 1e-6:
                return f"lanelet {key} is not mirrored"
            swapped = {{"left": "right", "right": "left"}[side]: other for side, other in lane.beside.items()}
            if swapped != after_lane.beside:
                return f"lanelet {key} has other neighbours"
        return ""

    return Drawn("mirror", ({"op": "mirror"},), judge)


SCENE_KINDS = (
    draw_move,
    draw_replace,
    draw_gap,
    draw_standing,
    draw_kerb,
    draw_pedestrian,
    draw_closure,
    draw_light,
    draw_crop_time,
    draw_crop_place,
    draw_mirror,
)
