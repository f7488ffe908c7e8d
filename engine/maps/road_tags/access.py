"""Who may use a road, by OSM's access tags, and where barriers stand in the way.

A more special key overrules a more general one, and a lane or direction the whole road, as OSM's documentation has it
(https://wiki.openstreetmap.org/wiki/Key:access, "Transport mode restrictions"). Values count as in OSM's routers:
``destination`` and its like open a road to those who have business there, so that it stays a road; ``private`` and
``permit`` close it to general traffic (https://wiki.openstreetmap.org/wiki/OSM_tags_for_routing/Access_restrictions).
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
"""The keys that rule each road user, the most special first."""
ROAD_USERS: tuple[RoadUser, ...] = tuple(_KEYS)
_OPEN = frozenset({"yes", "permissive", "designated", "official", "allowed", "discouraged"})
_FOR_ACCESS = frozenset({"destination", "customers", "delivery", "residents", "resident"})
"""Open to those who have business there: routers let a way begin or end on such a road."""
_CLOSING = """
no private permit agricultural forestry military emergency restricted use_sidepath dismount
"""
_CLOSED = frozenset(_CLOSING.split())
_FOR_ONE: Mapping[str, RoadUser] = {"bus": "bus", "psv": "bus", "hgv": "truck", "taxi": "taxi"}
"""Values that stand for one road user and close the road to the others."""


def _says(value: str, user: RoadUser) -> bool | None:
    """Whether a tag's value opens a road to a user; None for values that say nothing.

    Of a list (``agricultural;forestry``) one value that opens the road is enough.
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
    """Whether the tags of a way or node open it to a road user (in a direction); ``otherwise``: if they say nothing."""
    for key in _KEYS[user]:
        for name in (f"{key}:{direction}", key) if direction else (key,):
            if name in tags and (verdict := _says(tags[name], user)) is not None:
                return verdict
    return otherwise


def users_of(tags: Tags, direction: Direction | None = None) -> frozenset[RoadUser]:
    """The motor vehicles that may use a road (in a direction)."""
    if not any(key in tags for key in _RULING):
        return _EVERYBODY
    directions: tuple[Direction | None, ...] = (direction,) if direction else ("forward", "backward")
    return frozenset(user for user in ROAD_USERS if any(is_open(tags, user, way) for way in directions))


_EVERYBODY = frozenset(ROAD_USERS)
_RULING = frozenset(
    f"{key}{suffix}" for keys in _KEYS.values() for key in keys for suffix in ("", ":forward", ":backward")
)


def closing_tag(tags: Tags) -> str:
    """The tag that closes a road to cars, as ``key=value``; empty where none does."""
    for key in _KEYS["car"]:
        for name in (key, f"{key}:forward", f"{key}:backward"):
            if name in tags and _says(tags[name], "car") is False:
                return f"{name}={tags[name]}"
    return ""


def is_for_access_only(tags: Tags) -> bool:
    """Whether a road is open to cars that have business there and not to through traffic."""
    for key in _KEYS["car"]:
        words = {word.strip() for word in tags.get(key, "").lower().split(";")}
        if words & (_OPEN | _FOR_ACCESS | _CLOSED):
            return bool(words & _FOR_ACCESS) and not words & _OPEN
    return False


def conditional_tags(tags: Tags) -> list[str]:
    """The access tags that hold at some times or for some vehicles only: a scenario has no time of day."""
    ruling = {key for keys in _KEYS.values() for key in keys}
    return sorted(
        f"{key}={value}"
        for key, value in tags.items()
        if key.endswith(":conditional") and key.partition(":")[0] in ruling | {"oneway"}
    )


def lane_users(tags: Tags, direction: Direction, *, oneway: bool) -> list[frozenset[RoadUser]]:
    """For each lane in a direction, from left to right, who may use it; empty where no tag tells lanes apart.

    A lane that is designated for buses is theirs alone unless a tag lets others onto it.
    """
    lists = {
        key: values
        for key in {key for keys in _KEYS.values() for key in keys}
        if (values := lane_values(tags, key, direction, oneway=oneway))
    }
    count = max((len(values) for values in lists.values()), default=0)
    return [_users_of_lane(tags, lists, index, direction) for index in range(count)]


def lane_values(tags: Tags, key: str, direction: Direction, *, oneway: bool) -> list[str]:
    """What ``key:lanes`` says of each lane in a direction, from left to right; empty where it says nothing."""
    text = tags.get(f"{key}:lanes:{direction}") or (tags.get(f"{key}:lanes", "") if oneway else "")
    return [part.strip() for part in text.split("|")] if text else []


def _users_of_lane(tags: Tags, lists: Mapping[str, list[str]], index: int, direction: Direction) -> frozenset[RoadUser]:
    users: set[RoadUser] = set()
    for user in ROAD_USERS:
        verdict = None
        for key in _KEYS[user]:
            values = lists.get(key, [])
            verdict = _says(values[index], user) if index < len(values) and values[index] else None
            if verdict is not None:
                break
        if is_open(tags, user, direction) if verdict is None else verdict:
            users.add(user)
    said = {key for key, values in lists.items() if index < len(values) and values[index]}
    designated = any(index < len(lists.get(key, ())) and lists[key][index] == "designated" for key in ("bus", "psv"))
    if designated and said.isdisjoint(_KEYS["car"]):
        users -= {"car", "truck", "van", "motorcycle"}
    return frozenset(users)


_LETTING_THROUGH = """
gate lift_gate toll_booth border_control cattle_grid entrance height_restrictor sally_port kerb rumble_strip coupure no
arch
"""
_PASSABLE = frozenset(_LETTING_THROUGH.split())
"""Kinds of barriers that let cars through unless their access tags say otherwise, as OSRM's and GraphHopper's profiles
for cars have it; all other kinds stop them (bollards, blocks, chains, stiles …)."""


def barrier_of(tags: Tags) -> str:
    """The tag of a node that stops cars, as ``key=value``; empty where they get through."""
    kind = tags.get("barrier", "")
    if not kind:
        return closing_tag(tags) if not _RULING.isdisjoint(tags) and not is_open(tags, "car") else ""
    passable = kind in _PASSABLE or tags.get("bollard") == "rising"
    if tags.get("locked") == "yes":
        passable = False
    return "" if is_open(tags, "car", otherwise=passable) else closing_tag(tags) or f"barrier={kind}"


def in_words(names: Iterable[str], most: int = 3) -> str:
    """Names in their order, each once, with the number of the others."""
    different = list(dict.fromkeys(names))
    more = f" and {len(different) - most} more" if len(different) > most else ""
    return ", ".join(different[:most]) + more
