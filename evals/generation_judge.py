"""Whether a made scenario shows the place and the vehicles asked for; read from the made files and the map file."""

from collections.abc import Sequence

from plannerforge.evals.made_files import MadeFiles
from plannerforge.evals.map_evidence import MapEvidence

STREET_WITHIN_M, EXIT_WITHIN_M = 100.0, 200.0
"""How far the road may be that a site is called after; an exit is called after the road that it leads to, too."""


def lies_in(made: MadeFiles, box: Sequence[float], slack: float) -> bool:
    """Whether the middle lies in a box (south, west, north, east), up to ``slack`` outside; all in degrees."""
    south, west, north, east = box
    inside = south - slack <= made.latitude <= north + slack
    return inside and west - slack <= made.longitude <= east + slack


def lies_at_street(
    made: MadeFiles, street: str, places: Sequence[str], evidence: MapEvidence, within_m: float = STREET_WITHIN_M
) -> bool:
    """Whether every part of ``street, place`` is a place that the whole map shows, or something named so is near."""
    parts = [part.strip() for part in street.split(",")]
    return all(part in places or evidence.names_near(part, made.latitude, made.longitude, within_m) for part in parts)


def holds_vehicles(made: MadeFiles, wished: dict[str, tuple[int, int | None]]) -> bool:
    """Whether every class is there in the numbers asked for: (least, most) by class."""
    counts = made.classes()
    return all(
        least <= counts[name] <= (counts[name] if most is None else most) for name, (least, most) in wished.items()
    )
