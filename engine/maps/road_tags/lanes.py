"""Determines a road's lanes in either direction: number, arrows, widths, and bus lanes.

After OSM's documentation: Key:lanes, Key:turn, Key:width, Lanes (https://wiki.openstreetmap.org/wiki/Lanes). Lists of
lane values (``a|b|c``) run from left to right, seen in the lanes' direction.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from .access import Direction, lane_users, lane_values

Tags = Mapping[str, str]
_MOST_LANES = 32
_NARROWEST_LANE_M = 2.0
"""A car of 1.8 m and 0.1 m on either side: no car drives on a narrower lane (chosen)."""
SHARED_LANE_M = 2.75
"""Width of either lane if a road has one lane for both directions: the narrowest lane of a local street (RASt 06)."""
_ONEWAY = {"yes": 1, "true": 1, "1": 1, "-1": -1, "reverse": -1, "no": 0, "false": 0, "0": 0, "alternating": 0}
_RINGS = ("roundabout", "circular")
_IMPLIED_ONEWAY = ("motorway", "motorway_link")
_LEFT, _RIGHT = ("left", "sharp_left"), ("right", "sharp_right")


@dataclass(frozen=True)
class Side:
    """The lanes of one direction, from left to right: their arrows, and which are for buses only.

    ``turns``: the values of ``turn:lanes``; empty if no arrow is known. ``widths_m``: the mapped width of each lane.
    """

    count: int | None = None
    turns: tuple[str, ...] = ()
    buses: tuple[bool, ...] = ()
    widths_m: tuple[float | None, ...] = ()
    uneven: bool = False


@dataclass(frozen=True)
class Lanes:
    """The lanes of a road; ``notes`` lists by key the tags that could not be followed.

    ``oneway``: 1 and -1 for a road in one direction (along its nodes, against them), 0 for both. ``width_m``: width of
    the whole carriageway. ``too_narrow``: no car fits on it.
    """

    oneway: int
    forward: Side = field(default_factory=Side)
    backward: Side = field(default_factory=Side)
    width_m: float | None = None
    too_narrow: bool = False
    notes: tuple[str, ...] = ()


def oneway_of(tags: Tags) -> int:
    """Return 1 if cars use a road only along its nodes, -1 if only against them, 0 if in both directions."""
    for key in ("oneway:motorcar", "oneway:motor_vehicle", "oneway:vehicle", "oneway"):
        value = tags.get(key, "")
        if value in _ONEWAY:
            return _ONEWAY[value]
        if value == "reversible":
            return 1
        if value and key == "oneway":
            return 0
    return int(tags.get("junction") in _RINGS or tags.get("highway") in _IMPLIED_ONEWAY)


def lanes_of(tags: Tags, *, lefthand: bool, oneway: int | None = None, default: int = 1) -> Lanes:
    """Return the lanes that a road's tags state.

    Args:
        tags: the road's tags.
        lefthand: whether traffic keeps left.
        oneway: the direction, if tags other than those of lanes determine it (access in one direction).
        default: the number of lanes in each direction if the tags do not state it.
    """
    oneway = oneway_of(tags) if oneway is None else oneway
    notes = ["reversible"] if tags.get("oneway") == "reversible" else []
    forward, backward = (_side(tags, direction, oneway) for direction in ("forward", "backward"))
    total = _count(tags, "lanes")
    both_ways = _middle_lanes(tags)
    if oneway == 0:
        forward, backward, more = _shared_out(forward, backward, total, both_ways)
        notes += more
    elif oneway > 0 and forward.count is None and total:
        forward = replace(forward, count=max(total, 1))
    elif oneway < 0 and backward.count is None and total:
        backward = replace(backward, count=max(total, 1))
    if both_ways:
        notes.append("middle_lane")
    if forward.uneven or backward.uneven:
        notes.append("uneven")
    alone = oneway != 0
    if not _is_placed(tags, oneway, forward.count or default):
        notes.append("placement")
    forward = _with_bus_lanes(_trimmed(forward), _bus_lanes(tags, "forward", alone, lefthand), lefthand=lefthand)
    backward = _with_bus_lanes(_trimmed(backward), _bus_lanes(tags, "backward", alone, lefthand), lefthand=lefthand)
    lanes = Lanes(oneway, forward, backward, notes=tuple(notes))
    return _with_widths(lanes, tags, total, default)


def _side(tags: Tags, direction: Direction, oneway: int) -> Side:
    """Return the lanes that the tags state for one direction; an empty side if the direction has no traffic."""
    if (oneway > 0 and direction == "backward") or (oneway < 0 and direction == "forward"):
        return Side()
    alone = oneway != 0
    turns = lane_values(tags, "turn", direction, oneway=alone)
    users = lane_users(tags, direction, oneway=alone)
    widths = [_metres(value) for value in lane_values(tags, "width", direction, oneway=alone)]
    count = _count(tags, f"lanes:{direction}") or (_count(tags, "lanes") if alone else None)
    listed = max(len(turns), len(users), len(widths))
    if users:  # the lists include lanes for bicycles, ``lanes`` does not
        kept = [index for index, allowed in enumerate(users) if allowed]
        turns = [turns[index] for index in kept if index < len(turns)]
        widths = [widths[index] for index in kept if index < len(widths)]
        users, listed = [users[index] for index in kept], len(kept)
    if count is None:
        count = listed or None
    buses = [("bus" in allowed and "car" not in allowed) for allowed in users]
    uneven = any(len(each) not in (0, count) for each in (turns, users, widths))
    return Side(count, tuple(turns), tuple(buses), tuple(widths), uneven)


def _is_placed(tags: Tags, oneway: int, count: int) -> bool:
    """Return whether netconvert draws the lanes as ``placement`` states; it does so on one-way roads.

    ``right_of:1`` is the right edge of the leftmost lane (https://wiki.openstreetmap.org/wiki/Key:placement).
    """
    keys = [key for key in tags if key.partition(":")[0] == "placement"]
    if not keys:
        return True
    placement = re.fullmatch(r"(?:left_of|middle_of|right_of):(\d{1,2})", tags.get("placement", ""))
    return oneway == 1 and keys == ["placement"] and placement is not None and 1 <= int(placement[1]) <= count


def _trimmed(side: Side) -> Side:
    """Return a side without the lists that do not have one value per lane."""
    count = min(side.count, _MOST_LANES) if side.count else None
    lists = {name: values for name in ("turns", "buses", "widths_m") if len(values := getattr(side, name)) == count}
    return Side(count, lists.get("turns", ()), lists.get("buses", ()), lists.get("widths_m", ()))


def _shared_out(forward: Side, backward: Side, total: int | None, middle: int) -> tuple[Side, Side, list[str]]:
    """Return the two directions with lane counts derived from the tagged counts, and the codes of notes."""
    if total is None:
        return forward, backward, []
    through = max(total - middle, 0)
    if forward.count is not None and backward.count is not None:
        return forward, backward, []
    if forward.count is not None:
        return forward, replace(backward, count=max(through - forward.count, 1)), []
    if backward.count is not None:
        return replace(forward, count=max(through - backward.count, 1)), backward, []
    if through <= 1:
        return replace(forward, count=1), replace(backward, count=1), ["one_lane"] if total == 1 else []
    odd = ["odd_lanes"] if through % 2 else []
    return replace(forward, count=math.ceil(through / 2)), replace(backward, count=through // 2), odd


def _middle_lanes(tags: Tags) -> int:
    """Return the number of lanes that both directions share, for example for left turns."""
    count = _count(tags, "lanes:both_ways")
    if count is not None:
        return count
    listed = len(tags["turn:lanes:both_ways"].split("|")) if tags.get("turn:lanes:both_ways") else 0
    return listed or int(tags.get("centre_turn_lane", tags.get("center_turn_lane", "no")) == "yes")


def _bus_lanes(tags: Tags, direction: Direction, alone: bool, lefthand: bool) -> int:
    """Return the number of bus lanes at the kerb, from tags that do not state which lanes are for buses."""
    for key in ("lanes:psv", "lanes:bus"):
        for name in (f"{key}:{direction}", *([key] if alone else [])):
            if (count := _count(tags, name)) is not None:
                return count
        if not alone and (count := _count(tags, key)) is not None and count % 2 == 0:
            return count // 2
    kerb = "left" if lefthand == (direction == "forward") else "right"
    marked = (tags.get("busway", ""), tags.get("busway:both", ""), tags.get(f"busway:{kerb}", ""))
    return int("lane" in marked)


def _with_bus_lanes(side: Side, number: int, *, lefthand: bool) -> Side:
    """Return a side with a number of bus lanes at the kerb, unless its lists state which lanes are for buses."""
    if not number or not side.count or any(side.buses):
        return side
    others = max(side.count - number, 0)
    buses = [*([False] * others), *([True] * (side.count - others))]
    return replace(side, buses=tuple(buses[::-1] if lefthand else buses))


def _with_widths(lanes: Lanes, tags: Tags, total: int | None, default: int) -> Lanes:
    """Return lanes with the road's width, and with notes and changes if a car does not fit."""
    mapped = _metres(tags.get("width:carriageway", "")) or _metres(tags.get("width", ""))
    width = mapped or _metres(tags.get("est_width", ""))
    sides = [side for side, there in ((lanes.forward, lanes.oneway >= 0), (lanes.backward, lanes.oneway <= 0)) if there]
    counts = [side.count or default for side in sides]
    narrow = any(w is not None and w < _NARROWEST_LANE_M for side in sides for w in side.widths_m)
    notes = list(lanes.notes) + (["narrow_lane"] if narrow else [])
    if "one_lane" in notes or (tags.get("oneway") == "alternating" and total in (None, 1)):
        is_narrow = width is not None and width < _NARROWEST_LANE_M
        notes = [*notes, "one_lane"] if "one_lane" not in notes else notes
        widened = max(2 * SHARED_LANE_M, mapped or 0.0)
        return replace(lanes, width_m=widened, too_narrow=is_narrow, notes=tuple(notes))
    if width is None or any(side.widths_m for side in sides):
        return replace(lanes, notes=tuple(notes))
    if width < _NARROWEST_LANE_M:
        return replace(lanes, too_narrow=True, notes=tuple(notes))
    if width / sum(counts) >= _NARROWEST_LANE_M:
        return replace(lanes, width_m=mapped, notes=tuple(notes))
    if lanes.oneway == 0 and counts == [1, 1] and total is None:
        return replace(lanes, width_m=2 * SHARED_LANE_M, notes=(*notes, "one_lane"))
    return replace(lanes, notes=(*notes, "width_for_fewer"))


def _count(tags: Tags, key: str) -> int | None:
    """Return a number of lanes: the lowest of a list, or None for any other text."""
    parts = [part.strip() for part in tags.get(key, "").split(";")]
    numbers = [round(float(part)) for part in parts if re.fullmatch(r"\d{1,3}(\.\d)?", part)]
    return min(numbers) if numbers else None


def _metres(text: str) -> float | None:
    """Return a width in m from metres, or feet and inches (``12'6"``, ``10 ft``); None for any other text."""
    plain = text.strip().lower().replace(",", ".")
    if match := re.fullmatch(r"(\d{1,3}(?:\.\d{1,4})?)\s*(m|metres?|meters?|cm|ft|feet)?", plain):
        number = float(match[1]) * {"cm": 0.01, "ft": 0.3048, "feet": 0.3048}.get(match[2] or "m", 1.0)
    elif match := re.fullmatch(r"""(\d{1,3})'\s*(?:(\d{1,2}(?:\.\d{1,2})?)")?""", plain):
        number = 0.3048 * (int(match[1]) + float(match[2] or 0) / 12)
    else:
        return None
    return number if 0.3 < number < 100 else None


def arrows(turns: Sequence[str]) -> tuple[str, ...]:
    """Return the directions of lanes, left to right.

    Lanes without arrows lead straight on; the outer lanes also lead to their side.

    A lane next to a right arrow leads to the right only if it has an arrow to the right, or if no other lane does.
    """
    parts = [{word.strip() for word in turn.split(";")} - {""} for turn in turns]
    has_left, has_right = (any(words & set(side) for words in parts) for side in (_LEFT, _RIGHT))
    leading = []
    for index, words in enumerate(parts):
        if not words - {"none"}:
            words = {"through"}
            words |= {"left"} if index == 0 and not has_left else set()
            words |= {"right"} if index == len(parts) - 1 and not has_right else set()
        elif words <= {"merge_to_left", "merge_to_right"}:
            words = {"through"}
        leading.append(";".join(sorted(words - {"none", "merge_to_left", "merge_to_right"})))
    return tuple(leading)


def mirrored(turns: Sequence[str]) -> tuple[str, ...]:
    """Return arrows of lanes mirrored: from right to left, with left and right swapped."""
    swapped = {"left": "right", "right": "left"}
    return tuple(re.sub("left|right", lambda match: swapped[match[0]], turn) for turn in reversed(turns))
