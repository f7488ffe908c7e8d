"""Words of a request to the vocabulary's names: case, plural and everyday words are understood, others refused."""

from collections.abc import Callable, Iterable

from plannerforge.schemas.errors import UnknownName, closest
from plannerforge.schemas.vocabulary import FEATURES, MEASURES, OBSTACLE_TYPES, ROAD_NET_KEYS, TAGS

NameOf = Callable[[str], str]

_OBSTACLE_WORDS = {
    "bike": "bicycle",
    "cyclist": "bicycle",
    "motorbike": "motorcycle",
    "lorry": "truck",
    "lorries": "truck",
    "buses": "bus",
    "coach": "bus",
    "parkedcar": "parkedVehicle",
    "emergencyvehicle": "priorityVehicle",
}
_MEASURE_WORDS = {"timetocollision": "ttc", "duration": "horizon", "trafficdensity": "density"}
_ROAD_NET_WORDS = {"signal": "traffic_light", "trafficsignal": "traffic_light", "stopsign": "stop", "giveway": "yield"}


def tag_name(word: str) -> str:
    """A tag of the vocabulary.

    Raises:
        UnknownName: with the nearest tags.
    """
    return _name(word, TAGS, {}, "tag", "use text for what no tag says, or features for what the geometry shows")


def feature_name(word: str) -> str:
    """A computed feature.

    Raises:
        UnknownName: with the nearest features.
    """
    return _name(word, [*FEATURES, *MEASURES], {}, "feature", "describe_catalog lists the features")


def measure_name(word: str) -> str | None:
    """A measure that features are compared by; None for any other word."""
    key = _key(word)
    return _MEASURE_WORDS.get(key, key if key in MEASURES else None)


def road_net_name(word: str) -> str:
    """A sign, ``traffic_light`` or ``lanes``.

    Raises:
        UnknownName: with the nearest keys.
    """
    return _name(word, ROAD_NET_KEYS, _ROAD_NET_WORDS, "road_net key", "describe_catalog lists the road_net keys")


def obstacle_name(word: str) -> str:
    """A CommonRoad obstacle type.

    Raises:
        UnknownName: with the nearest types.
    """
    return _name(word, OBSTACLE_TYPES, _OBSTACLE_WORDS, "obstacle type", "describe_catalog lists the obstacle types")


def _name(word: str, known: Iterable[str], everyday: dict[str, str], what: str, next_step: str) -> str:
    names = list(known)
    by_key = {**everyday, **{_key(name): name for name in names}}
    key = _key(word)
    for spelling in (key, key.removesuffix("s")):
        if spelling in by_key:
            return by_key[spelling]
    raise UnknownName(f"'{word.strip()}' is no {what}", valid=closest(word, names), next_step=next_step)


def _key(word: str) -> str:
    return "".join(letter for letter in word.casefold() if letter.isalnum())
