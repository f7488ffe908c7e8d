"""Reads the states of plain trajectories from the XML as arrays instead of one by one.

commonroad-io creates an object for every state and tries twelve classes for it, which takes most of a file's reading
time. Nearly all states are plain: a point, and exact values for everything else. ``remove_plain_states`` reads plain
states into arrays. Other states stay in the document for commonroad-io, which alone decides whether a state is valid.
``put_states`` makes the objects that commonroad-io would have made, for libraries that need them.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np
from lxml import etree

from ..geometry import Points, Values
from .document import moving_obstacle
from .value_limits import LAST_STEP, is_within

if TYPE_CHECKING:
    from commonroad.scenario.scenario import Scenario

_NEEDED = frozenset({"time", "position", "orientation"})
_POINT = ("x", "y")
_LONGEST_ID = 16
"""Digits of 2⁵³ - 1, the largest valid id; Python refuses to convert some thousands of digits."""
_FARTHEST_FROM_ENDS_M = 10_000.0
"""Chosen: maximum distance from the box around a trajectory's first and last position."""


@dataclass(frozen=True)
class PlainStates:
    """The states after the initial state, one for each step.

    ``positions`` (n, 2) in m. ``columns``: all other exact values (n,), by the name of their element in the file,
    including headings in rad as ``orientation`` and speeds in m/s as ``velocity``.
    """

    positions: Points
    columns: Mapping[str, Values]

    @property
    def headings_rad(self) -> Values:
        """The headings in rad, shape (n,)."""
        return self.columns["orientation"]

    @property
    def speeds_mps(self) -> Values:
        """The speeds in m/s, shape (n,); NaN if there are none."""
        given = self.columns.get("velocity")
        return np.full(len(self.positions), np.nan) if given is None else given


def remove_plain_states(document: "etree._Element") -> dict[int, PlainStates]:
    """Remove the states of plain trajectories from a CommonRoad document; return them by obstacle id.

    The first and the last state of each stay, so commonroad-io reads a trajectory of the same duration. A trajectory is
    left complete if the fields of its states differ, if a state has an interval or a region, if a text is not a finite
    number within its limits, or if steps are missing. The check of the document then finds the fault.
    """
    taken = (remove_states(obstacle) for obstacle in document.iterchildren(moving_obstacle(document)))
    return dict(states for states in taken if states is not None)


def remove_states(obstacle: "etree._Element") -> tuple[int, PlainStates] | None:
    """Remove and return an obstacle's states with its id, or None if its trajectory is left complete."""
    trajectory, number = obstacle.find("trajectory"), obstacle.get("id", "")
    if trajectory is None or not _is_id(number) or not 2 < len(trajectory) <= LAST_STEP:
        return None
    states = _plain_states(trajectory)
    if states is None:
        return None
    del trajectory[1:-1]
    return int(number), states


_BEGIN, _END, _STATE_END = b"<trajectory>", b"</trajectory>", b"</state>"
_TEXT_NUMBER = re.compile(rb">([-+.\deE]+)<")


def cut_states(obstacle: bytes) -> tuple[int, PlainStates, bytes] | None:
    """Do what ``remove_states`` does for an obstacle as UTF-8 bytes without comments; also return the remaining bytes.

    This works only if the states are identical except for numbers. Programs write states in this way, and a pattern
    made from the first state finds all states in half the time. In all other cases, the result is None and a parser
    must read the states.
    """
    begin, end = obstacle.find(_BEGIN) + len(_BEGIN), obstacle.find(_END)
    first_end = obstacle.find(_STATE_END, begin) + len(_STATE_END)
    if obstacle.count(b"trajectory") != 2 or not len(_BEGIN) <= begin < first_end < end:
        return None
    literals, inside = _TEXT_NUMBER.split(obstacle[begin:first_end])[::2], obstacle[begin:end].rstrip()
    if len(literals) <= len(_NEEDED):
        return None
    rows = re.findall(b">([-+.\\deE]+)<".join(map(re.escape, literals)), inside)
    matched = len(rows) * len(b"><".join(literals)) + sum(map(len, chain.from_iterable(rows)))
    if matched != len(inside) or not 2 < len(rows) <= LAST_STEP:
        return None
    last_begin = obstacle.rfind(_STATE_END, begin, obstacle.rfind(_STATE_END, begin, end)) + len(_STATE_END)
    left = obstacle[:first_end] + obstacle[last_begin:]
    try:
        parsed = etree.fromstring(left, etree.XMLParser(resolve_entities=False, no_network=True))
    except (etree.XMLSyntaxError, ValueError):
        return None
    trajectory, number_text = parsed.find("trajectory"), parsed.get("id", "")
    if trajectory is None or len(trajectory) != 2 or not _is_id(number_text):
        return None
    elements = list(trajectory[0].iter())
    leaves = [place for place, element in enumerate(elements) if not len(element)]
    if len(leaves) != len(literals) - 1 or not all(_is_number(elements[place].text) for place in leaves):
        return None  # one of the numbers comes after an element
    fields = _plain_fields(trajectory[0])
    if not _NEEDED.issubset(fields):
        return None
    texts = dict(zip(leaves, zip(*rows, strict=True), strict=True))
    states = _states_of({name: texts[place] for name, place in fields.items() if name != "position"})
    return None if states is None else (int(number_text), states, left)


def _is_number(text: str | None) -> bool:
    return text is not None and _TEXT_NUMBER.fullmatch(b">%b<" % text.encode()) is not None


def _is_id(text: str) -> bool:
    return text.isdecimal() and len(text) <= _LONGEST_ID


def _plain_states(trajectory: "etree._Element") -> PlainStates | None:
    count, shape = len(trajectory), [element.tag for element in trajectory[0].iter()]
    fields = _plain_fields(trajectory[0])
    if not _NEEDED.issubset(fields):
        return None
    if [element.tag for element in trajectory.iter()] != [trajectory.tag, *shape * count]:
        return None
    texts = [element.text or "" for element in trajectory.iter()]
    return _states_of({name: texts[1 + place :: len(shape)] for name, place in fields.items() if name != "position"})


def _states_of(texts: Mapping[str, Sequence[str] | Sequence[bytes]]) -> PlainStates | None:
    """Return the states for the given texts of their fields, one per state, or None if they are not plain."""
    try:
        steps = [int(text) for text in texts["time"]]
        numbers = {name: np.array([float(text) for text in texts[name]]) for name in sorted(texts) if name != "time"}
    except ValueError:
        return None
    positions = np.stack([numbers.pop(name) for name in _POINT], axis=1)
    if not np.isfinite([*numbers.values(), *positions.T]).all() or not _are_near_the_ends(positions):
        return None
    if not all(is_within(name, values) for name, values in numbers.items()) or not is_within("time", steps):
        return None
    return PlainStates(positions, numbers) if steps == list(range(steps[0], steps[0] + len(steps))) else None


def _plain_fields(state: "etree._Element") -> dict[str, int]:
    """Return the index of every field among a state's elements, in file order; coordinates are included.

    The result is empty if a field appears twice, or is neither a point nor an exact value.
    """
    places, place = dict[str, int](), 1
    for field in state:
        name, inner = str(field.tag), [element.tag for element in field.iter()][1:]
        if name in places or not name.isidentifier():
            return {}
        if name == "position" and inner == ["point", *_POINT]:
            places |= {name: place, "x": place + 2, "y": place + 3}
        elif name not in ("position", *_POINT) and inner == ["exact"]:
            places[name] = place + 1
        else:
            return {}
        place += 1 + len(inner)
    return places


def _are_near_the_ends(positions: Points) -> bool:
    """Return whether all positions are near the first and last ones, which stay in the document."""
    low, high = np.minimum(positions[0], positions[-1]), np.maximum(positions[0], positions[-1])
    near = (low - _FARTHEST_FROM_ENDS_M <= positions.min(axis=0)) & (
        positions.max(axis=0) <= high + _FARTHEST_FROM_ENDS_M
    )
    return bool(near.all()) and all(is_within("x", values) for values in positions.T)


def put_states(scenario: "Scenario", states: Mapping[int, PlainStates]) -> None:
    """Insert the removed states between the first and the last of every trajectory, as commonroad-io's objects.

    They have the class that commonroad-io chose for the last state, and the same values.
    """
    for obstacle in scenario.dynamic_obstacles:
        mine = states.get(int(obstacle.obstacle_id))
        if mine is not None and obstacle.prediction is not None:
            listed = obstacle.prediction.trajectory.state_list
            listed[1:1] = _between(listed[0], listed[-1], mine)


def _between(first: Any, last: Any, states: PlainStates) -> list[Any]:
    """Return the states between the first and the last state as objects of the last state's class."""
    from commonroad.common.reader.file_reader_xml import StateFactory

    names = [StateFactory._map_to_prop(name) for name in states.columns]
    steps = range(int(first.time_step) + 1, int(last.time_step))
    rows = np.column_stack([*states.columns.values()])[1:-1].tolist()
    kind = type(last)
    return [
        kind(time_step=step, position=position, **dict(zip(names, row, strict=True)))
        for step, position, row in zip(steps, states.positions[1:-1].copy(), rows, strict=True)
    ]
