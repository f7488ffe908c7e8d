"""A speed limit that nobody would sign."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule
from plannerforge.engine.network.sign_numbers import SPEED_LIMITS

FASTEST_MPS = 60.0


def _find(document: RoadDocument) -> Iterator[Defect]:
    for sign in document.signs:
        for number, values in sign.plates:
            for text in values if number in SPEED_LIMITS else ():
                if not 0 < _speed(text) <= FASTEST_MPS:
                    yield Defect(f"a limit of {text!r} m/s", (sign.sign_id,), sign.position)


def _speed(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")


RULE = Rule(
    rule_id="implausible_speed_limit",
    severity="warning",
    meaning="A speed limit is no number, not above 0, or above 60 m/s.",
    why="Limits are in m/s; a larger one was probably written in km/h, and planners would aim at it.",
    find=_find,
)
