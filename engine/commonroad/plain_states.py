"""States of plain trajectories, read from the XML in one go instead of one after the other.

commonroad-io makes an object of every state and tries it on twelve classes: most of the time that a file costs. Nearly
all states are plain: a point, and exact values for everything else. ``take_plain_states`` reads those into arrays;
whatever is not plain stays in the document for commonroad-io, so that it alone decides what a state may be.
``put_states`` makes the objects of them that commonroad-io would have made, for libraries that want them.
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
"""Digits of 2⁵³ - 1, the largest id that is read; Python refuses to convert some thousands of them."""
_FARTHEST_FROM_ENDS_M = 10_000.0
"""Chosen: beyond the box around a trajectory's first and last position."""


@dataclass(frozen=True)
class PlainStates:
    """States after the initial one, one for each step.

    ``positions`` (n, 2) in m; ``columns``: by the name of the element in the file all other exact values (n,), headings
    in rad as ``orientation`` and speeds in m/s as ``velocity`` among them.
    """

    positions: Points
    columns: Mapping[str, Values]

    @property
    def headings_rad(self) -> Values:
        """Headings (n,)."""
        return self.columns["orientation"]

    @property
    def speeds_mps(self) -> Values:
        """Speeds (n,), NaN where none is given."""
        given = self.columns.get("velocity")
        return np.full(len(self.positions), np.nan) if given is None else given


def take_plain_states(document: "etree._Element") -> dict[int, PlainStates]:
    """Take the states of plain trajectories out of a CommonRoad document, by the id of their obstacle.

    The first and the last state of each stay, so that commonroad-io reads a trajectory of the same duration. A
    trajectory is left whole where one of its states differs from the others in its fields, gives an interval or a
    region, or holds a text that is no number, none that is finite or one beyond its limits, and where steps are missing
    between them: who checks the document finds it there.
    """
    taken = (take_states(obstacle) for obstacle in document.iterchildren(moving_obstacle(document)))
    return dict(states for states in taken if states is not None)


def take_states(obstacle: "etree._Element") -> tuple[int, PlainStates] | None:
    """Take the states of one obstacle, with its id; None where its trajectory is left whole."""
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
    """As ``take_states``, of an obstacle as bytes of UTF-8 without comments, and what is left of them.

    Only of one whose states are alike to the last character, but for numbers: programs write them so, and a pattern
    that is made of the first one finds all of them in half the time. None for any other: a parser has to look at it.
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
        return None  # one of the numbers stands behind an element
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
    """The states whose fields have such texts, a text for each state; None where they are not plain."""
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
    """Where in a state's elements, in the order of the file, the number of every field stands: those of the point too.

    Empty where a field is given twice, or as anything but a point or an exact value.
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
    """Whether the box around the first and the last position, which stay in the document, tells where all are."""
    low, high = np.minimum(positions[0], positions[-1]), np.maximum(positions[0], positions[-1])
    near = (low - _FARTHEST_FROM_ENDS_M <= positions.min(axis=0)) & (
        positions.max(axis=0) <= high + _FARTHEST_FROM_ENDS_M
    )
    return bool(near.all()) and all(is_within("x", values) for values in positions.T)


def put_states(scenario: "Scenario", states: Mapping[int, PlainStates]) -> None:
    """Put the states that were taken between the first and the last of every trajectory, as commonroad-io's objects.

    They are of the class that commonroad-io chose for the last one, and hold the same values.
    """
    for obstacle in scenario.dynamic_obstacles:
        mine = states.get(int(obstacle.obstacle_id))
        if mine is not None and obstacle.prediction is not None:
            listed = obstacle.prediction.trajectory.state_list
            listed[1:1] = _between(listed[0], listed[-1], mine)


def _between(first: Any, last: Any, states: PlainStates) -> list[Any]:
    """The states between the first and the last as objects of the class of the last."""
    from commonroad.common.reader.file_reader_xml import StateFactory

    names = [StateFactory._map_to_prop(name) for name in states.columns]
    steps = range(int(first.time_step) + 1, int(last.time_step))
    rows = np.column_stack([*states.columns.values()])[1:-1].tolist()
    kind = type(last)
    return [
        kind(time_step=step, position=position, **dict(zip(names, row, strict=True)))
        for step, position, row in zip(steps, states.positions[1:-1].copy(), rows, strict=True)
    ]
