"""Parses a position along a lanelet that a user gives as a word, a fraction or metres."""

from ...schemas.errors import InvalidRequest, instead, misspelt
from ...schemas.grammar import parse_quantity

POSITION_WORDS = {
    "beginning": 0.0,
    "start": 0.0,
    "quarter": 0.25,
    "middle": 0.5,
    "three_quarter": 0.75,
    "final": 1.0,
    "end": 1.0,
}
"""Shares of a lanelet's length."""
_INSIDE_M = 0.01
"""Chosen: after rounding in a file, a point on a lanelet's edge may be outside it; where the road ends, on no
lanelet.
"""
_VALID = ("beginning", "quarter", "middle", "three_quarter", "final", "a fraction in 0…1 such as 0.66", "metres: '35m'")


def station_m(text: str, lanelet_id: int, length_m: float, margin_m: float = 0.0) -> float:
    """Return the arc length in m for a position word, a fraction or metres, at least 1 cm inside the lanelet's ends.

    Words and fractions keep ``margin_m`` (half a vehicle) from both ends; metres are used as given.

    Raises:
        InvalidRequest: there is no such word, or the position is beyond the lanelet.
    """
    body = text.strip().lower()
    if body.endswith("m") and body[:-1].strip()[-1:].isdigit():
        metres = parse_quantity(body, "m")
        if not 0.0 <= metres <= length_m:
            where, neighbour, nearest = (
                ("before its beginning", "before", "beginning")
                if metres < 0.0
                else ("beyond its end", "after", "final")
            )
            raise InvalidRequest(
                f"lanelet {lanelet_id} is {length_m:.1f} m long; {text} is {where}",
                valid=[f"0m … {length_m:.1f}m", *_VALID[:-1]],
                next_step=f"choose a position on it, or the lanelet {neighbour} it",
                remedies=[instead(text, word, "position") for word in (nearest, "middle")],
            )
        return _inside(metres, length_m, _INSIDE_M)
    fraction = POSITION_WORDS.get(body)
    if fraction is None:
        fraction = _fraction(text)
    return _inside(fraction * length_m, length_m, max(margin_m, _INSIDE_M))


def _inside(station_m: float, length_m: float, margin_m: float) -> float:
    inside = min(margin_m, length_m / 2)
    return min(max(station_m, inside), length_m - inside)


def _fraction(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise InvalidRequest(
            f"'{text}' is not a position on a lanelet",
            valid=_VALID,
            next_step="give a position in one of these forms",
            remedies=[*misspelt(text, POSITION_WORDS, "position"), instead(text, "middle", "position")],
        ) from None
    if not 0.0 <= value <= 1.0:
        nearest = "beginning" if value < 0.0 else "final"
        in_metres = [instead(text, f"{text}m", "position")] if value > 1.0 else []
        raise InvalidRequest(
            f"position {text} is not a fraction of a lanelet; metres are written '{text if in_metres else 35}m'",
            valid=_VALID,
            next_step="write metres along it with the unit, or a fraction from 0 to 1",
            remedies=[*in_metres, instead(text, nearest, "position")],
        )
    return value
