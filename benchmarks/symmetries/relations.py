"""Relations: equivalent forms of a CommonRoad file that must not change the knowledge about it.

A relation changes the XML tree and returns the ``Frame`` that translates answers about the changed file back. It uses
lxml alone and nothing of the product, so that a defect there cannot hide itself. Coordinates in m, angles in rad, both
formats (2018b and 2020a).
"""

import copy
import math
import random
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path
from typing import Final, cast

import numpy as np
from lxml import etree
from numpy.typing import NDArray

Element = etree._Element
Array = NDArray[np.float64]

MOVED_M = 1000.0
LATER_STEPS = 17
ROUNDED_DIGITS = 6
MOST_CUTS = 3
"""Number of lanelet rows that one case cuts (chosen)."""


@dataclass(frozen=True)
class Frame:
    """The translation of a changed file: each method translates something in it back to the original.

    A point was first mirrored (y to −y), then turned, then moved. ``ids``: old id by new one, if it changed; ``cut``:
    lanelets that are now two, ``added``: the number of additional ones. ``steps``: the delay of everything.
    """

    moved_m: tuple[float, float] = (0.0, 0.0)
    turned_rad: float = 0.0
    mirrored: bool = False
    ids: Mapping[int, int] = field(default_factory=dict)
    steps: int = 0
    cut: frozenset[int] = frozenset()
    added: int = 0

    def points(self, points: Array) -> Array:
        """Return points (n, 2) in m of the original."""
        cos, sin = math.cos(self.turned_rad), math.sin(self.turned_rad)
        away = np.asarray(points, dtype=float) - np.array(self.moved_m)
        back: Array = away @ np.array([[cos, -sin], [sin, cos]])
        return back * np.array([1.0, -1.0]) if self.mirrored else back

    def directions(self, headings_rad: Array) -> Array:
        """Return unit vectors (n, 2) of headings in the original, which do not depend on full turns."""
        back = np.asarray(headings_rad, dtype=float) - self.turned_rad
        return np.stack([np.cos(back), np.sin(back) * (-1.0 if self.mirrored else 1.0)], axis=-1)

    def element(self, new_id: int) -> int:
        """Return an element's id in the original."""
        return self.ids.get(new_id, new_id)

    def way(self, lanelets: Iterable[int]) -> tuple[int, ...]:
        """Return lanelets in driving order; two parts of one are one."""
        there: list[int] = []
        for key in map(self.element, lanelets):
            if key not in self.cut or not there or there[-1] != key:
                there.append(key)
        return tuple(there)

    def sided(self, words: str) -> str:
        """Swap left and right in a text if the file is mirrored."""
        if not self.mirrored:
            return words
        return words.replace("left", "\0").replace("right", "left").replace("\0", "right")

    def _there(self, x: float, y: float) -> tuple[float, float]:
        if self.mirrored:
            y = -y
        if self.turned_rad:
            cos, sin = math.cos(self.turned_rad), math.sin(self.turned_rad)
            x, y = cos * x - sin * y, sin * x + cos * y
        return x + self.moved_m[0], y + self.moved_m[1]

    def _heading_there(self, heading_rad: float) -> float:
        return (-heading_rad if self.mirrored else heading_rad) + self.turned_rad


class DoesNotApply(Exception):
    """The relation has nothing to change in this file."""


Change = Callable[[Element, random.Random], Frame]


@dataclass(frozen=True)
class Relation:
    """A change with its law. ``within``: how far figures may be off, in m, m/s or rad; 0 demands the same bits."""

    name: str
    within: float
    change: Change

    def applied(self, root: Element, seed: str) -> tuple[Element, Frame]:
        """Return a changed copy of the tree below ``<commonRoad>``; the same for the same seed.

        Raises:
            DoesNotApply: it changes nothing.
        """
        changed = copy.deepcopy(root)
        for comment in list(changed.iter(etree.Comment)):
            parent = comment.getparent()
            if parent is not None:
                parent.remove(comment)
        return changed, self.change(changed, random.Random(seed))  # noqa: S311 - nothing secret


def read_root(path: Path) -> Element:
    """Return the root element of a file without white space between elements."""
    return etree.parse(path, etree.XMLParser(resolve_entities=False, no_network=True, remove_blank_text=True)).getroot()


def write_root(root: Element, path: Path) -> None:
    """Write a tree as a file in UTF-8."""
    etree.ElementTree(root).write(path, xml_declaration=True, encoding="UTF-8", pretty_print=True)


def _number(element: Element) -> float:
    return float(element.text or "nan")


def _set(element: Element, value: float) -> None:
    """Write a number so that reading it gives the same bits, without an exponent, which the schema does not know."""
    element.text = format(Decimal(repr(float(value))), "f")


# Moved, turned, mirrored


def _moved(root: Element, draw: random.Random) -> Frame:
    """Move the whole file by a kilometre, in any direction."""
    direction = draw.uniform(-math.pi, math.pi)
    frame = Frame(moved_m=(MOVED_M * math.cos(direction), MOVED_M * math.sin(direction)))
    _transform(root, frame)
    return frame


def _turned(root: Element, draw: random.Random) -> Frame:
    """Turn the whole file by any angle about the origin of its coordinates."""
    frame = Frame(turned_rad=draw.uniform(-math.pi, math.pi))
    _transform(root, frame)
    return frame


def _mirrored(root: Element, _draw: random.Random) -> Frame:
    """Mirror the file, so that right-hand traffic becomes left-hand traffic."""
    frame = Frame(mirrored=True)
    _transform(root, frame)
    for lanelet in root.iterfind("lanelet"):
        _swap(lanelet, "leftBound", "rightBound")
        _swap(lanelet, "adjacentLeft", "adjacentRight")
        line = lanelet.findall("stopLine/point")
        if len(line) == 2:
            line[0].addprevious(line[1])
    for incoming in root.iterfind("intersection/incoming"):
        _swap(incoming, "successorsRight", "successorsLeft")
        incoming[:] = sorted(incoming, key=lambda child: _IN_AN_ARM.index(str(child.tag)))
    for intersection in root.iterfind("intersection"):
        _swap_left_of(intersection)
    for direction in root.iterfind("trafficLight/direction"):
        direction.text = _OTHER_DIRECTION.get(direction.text or "", direction.text)
    for state in (*root.iter("initialSignalState"), *root.iter("signalState")):
        _swap(state, "indicatorLeft", "indicatorRight")
    return frame


_IN_AN_ARM: Final = ("incomingLanelet", "successorsRight", "successorsStraight", "successorsLeft", "isLeftOf")
"""The schema's order."""
_OTHER_DIRECTION: Final = {
    "right": "left",
    "left": "right",
    "leftStraight": "straightRight",
    "straightRight": "leftStraight",
}
_ROLLING: Final = ("rollAngle", "rollRate", "deltaYFront", "deltaYRear", "velocityYFront", "velocityYRear")
_TURNING: Final = ("yawRate", "slipAngle", "steeringAngle", "steeringAngleSpeed", "curvature", "curvatureChange")
_SIGNED: Final = (*_TURNING, *_ROLLING, "velocityY", "accelerationY")
"""Quantities of a state that change their sign in a mirror."""


def _transform(root: Element, frame: Frame) -> None:
    for element in root.iter("point", "center"):
        _transform_point(element, frame, local=_is_local(element))
    for element in root.iter("orientation"):
        _transform_heading(element, frame, local=_is_local(element))
    if frame.mirrored:
        for element in root.iter(*_SIGNED):
            for value in element:
                _set(value, -_number(value))
            _sort_interval(element)
        for polygon in root.iter("polygon"):
            polygon[:] = list(polygon)[::-1]


def _is_local(element: Element) -> bool:
    """Return True if it describes the body of an obstacle, in coordinates of that body."""
    return any(
        above.tag == "shape" and getattr(above.getparent(), "tag", "").lower().endswith("obstacle")
        for above in element.iterancestors("shape")
    )


def _transform_point(point: Element, frame: Frame, *, local: bool) -> None:
    x, y = point.find("x"), point.find("y")
    if x is None or y is None:
        return
    if local:
        new = (_number(x), -_number(y)) if frame.mirrored else (_number(x), _number(y))
    else:
        new = frame._there(_number(x), _number(y))
    _set(x, new[0])
    _set(y, new[1])


def _transform_heading(element: Element, frame: Frame, *, local: bool) -> None:
    if local:
        if frame.mirrored:
            _set(element, -_number(element))
        return
    if not len(element):
        _set(element, _within_turn(frame._heading_there(_number(element))))
        return
    for value in element:
        new = frame._heading_there(_number(value))
        _set(value, _within_turn(new) if value.tag == "exact" and frame.turned_rad else new)
    _sort_interval(element)
    ends = [element.find("intervalStart"), element.find("intervalEnd")]
    low, high = (math.nan if end is None else _number(end) for end in ends)
    whole = -2 * math.pi if high > 2 * math.pi else 2 * math.pi if low < -2 * math.pi else 0.0
    if whole:
        for end in ends:
            if end is not None:
                _set(end, _number(end) + whole)


def _sort_interval(element: Element) -> None:
    start, end = element.find("intervalStart"), element.find("intervalEnd")
    if start is not None and end is not None and _number(start) > _number(end):
        start.text, end.text = end.text, start.text


def _within_turn(angle_rad: float) -> float:
    return math.remainder(angle_rad, 2 * math.pi) if abs(angle_rad) > math.pi else angle_rad


def _swap(parent: Element, one: str, other: str) -> None:
    """Swap the names of two kinds of children; those of the first kind still come before the others."""
    first, second = parent.findall(one), parent.findall(other)
    for child in first:
        child.tag = other
    for child in second:
        child.tag = one
    if first and second:
        for child in second:
            first[0].addprevious(child)


def _swap_left_of(intersection: Element) -> None:
    """Swap the left neighbours of arms; references to missing arms stay."""
    incomings = {incoming.get("id"): incoming for incoming in intersection.iterfind("incoming")}
    pairs = []
    for key, incoming in incomings.items():
        for left_of in incoming.findall("isLeftOf"):
            if left_of.get("ref") in incomings:
                pairs.append((left_of.get("ref"), key))
                incoming.remove(left_of)
    for key, ref in pairs:
        holder = incomings.get(key)
        if holder is not None and holder.find("isLeftOf") is None:
            etree.SubElement(holder, "isLeftOf", ref=str(ref))


def _whole_turns(root: Element, draw: random.Random) -> Frame:
    """Add or subtract a full turn in headings of obstacles."""
    states = [
        heading
        for tag in _OBSTACLES
        for heading in root.iterfind(f"{tag}//orientation/exact")
        if not _is_local(heading)
    ]
    if not states:
        raise DoesNotApply
    for heading in states:
        value = _number(heading)
        if abs(value) <= math.pi:
            _set(heading, value - 2 * math.pi if value > 0 else value + 2 * math.pi if draw.random() < 0.5 else value)
    return Frame()


_OBSTACLES: Final = ("obstacle", "staticObstacle", "dynamicObstacle", "phantomObstacle", "environmentObstacle")


# Ids and order


def _ids(root: Element) -> list[int]:
    return sorted({int(text) for text in cast("list[str]", root.xpath("//@id"))})


def _next_id(root: Element) -> int:
    return max(_ids(root), default=0) + 1


def _renumber(root: Element, new: Mapping[int, int]) -> Frame:
    for element in root.iter():
        for name in ("id", "ref"):
            text = element.get(name)
            if text is not None:
                element.set(name, str(new.get(int(text), int(text))))
    return Frame(ids={there: old for old, there in new.items()})


def _renumbered(root: Element, draw: random.Random) -> Frame:
    """Renumber in the same order, including all references."""
    start, factor = draw.randrange(1, 5000), draw.randrange(2, 9)
    return _renumber(root, {old: start + factor * rank for rank, old in enumerate(_ids(root))})


def _shuffled_ids(root: Element, draw: random.Random) -> Frame:
    """Shuffle the numbers of the file, except those of planning problems, because the lowest is the first."""
    problems = {int(problem.get("id", "0")) for problem in root.iterfind("planningProblem")}
    old = [key for key in _ids(root) if key not in problems]
    return _renumber(root, dict(zip(old, draw.sample(old, len(old)), strict=True)))


_ALIKE_REFERENCES: Final = (
    ("lanelet", ("predecessor", "successor", "trafficSignRef", "trafficLightRef")),
    ("intersection", ("incoming",)),
    ("intersection/incoming", ("incomingLanelet", "successorsRight", "successorsStraight", "successorsLeft")),
)


def _reordered(root: Element, draw: random.Random) -> Frame:
    """Reorder the elements of one kind, and the references of one kind."""
    kinds = dict.fromkeys(child.tag for child in root)
    kinds.pop("location", None)
    for kind in kinds:
        _shuffle(root, str(kind), draw)
    for parents, tags in _ALIKE_REFERENCES:
        for parent in root.iterfind(parents):
            for tag in tags:
                _shuffle(parent, tag, draw)
    return Frame()


def _shuffle(parent: Element, tag: str, draw: random.Random) -> None:
    children = parent.findall(tag)
    if len(children) < 2:
        return
    places = [parent.index(child) for child in children]
    all_children = list(parent)
    for place, child in zip(places, draw.sample(children, len(children)), strict=True):
        all_children[place] = child
    parent[:] = all_children


# Time and digits


def _later(root: Element, _draw: random.Random) -> Frame:
    """Shift everything by some steps. Standing obstacles, which exist at any time, keep their step.

    CommonRoad's schema requires every first state at step 0; readers, and files with later entries, do not.
    """
    holders = [*root.iterfind("dynamicObstacle"), *root.iterfind("planningProblem"), *root.iterfind("phantomObstacle")]
    holders += [one for one in root.iterfind("obstacle") if one.findtext("role") != "static"]
    for holder in holders:
        for time in holder.iter("time"):
            for value in time:
                value.text = str(int(value.text or "0") + LATER_STEPS)
    for cycle in root.iterfind("trafficLight/cycle"):
        offset = cycle.find("timeOffset")
        if offset is None:
            offset = etree.SubElement(cycle, "timeOffset")
        offset.text = str(int(offset.text or "0") + LATER_STEPS)
    return Frame(steps=LATER_STEPS)


def _numbers(root: Element) -> list[Element]:
    tags = ("x", "y", "exact", "intervalStart", "intervalEnd", "length", "width", "radius", "orientation")
    return [one for one in root.iter(*tags) if "." in (one.text or "") and "e" not in (one.text or "").lower()]


def _digits(root: Element, draw: random.Random) -> Frame:
    """Append zeros to the numbers."""
    for number in _numbers(root):
        number.text = (number.text or "").strip() + "0" * draw.randrange(1, 5)
    return Frame()


def _rounded(root: Element, _draw: random.Random) -> Frame:
    """Round numbers to at most six decimals, as other writers do."""
    changed = False
    for number in _numbers(root):
        exact = Decimal((number.text or "").strip())
        short = round(exact, ROUNDED_DIGITS)
        if short != exact:
            number.text, changed = format(short, "f"), True
    if not changed:
        raise DoesNotApply
    return Frame()


# Lanelets cut in two

_LIMITS: Final = frozenset({"274", "274.1", "R2-1", "r301", "3.24", "R15", "C43", "B14", "Ρ-32", "B31"})
"""Signs that apply along the road; all others act at its end."""


def _split(root: Element, draw: random.Random) -> Frame:
    """Cut lanelets in two, with all their neighbours; what acts at the end of one stays at the end."""
    lanelets = {int(one.get("id", "0")): one for one in root.iterfind("lanelet")}
    begin, rows, seen = _next_id(root), list[dict[int, bool]](), set[int]()
    for key in draw.sample(sorted(lanelets), len(lanelets)):
        row = _row(lanelets, key)
        if row and not seen & row.keys() and _can_be_cut([lanelets[one] for one in row]):
            rows.append(row)
            seen |= row.keys()
        if len(rows) == MOST_CUTS:
            break
    if not rows:
        raise DoesNotApply
    keys = sorted(seen)
    second = dict(zip(keys, range(begin, begin + len(keys)), strict=True))
    limits = {
        sign.get("id")
        for sign in root.iterfind("trafficSign")
        if any((plate.text or "").strip() in _LIMITS for plate in sign.iterfind("trafficSignElement/trafficSignID"))
    }
    for row in rows:
        for key, forward in row.items():
            _cut(lanelets[key], second[key], limits, forward=forward)
    _lead_to_parts(root, second)
    return Frame(ids={new: old for old, new in second.items()}, cut=frozenset(keys), added=len(keys))


def _row(lanelets: Mapping[int, Element], key: int) -> dict[int, bool]:
    """Return a lanelet and all its neighbours, empty if one is missing or named in both directions."""
    row, waiting = {key: True}, [key]
    while waiting:
        one = waiting.pop()
        for beside in (*lanelets[one].iterfind("adjacentLeft"), *lanelets[one].iterfind("adjacentRight")):
            other, same = int(beside.get("ref", "0")), beside.get("drivingDir") == "same"
            if other not in lanelets or row.get(other, row[one] == same) != (row[one] == same):
                return {}
            if other not in row:
                row[other] = row[one] == same
                waiting.append(other)
    return row


def _can_be_cut(row: list[Element]) -> bool:
    """Return True if all bounds have the same number of points, at least three: points of one number are opposite."""
    counts = {len(one.findall(f"{side}/point")) for one in row for side in ("leftBound", "rightBound")}
    return len(counts) == 1 and counts.pop() >= 3


def _cut(lanelet: Element, second_id: int, limits: set[str | None], *, forward: bool) -> None:
    first_id = lanelet.get("id", "")
    second = copy.deepcopy(lanelet)
    second.set("id", str(second_id))
    for side in ("leftBound", "rightBound"):
        count = len(lanelet.findall(f"{side}/point"))
        middle = count // 2 if forward else count - 1 - count // 2
        _remove(lanelet.findall(f"{side}/point")[middle + 1 :])
        _remove(second.findall(f"{side}/point")[:middle])
    _remove([*lanelet.findall("successor"), *lanelet.findall("stopLine"), *lanelet.findall("trafficLightRef")])
    _remove([one for one in lanelet.findall("trafficSignRef") if one.get("ref") not in limits])
    _remove(second.findall("predecessor"))
    link = etree.Element("predecessor", ref=first_id)
    second.insert(2, link)
    before = lanelet.findall("predecessor")
    onward = etree.Element("successor", ref=str(second_id))
    lanelet.insert(lanelet.index(before[-1]) + 1 if before else 2, onward)
    lanelet.addnext(second)


def _remove(elements: Iterable[Element]) -> None:
    for element in elements:
        parent = element.getparent()
        if parent is not None:
            parent.remove(element)


def _lead_to_parts(root: Element, second: Mapping[int, int]) -> None:
    """Make references to a cut lanelet name the right part: its end for a predecessor, both for a goal."""
    parts = set(second.values())
    for lanelet in root.iterfind("lanelet"):
        own = int(lanelet.get("id", "0"))
        for before in lanelet.iterfind("predecessor"):
            ref = int(before.get("ref", "0"))
            if ref in second and own != second[ref]:
                before.set("ref", str(second[ref]))
        for beside in (*lanelet.iterfind("adjacentLeft"), *lanelet.iterfind("adjacentRight")):
            ref = int(beside.get("ref", "0"))
            if ref in second and (own in parts) == (beside.get("drivingDir") == "same"):
                beside.set("ref", str(second[ref]))
    for incoming in root.iterfind("intersection/incoming/incomingLanelet"):
        ref = int(incoming.get("ref", "0"))
        incoming.set("ref", str(second.get(ref, ref)))
    both = (
        *root.iterfind("planningProblem//position/lanelet"),
        *root.iterfind("intersection/crossing/crossingLanelet"),
    )
    for element in both:
        ref = int(element.get("ref", "0"))
        if ref in second:
            element.addnext(etree.Element(element.tag, ref=str(second[ref])))


# 2018b and 2020a


def _other_format(root: Element, _draw: random.Random) -> Frame:
    """Return the other version of CommonRoad's XML. 2018b has only speed limits, and no lights, stop lines,
    junctions.
    """
    if root.get("commonRoadVersion") == "2018b":
        _to_2020a(root)
    elif root.get("commonRoadVersion") == "2020a":
        _to_2018b(root)
    else:
        raise DoesNotApply
    return Frame()


def _to_2020a(root: Element) -> None:
    root.set("commonRoadVersion", "2020a")
    words = root.get("tags", "").split()
    root.attrib.pop("tags", "")
    location, tags = etree.Element("location"), etree.Element("scenarioTags")
    for name, value in (("geoNameId", "-999"), ("gpsLatitude", "999"), ("gpsLongitude", "999")):
        etree.SubElement(location, name).text = value
    for word in sorted(set(words)):
        etree.SubElement(tags, word)
    root.insert(0, location)
    root.insert(1, tags)
    next_id = _next_id(root)
    signs: dict[str, Element] = {}
    for lanelet in root.iterfind("lanelet"):
        limit = lanelet.find("speedLimit")
        etree.SubElement(lanelet, "laneletType").text = "unknown"
        if limit is None:
            continue
        lanelet.remove(limit)
        text = limit.text or ""
        if text not in signs:
            signs[text] = sign = etree.Element("trafficSign", id=str(next_id + len(signs)))
            plate = etree.SubElement(sign, "trafficSignElement")
            etree.SubElement(plate, "trafficSignID").text = "274"
            etree.SubElement(plate, "additionalValue").text = text
            position = etree.SubElement(sign, "position")
            position.append(copy.deepcopy(lanelet.findall("rightBound/point")[0]))
            etree.SubElement(sign, "virtual").text = "true"
        etree.SubElement(lanelet, "trafficSignRef", ref=str(signs[text].get("id")))
    last = root.findall("lanelet")[-1]
    for sign in reversed(signs.values()):
        last.addnext(sign)
    for obstacle in root.findall("obstacle"):
        role = obstacle.find("role")
        obstacle.tag = "staticObstacle" if role is not None and role.text == "static" else "dynamicObstacle"
        if role is not None:
            obstacle.remove(role)


def _to_2018b(root: Element) -> None:
    root.set("commonRoadVersion", "2018b")
    root.set("tags", " ".join(str(tag.tag) for tag in root.iterfind("scenarioTags/*")))
    limits = {
        sign.get("id"): plate.findtext("additionalValue", "")
        for sign in root.iterfind("trafficSign")
        for plate in sign.iterfind("trafficSignElement")
        if plate.findtext("trafficSignID", "").strip() in _LIMITS
    }
    for lanelet in root.iterfind("lanelet"):
        posted = [limits[ref.get("ref")] for ref in lanelet.findall("trafficSignRef") if ref.get("ref") in limits]
        _remove([*lanelet.findall("trafficSignRef"), *lanelet.findall("trafficLightRef"), *lanelet.findall("stopLine")])
        if len(set(posted)) > 1:
            raise DoesNotApply
        if posted:
            etree.SubElement(lanelet, "speedLimit").text = posted[0]
    for tag in ("location", "scenarioTags", "trafficSign", "trafficLight", "intersection"):
        _remove(root.findall(tag))
    _remove([*root.findall("phantomObstacle"), *root.findall("environmentObstacle")])
    for kind in ("static", "dynamic"):
        for obstacle in root.findall(f"{kind}Obstacle"):
            _remove([*obstacle.findall("initialSignalState"), *obstacle.findall("signalSeries")])
            obstacle.tag = "obstacle"
            role = etree.Element("role")
            role.text = kind
            obstacle.insert(0, role)


RELATIONS: Final = {
    relation.name: relation
    for relation in (
        Relation("moved", 1e-6, _moved),
        Relation("turned", 1e-6, _turned),
        Relation("mirrored", 1e-6, _mirrored),
        Relation("whole_turns", 1e-9, _whole_turns),
        Relation("renumbered", 0.0, _renumbered),
        Relation("shuffled_ids", 1e-9, _shuffled_ids),
        Relation("reordered", 1e-9, _reordered),
        Relation("later", 0.0, _later),
        Relation("digits", 0.0, _digits),
        Relation("rounded", 1e-5, _rounded),
        Relation("split", 1e-6, _split),
        Relation("other_format", 0.0, _other_format),
    )
}
"""All relations by name."""
