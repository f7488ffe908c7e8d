"""Wrong edits by kind: each draws an edit with a fault, alone or after a correct one."""

import random
from collections.abc import Callable
from typing import Any

import numpy as np

from .words import Arguments, Draw, misspelt
from .world import Stage, World

_PRESETS = ("aggressive", "cautious", "balanced", "speeder", "emergency", "eco")
_CLASSES = ("truck", "bus", "motorcycle", "bicycle", "taxi", "trailer", "pedestrian", "car")


def _absent(known: Any, rng: random.Random) -> int:
    """Return a number that is no id of a file."""
    taken = set(known)
    return next(number for number in iter(lambda: rng.randrange(10_000, 99_999), None) if number not in taken)


def edit_of(make: Callable[[Stage, random.Random], Arguments | None]) -> Draw:
    """Return a draw of one wrong edit, alone or after a correct one."""

    def draw(world: World, rng: random.Random) -> Arguments | None:
        stage = world.stage(rng)
        edit = make(stage, rng)
        if edit is None:
            return None
        sound = {"op": "set_weather", "params": ["weather=rain"]}
        edits = [sound, edit] if rng.random() < 0.15 else [edit]
        return {"scenario_id": stage.scenario_id, "edits": edits}

    return draw


def _vehicle(stage: Stage, rng: random.Random) -> str | None:
    found = stage.driving()
    return str(rng.choice(found)) if found else None


def _of_vehicle(**values: Any) -> Callable[[Stage, random.Random], Arguments | None]:
    """Return an edit of one vehicle; values that are callables are drawn."""

    def make(stage: Stage, rng: random.Random) -> Arguments | None:
        vehicle = _vehicle(stage, rng)
        if vehicle is None:
            return None
        drawn = {name: value(rng) if callable(value) else value for name, value in values.items()}
        return {"vehicles": [vehicle], **drawn}

    return make


def _taken_place(stage: Stage, rng: random.Random) -> Arguments | None:
    """Put a vehicle on top of another one."""
    file = stage.file
    step = file.ego.step if file.ego else 0
    there = [user for user in file.users.values() if user.at(step) is not None and not user.is_static]
    rng.shuffle(there)
    for user in there:
        index = user.at(step) or 0
        lane = file.lane_of(user.places[index], float(user.headings[index]))
        if lane is not None:
            station = float(file.lanes[lane].along(user.places[index][None])[0][0])
            if 0 < station < file.lanes[lane].length_m:
                return {"op": "add_vehicle", "vehicle_class": "car", "at": str(lane), "position": f"{station:.1f}m"}
    return None


def _unreachable(stage: Stage, rng: random.Random) -> tuple[str, str] | None:
    """Return a vehicle and a lanelet without a route between them."""
    file = stage.file
    users = [file.users[key] for key in stage.driving()]
    rng.shuffle(users)
    for user in users:
        lane = file.lane_of(user.places[0], float(user.headings[0]))
        if lane is None:
            continue
        reached, pending = {lane}, [lane]
        while pending:
            key = pending.pop()
            beside = [other for other, direction in file.lanes[key].beside.values() if direction == "same"]
            for other in (*file.lanes[key].successors, *beside):
                if other in file.lanes and other not in reached:
                    reached.add(other)
                    pending.append(other)
        far = [key for key in file.lanes if key not in reached and "sidewalk" not in file.lanes[key].kinds]
        if far:
            return str(user.key), str(rng.choice(far))
    return None


def _unreachable_route(stage: Stage, rng: random.Random) -> Arguments | None:
    found = _unreachable(stage, rng)
    return None if found is None else {"op": "reroute", "vehicles": [found[0]], "to": [found[1]]}


def _unreachable_goal(stage: Stage, rng: random.Random) -> Arguments | None:
    return {
        "op": "set_goal",
        "to": [str(rng.choice([*stage.file.lanes]))],
        "position": rng.choice(["beginning", "middle"]),
    }


def _outermost(stage: Stage, rng: random.Random) -> Arguments | None:
    """Change to a lane that does not exist."""
    file = stage.file
    users = [file.users[key] for key in stage.driving()]
    rng.shuffle(users)
    for user in users:
        lane = file.lane_of(user.places[0], float(user.headings[0]))
        for side in ("left", "right"):
            if lane is not None and file.lanes[lane].beside.get(side, (0, ""))[1] != "same":
                return {"op": "change_lane", "vehicles": [str(user.key)], "lane": side}
    return None


def _behind_the_end(stage: Stage, rng: random.Random) -> Arguments | None:
    key, lane = rng.choice([*stage.file.lanes.items()])
    far = lane.length_m + rng.choice([5.0, 40.0, 400.0])
    return {"op": "add_vehicle", "vehicle_class": "car", "at": str(key), "position": f"{far:.0f}m"}


def _late(stage: Stage, rng: random.Random) -> Arguments | None:
    vehicle = _vehicle(stage, rng)
    if vehicle is None:
        return None
    return {
        "op": "set_speed",
        "vehicles": [vehicle],
        "speed": "8m/s",
        "time_s": round(stage.last_time_s + rng.uniform(5, 90), 1),
    }


def _absent_class(stage: Stage, rng: random.Random) -> Arguments | None:
    here = {user.kind for user in stage.file.users.values()}
    absent = [name for name in ("truck", "bus", "motorcycle", "taxi", "bicycle") if name not in here]
    return (
        {"op": "remove_vehicle", "vehicles": [f"{rng.choice(['one', 'class'])}:{rng.choice(absent)}"]}
        if absent
        else None
    )


def _add(**values: Any) -> Callable[[Stage, random.Random], Arguments | None]:
    def make(stage: Stage, rng: random.Random) -> Arguments | None:
        if stage.file.ego is None:
            return None
        drawn = {name: value(rng) if callable(value) else value for name, value in values.items()}
        return {"op": "add_vehicle", "vehicle_class": "car", "at": "ego", "offset_m": 25, **drawn}

    return make


def _far_offset(stage: Stage, rng: random.Random) -> Arguments | None:
    size = float(np.ptp(np.vstack([lane.center for lane in stage.file.lanes.values()]), axis=0).max())
    return _add(offset_m=round(rng.choice([-1, 1]) * 3 * size))(stage, rng)


def wrong_edits() -> dict[str, Callable[[Stage, random.Random], Arguments | None]]:
    """Return a faulty edit by its kind of fault."""
    pick = random.Random.choice
    return {
        "preset_misspelt": _of_vehicle(op="set_behaviour", preset=lambda rng: misspelt(pick(rng, _PRESETS), rng)),
        "preset_unknown": _of_vehicle(op="set_behaviour", preset=lambda rng: pick(rng, ["drunk", "wild", "sporty"])),
        "param_misspelt": _of_vehicle(
            op="set_behaviour",
            params=lambda rng: [f"{misspelt(pick(rng, ['sigma', 'accel', 'speedFactor']), rng)}=0.5"],
        ),
        "param_out_of_range": _of_vehicle(
            op="set_behaviour", params=lambda rng: [pick(rng, ["sigma=7", "tau=-1", "accel=900", "decel=0"])]
        ),
        "param_malformed": _of_vehicle(
            op="set_behaviour", params=lambda rng: [pick(rng, ["tau", "tau=soon", "sigma:0.5"])]
        ),
        "vehicle_unknown": lambda stage, rng: {
            "op": "remove_vehicle",
            "vehicles": [str(_absent(stage.file.users, rng))],
        },
        "selector_misspelt": lambda _stage, rng: {
            "op": "remove_vehicle",
            "vehicles": [misspelt(pick(rng, ["nearest:2", "farthest", "fastest", "standing", "class:car"]), rng)],
        },
        "selector_malformed": lambda _stage, rng: {
            "op": "remove_vehicle",
            "vehicles": [pick(rng, ["nearest:many", "nearest:0", "nearest:999", "new:3", "class:unicorn"])],
        },
        "class_absent": _absent_class,
        "the_ego": lambda _stage, _rng: {"op": "remove_vehicle", "vehicles": ["ego"]},
        "lanelet_unknown": lambda stage, rng: {
            "op": "reroute",
            "vehicles": [_vehicle(stage, rng) or "nearest:1"],
            "to": [str(_absent(stage.file.lanes, rng))],
        },
        "route_unreachable": _unreachable_route,
        "turn_impossible": _of_vehicle(op="reroute", turn=lambda rng: pick(rng, ["left", "right", "straight"])),
        "no_lane_beside": _outermost,
        "goal_drawn": _unreachable_goal,
        "goal_unknown": lambda stage, rng: {"op": "set_goal", "to": [str(_absent(stage.file.lanes, rng))]},
        "goal_speed_malformed": lambda _stage, rng: {
            "op": "set_goal",
            "goal_speed": pick(rng, ["fast", "50km", "20..10m/s"]),
        },
        "goal_time_malformed": lambda _stage, rng: {"op": "set_goal", "goal_time": pick(rng, ["soon", "12..8s"])},
        "place_taken": _taken_place,
        "behind_the_end": _behind_the_end,
        "far_offset": _far_offset,
        "class_misspelt": _add(vehicle_class=lambda rng: misspelt(pick(rng, _CLASSES), rng)),
        "class_unknown": _add(vehicle_class=lambda rng: pick(rng, ["rocket", "submarine", "horse"])),
        "class_missing": lambda _stage, rng: {"op": "add_vehicle", "at": "ego", "offset_m": pick(rng, [20, 30, -20])},
        "place_missing": lambda _stage, rng: {"op": "add_vehicle", "vehicle_class": pick(rng, ["car", "truck"])},
        "place_unknown": _add(at=lambda rng: pick(rng, ["the corner", "laenlet", "vehicle:99999", "north"])),
        "position_malformed": lambda stage, rng: {
            "op": "add_vehicle",
            "vehicle_class": "car",
            "at": str(pick(rng, [*stage.file.lanes])),
            "position": pick(rng, ["midle", "halfway", "-5m", "1.5", "20 steps"]),
        },
        "speed_malformed": _of_vehicle(
            op="set_speed", speed=lambda rng: pick(rng, ["fast", "50km", "30 knots", "-3m/s"])
        ),
        "speed_too_high": _of_vehicle(op="set_speed", speed=lambda rng: f"{rng.randrange(400, 2000)}km/h"),
        "speed_missing": _of_vehicle(op="set_speed"),
        "time_late": _late,
        "many_added": _add(count=20, spacing_m=lambda rng: pick(rng, [20, 30, 50])),
        "spacing_small": _add(count=3, spacing_m=lambda rng: pick(rng, [0, 1, 2])),
        "foreign_argument": _of_vehicle(op="remove_vehicle", speed="30km/h"),
        "foreign_argument_2": _of_vehicle(op="set_speed", speed="8m/s", turn="left"),
        "op_misspelt": _of_vehicle(
            op=lambda rng: misspelt(pick(rng, ["set_speed", "reroute", "change_lane"]), rng), speed="5m/s"
        ),
        "op_unknown": _of_vehicle(op=lambda rng: pick(rng, ["teleport", "explode", "brake"])),
        "argument_misspelt": lambda stage, rng: {"op": "remove_vehicle", "vehicels": [_vehicle(stage, rng) or "all"]},
        "no_vehicle_named": lambda _stage, rng: {"op": "set_behaviour", "preset": pick(rng, _PRESETS)},
        "light_unknown": lambda stage, rng: {
            "op": "set_light",
            "to": [str(pick(rng, [*stage.file.lanes]))],
            "params": [pick(rng, ["red=10", "blue=5", "red=soon"])],
        },
        "red_light_absent": _of_vehicle(op="run_red_light"),
        "cut_in": _of_vehicle(op="cut_in", gap_s=lambda rng: pick(rng, [0.5, 1, 30])),
        "wrong_way": _of_vehicle(op="wrong_way", time_s=lambda rng: pick(rng, [0, 500])),
        "swerve": _of_vehicle(
            op="swerve", side=lambda rng: pick(rng, ["left", "up"]), offset_m=lambda rng: pick(rng, [1, 40])
        ),
        "weather": lambda _stage, rng: {
            "op": "set_weather",
            "params": [pick(rng, ["weather=hail", "wether=rain", "friction=5", "rain"])],
        },
        "close_lane": lambda stage, rng: {
            "op": "close_lane",
            **({} if rng.random() < 0.5 else {"to": [str(_absent(stage.file.lanes, rng))]}),
        },
        "crop": lambda _stage, rng: {
            "op": "crop",
            **pick(rng, [{"rectangle_m": [5]}, {"rectangle_m": [1, 1]}, {"duration_s": 0.1}, {}]),
        },
        "shift": _of_vehicle(op="shift_time", time_s=lambda rng: pick(rng, [0, 900, -900])),
        "trigger": _of_vehicle(
            op="set_speed", speed="2m/s", when=lambda rng: pick(rng, ["soon", "gap<=0.01s", "ego@99999:5m"])
        ),
        "replace": _of_vehicle(op="replace", vehicle_class=lambda rng: pick(rng, ["tank", "trcuk", "bicycl"])),
        "move": _of_vehicle(op="move", offset_m=lambda rng: pick(rng, [500, -500])),
        "ego_class": lambda _stage, rng: {"op": "set_ego", "vehicle_class": misspelt(pick(rng, ["truck", "bus"]), rng)},
        "ego_vehicle_unknown": lambda stage, rng: {"op": "set_ego", "vehicles": [str(_absent(stage.file.users, rng))]},
    }
