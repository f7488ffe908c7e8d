"""Determines the users of a road from OSM's access tags, and the barriers that block the road.

A more specific key overrides a more general one, and a lane or direction overrides the whole road, as in OSM's
documentation (https://wiki.openstreetmap.org/wiki/Key:access, "Transport mode restrictions"). Values count as in OSM's
routers: ``destination`` and similar values open a road to users with business there, so it remains a road; ``private``
and ``permit`` close it to general traffic
(https://wiki.openstreetmap.org/wiki/OSM_tags_for_routing/Access_restrictions).
"""

from collections.abc import Iterable, Mapping
from typing import Literal

Tags = Mapping[str, str]
Direction = Literal["forward", "backward"]
RoadUser = Literal["car", "taxi", "truck", "van", "bus", "motorcycle"]

_MOTOR = ("motor_vehicle", "vehicle", "access")
_KEYS: Mapping[RoadUser, tuple[str, ...]] = {
    "car": ("motorcar", *_MOTOR),
    "taxi": ("taxi", "psv", "motorcar", *_MOTOR),
    "truck": ("hgv", *_MOTOR),
    "van": ("goods", *_MOTOR),
    "bus": ("bus", "psv", *_MOTOR),
    "motorcycle": ("motorcycle", *_MOTOR),
}
"""The keys that apply to each road user, the most specific first."""
ROAD_USERS: tuple[RoadUser, ...] = tuple(_KEYS)
_OPEN = frozenset({"yes", "permissive", "designated", "official", "allowed", "discouraged"})
_FOR_ACCESS = frozenset({"destination", "customers", "delivery", "residents", "resident"})
"""Values that open a road to users with business there: routers may begin or end a route on it."""
_CLOSING = """
no private permit agricultural forestry military emergency restricted use_sidepath dismount
"""
_CLOSED = frozenset(_CLOSING.split())
_FOR_ONE: Mapping[str, RoadUser] = {"bus": "bus", "psv": "bus", "hgv": "truck", "taxi": "taxi"}
"""Values that stand for one road user and close the road to the others."""


def _permits(value: str, user: RoadUser) -> bool | None:
    """Return whether a tag's value opens a road to a user, or None if the value does not decide this.

    In a list (``agricultural;forestry``), one opening value suffices.
    """
    verdicts = []
    for part in value.lower().split(";"):
        word = part.strip()
        if word in _OPEN or word in _FOR_ACCESS:
            verdicts.append(True)
        elif word in _FOR_ONE:
            verdicts.append(_FOR_ONE[word] == user or (word == "psv" and user == "taxi"))
        elif word in _CLOSED:
            verdicts.append(False)
    return any(verdicts) if verdicts else None


def is_open(tags: Tags, user: RoadUser, direction: Direction | None = None, *, otherwise: bool = True) -> bool:
    """Return whether tags open a way or node to a road user (in a direction); ``otherwise`` if they do not say."""
    for key in _KEYS[user]:
        for name in (f"{key}:{direction}", key) if direction else (key,):
            if name in tags and (verdict := _permits(tags[name], user)) is not None:
                return verdict
    return otherwise


def users_of(tags: Tags, direction: Direction | None = None) -> frozenset[RoadUser]:
    """Return the motor vehicles that may use a road (in a direction)."""
    if _RULING.isdisjoint(tags):
        return _EVERYBODY
    directions: tuple[Direction | None, ...] = (direction,) if direction else ("forward", "backward")
    return frozenset(user for user in ROAD_USERS if any(is_open(tags, user, way) for way in directions))


def is_for_cars(tags: Tags) -> bool:
    """Return whether cars may use a road in at least one direction."""
    return _RULING.isdisjoint(tags) or is_open(tags, "car", "forward") or is_open(tags, "car", "backward")


_EVERYBODY = frozenset(ROAD_USERS)
_RULING = frozenset(
    f"{key}{suffix}" for keys in _KEYS.values() for key in keys for suffix in ("", ":forward", ":backward")
)


def closing_tag(tags: Tags) -> str:
    """Return the tag that closes a road to cars, as ``key=value``; empty if there is none."""
    for key in _KEYS["car"]:
        for name in (key, f"{key}:forward", f"{key}:backward"):
            if name in tags and _permits(tags[name], "car") is False:
                return f"{name}={tags[name]}"
    return ""


def is_for_access_only(tags: Tags) -> bool:
    """Return whether a road is open to cars with business there but not to through traffic."""
    for key in _KEYS["car"]:
        words = {word.strip() for word in tags.get(key, "").lower().split(";")}
        if words & (_OPEN | _FOR_ACCESS | _CLOSED):
            return bool(words & _FOR_ACCESS) and not words & _OPEN
    return False


def conditional_tags(tags: Tags) -> list[str]:
    """Return the access tags for certain times or vehicles only, since a scenario has no time of day."""
    ruling = {key for keys in _KEYS.values() for key in keys}
    return sorted(
        f"{key}={value}"
        for key, value in tags.items()
        if key.endswith(":conditional") and key.partition(":")[0] in ruling | {"oneway"}
    )


def lane_users(tags: Tags, direction: Direction, *, oneway: bool) -> list[frozenset[RoadUser]]:
    """Return the users of each lane in a direction, from left to right; empty if no tag distinguishes lanes.

    A lane that is designated for buses is for buses only, unless a tag admits other vehicles.
    """
    lists = {
        key: values
        for key in {key for keys in _KEYS.values() for key in keys}
        if (values := lane_values(tags, key, direction, oneway=oneway))
    }
    count = max((len(values) for values in lists.values()), default=0)
    return [_users_of_lane(tags, lists, index, direction) for index in range(count)]


def lane_values(tags: Tags, key: str, direction: Direction, *, oneway: bool) -> list[str]:
    """Return the value of ``key:lanes`` for each lane in a direction, left to right; empty if there is no such tag."""
    text = tags.get(f"{key}:lanes:{direction}") or (tags.get(f"{key}:lanes", "") if oneway else "")
    return [part.strip() for part in text.split("|")] if text else []


def _users_of_lane(tags: Tags, lists: Mapping[str, list[str]], index: int, direction: Direction) -> frozenset[RoadUser]:
    users: set[RoadUser] = set()
    for user in ROAD_USERS:
        verdict = None
        for key in _KEYS[user]:
            values = lists.get(key, [])
            verdict = _permits(values[index], user) if index < len(values) and values[index] else None
            if verdict is not None:
                break
        if is_open(tags, user, direction) if verdict is None else verdict:
            users.add(user)
    stated = {key for key, values in lists.items() if index < len(values) and values[index]}
    designated = any(index < len(lists.get(key, ())) and lists[key][index] == "designated" for key in ("bus", "psv"))
    if designated and stated.isdisjoint(_KEYS["car"]):
        users -= {"car", "truck", "van", "motorcycle"}
    return frozenset(users)


_LETTING_THROUGH = """
gate lift_gate toll_booth border_control cattle_grid entrance height_restrictor sally_port kerb rumble_strip coupure no
arch
"""
_PASSABLE = frozenset(_LETTING_THROUGH.split())
"""Kinds of barriers that let cars through unless their access tags deny it, as in OSRM's and GraphHopper's profiles for
cars; all other kinds stop them (bollards, blocks, chains, stiles …).
"""


def barrier_of(tags: Tags) -> str:
    """Return the tag of a node that stops cars, as ``key=value``; empty if they can pass."""
    kind = tags.get("barrier", "")
    if not kind:
        return closing_tag(tags) if not _RULING.isdisjoint(tags) and not is_open(tags, "car") else ""
    passable = kind in _PASSABLE or tags.get("bollard") == "rising"
    if tags.get("locked") == "yes":
        passable = False
    return "" if is_open(tags, "car", otherwise=passable) else closing_tag(tags) or f"barrier={kind}"


def in_words(names: Iterable[str], most: int = 3) -> str:
    """Return the first names in order as text, each once, with the number of the names left out."""
    different = list(dict.fromkeys(names))
    more = f" and {len(different) - most} more" if len(different) > most else ""
    return ", ".join(different[:most]) + more
