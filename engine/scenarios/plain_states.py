"""The states of recorded trajectories, straight from the XML into arrays.

commonroad-io makes an object of every state and tries it on twelve classes: half of the time that a file costs. Nearly
all states are plain: a point, and exact values for everything else. Those are read here; whatever is not plain stays in
the document for commonroad-io, so that it alone decides what a state may be.
"""

from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np

from plannerforge.engine.geometry.polyline import Points, Values

_NEEDED = frozenset({"time", "position", "orientation"})


@dataclass(frozen=True)
class PlainStates:
    """States after the initial one: positions (n, 2) in metres, headings (n,) and speeds (n,), NaN where not given."""

    positions: Points
    headings_rad: Values
    speeds_mps: Values


def take_plain_states(document: Element) -> dict[int, PlainStates]:
    """Take the states of plain trajectories out of a CommonRoad document, by the id of their obstacle.

    The first and the last state of each stay, so that commonroad-io reads a trajectory of the same duration. A
    trajectory is left whole where one of its states differs from the others in its fields, gives an interval or a
    region, or holds a text that is no number, or none that is finite.
    """
    found = {}
    for obstacle in document:
        trajectory = obstacle.find("trajectory") if obstacle.tag in ("dynamicObstacle", "obstacle") else None
        number = obstacle.get("id", "")
        if trajectory is not None and number.isdecimal() and len(trajectory) > 2:
            states = _read(trajectory)
            if states is not None:
                found[int(number)] = states
                del trajectory[1:-1]
    return found


def _read(trajectory: Element) -> PlainStates | None:
    rows = [_values(state) for state in trajectory]
    fields = rows[0].keys()
    if not fields >= _NEEDED or any(row.keys() != fields for row in rows):
        return None
    try:
        times = [int(_exact(row["time"])) for row in rows]
        columns = {
            field: [float(_exact(row[field])) for row in rows] for field in sorted(fields - {"time", "position"})
        }
        positions = [_point(row["position"]) for row in rows]
    except ValueError:
        return None
    if min(times) < 0 or not np.isfinite([*columns.values()]).all():
        return None
    return PlainStates(
        positions=np.array(positions, dtype=float),
        headings_rad=np.array(columns["orientation"], dtype=float),
        speeds_mps=np.array(columns.get("velocity", [np.nan] * len(rows)), dtype=float),
    )


def _values(state: Element) -> dict[str, Element]:
    """The one child of every field by the field's name; empty where a field is given twice or has more children."""
    if state.tag != "state" or any(len(field) != 1 for field in state):
        return {}
    values = {field.tag: field[0] for field in state}
    return values if len(values) == len(state) else {}


def _exact(value: Element) -> str:
    if value.tag != "exact":
        raise ValueError(value.tag)
    return value.text or ""


def _point(value: Element) -> tuple[float, float]:
    if value.tag != "point" or len(value) != 2 or value[0].tag != "x" or value[1].tag != "y":
        raise ValueError(value.tag)
    return float(value[0].text or ""), float(value[1].text or "")
