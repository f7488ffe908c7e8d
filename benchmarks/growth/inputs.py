"""Inputs of any size, as text: maps, lanelet networks and recordings.

A town is a row of crossings along which the vehicles drive one after the other:

    ── west ──► crossing ── east ──►  next crossing …     and from south to north across each

A stack is a set of lanelets on top of each other, each turned a little so that it crosses all others. A star is a
junction with many arms, with lanelets from each arm to the others.
"""

import math
from collections.abc import Sequence
from pathlib import Path

from plannerforge.engine.maps.drawn_library import Sketch

Point = tuple[float, float]
_WIDTH_M, _APART_M, _STEP_S, _SPEED_MPS = 3.5, 120.0, 0.1, 5.0
_LANELETS_OF_CROSSING = 6
_FROM_RING_M = 300.0


def town(path: Path, *, crossings: int, vehicles: int, steps: int) -> Path:
    """Write a CommonRoad file (2020a) of a row of crossings with vehicles and an ego.

    Args:
        path: the file; its folder name becomes the author, so that no two files are equal and caches do not help.
        crossings: their number, six lanelets each.
        vehicles: evenly spaced along the row, all with the ego's speed.
        steps: states of each vehicle.
    """
    lanelets = [text for number in range(crossings) for text in _crossing(number, crossings)]
    length_m = crossings * _APART_M - 100.0
    places_m = [50.0 + length_m * number / vehicles for number in range(vehicles)]
    first = 1 + _LANELETS_OF_CROSSING * crossings
    cars = [_car(first + number, x, steps) for number, x in enumerate(places_m)]
    return _write(path, [*lanelets, *cars, _problem(first + vehicles, steps)])


def stack(path: Path, count: int) -> Path:
    """Write a CommonRoad file of lanelets on top of each other, each turned a little against the previous one."""
    angles = (math.pi / 2 * number / count for number in range(count))
    ends = ((50.0 * math.cos(angle), 50.0 * math.sin(angle)) for angle in angles)
    return _write(path, [_lanelet(number, [(-x, -y), (x, y)]) for number, (x, y) in enumerate(ends, start=1)])


def star(path: Path, links: int) -> Path:
    """Write a CommonRoad file of one junction with the given number of lanelets between its arms."""
    arms = math.ceil(0.5 + math.sqrt(0.25 + links))
    near_m, half = 20.0 + arms, 0.5 / arms
    angles = [math.tau * arm / arms for arm in range(arms)]
    turns = [(a, b) for a in range(arms) for b in range(arms) if a != b][:links]
    inside = {turn: 2 * arms + 1 + number for number, turn in enumerate(turns)}
    texts = []
    for arm, angle in enumerate(angles):
        leaving, entering = ([key for turn, key in inside.items() if turn[side] == arm] for side in (0, 1))
        toward = [_polar(near_m + 60.0, angle - half), _polar(near_m, angle - half)]
        away = [_polar(near_m, angle + half), _polar(near_m + 60.0, angle + half)]
        texts += [_lanelet(2 * arm + 1, toward, [], leaving), _lanelet(2 * arm + 2, away, entering, [])]
    for (a, b), key in inside.items():
        line = [_polar(near_m, angles[a] - half), (0.3 * a, 0.3 * b), _polar(near_m, angles[b] + half)]
        texts.append(_lanelet(key, line, [2 * a + 1], [2 * b + 2]))
    return _write(path, texts)


def _polar(radius: float, angle: float) -> Point:
    return radius * math.cos(angle), radius * math.sin(angle)


def _crossing(number: int, crossings: int) -> list[str]:
    x, first = number * _APART_M, 1 + number * _LANELETS_OF_CROSSING
    west, middle, east, south, across, north = range(first, first + _LANELETS_OF_CROSSING)
    before = [east - _LANELETS_OF_CROSSING] if number else []
    after = [west + _LANELETS_OF_CROSSING] if number + 1 < crossings else []
    return [
        _lanelet(west, [(x, 0), (x + 50, 0)], before, [middle]),
        _lanelet(middle, [(x + 50, 0), (x + 70, 0)], [west], [east]),
        _lanelet(east, [(x + 70, 0), (x + _APART_M, 0)], [middle], after),
        _lanelet(south, [(x + 60, -60), (x + 60, -10)], [], [across]),
        _lanelet(across, [(x + 60, -10), (x + 60, 10)], [south], [north]),
        _lanelet(north, [(x + 60, 10), (x + 60, 60)], [across], []),
    ]


def _lanelet(key: int, line: Sequence[Point], predecessors: Sequence[int] = (), successors: Sequence[int] = ()) -> str:
    bounds = []
    for tag, side in (("leftBound", 1), ("rightBound", -1)):
        points = []
        for (x, y), (before, after) in zip(line, _around(line), strict=True):
            angle = math.atan2(after[1] - before[1], after[0] - before[0])
            aside = side * _WIDTH_M / 2
            points.append(_point(x - aside * math.sin(angle), y + aside * math.cos(angle)))
        bounds.append(f"<{tag}>{''.join(points)}</{tag}>")
    links = [f'<predecessor ref="{ref}"/>' for ref in predecessors] + [
        f'<successor ref="{ref}"/>' for ref in successors
    ]
    return f'<lanelet id="{key}">{"".join(bounds + links)}<laneletType>urban</laneletType></lanelet>'


def _around(line: Sequence[Point]) -> list[tuple[Point, Point]]:
    return list(zip([line[0], *line[:-1]], [*line[1:], line[-1]], strict=True))


def _point(x: float, y: float) -> str:
    return f"<point><x>{x:.4f}</x><y>{y:.4f}</y></point>"


def _car(key: int, x: float, steps: int) -> str:
    states = [_state(x + _SPEED_MPS * _STEP_S * step, step) for step in range(steps)]
    return (
        f'<dynamicObstacle id="{key}"><type>car</type><shape><rectangle><length>4.5</length><width>1.8</width>'
        f"</rectangle></shape><initialState>{states[0]}</initialState><trajectory>"
        f"{''.join(f'<state>{state}</state>' for state in states[1:])}</trajectory></dynamicObstacle>"
    )


def _state(x: float, step: int) -> str:
    return (
        f"<position>{_point(x, 0.0)}</position><orientation><exact>0.0</exact></orientation><time><exact>{step}</exact>"
        f"</time><velocity><exact>{_SPEED_MPS}</exact></velocity><acceleration><exact>0.0</exact></acceleration>"
    )


def _problem(key: int, steps: int) -> str:
    return (
        f'<planningProblem id="{key}"><initialState><position>{_point(10.0, 0.0)}</position>'
        f"<orientation><exact>0.0</exact></orientation><time><exact>0</exact></time>"
        f"<velocity><exact>{_SPEED_MPS}</exact></velocity><yawRate><exact>0.0</exact></yawRate>"
        f"<slipAngle><exact>0.0</exact></slipAngle></initialState><goalState><position><rectangle><length>10</length>"
        f"<width>3</width><orientation>0.0</orientation><center><x>80</x><y>0</y></center></rectangle></position>"
        f"<time><intervalStart>{min(10, steps)}</intervalStart><intervalEnd>{max(150, steps)}</intervalEnd></time>"
        "</goalState></planningProblem>"
    )


def _write(path: Path, elements: Sequence[str]) -> Path:
    head = (
        f'<commonRoad timeStepSize="{_STEP_S}" commonRoadVersion="2020a" author="{" ".join(path.parts[-3:])}" '
        'affiliation="" source="" benchmarkID="ZAM_Growth-1_1_T-1" date="2025-01-01"><location>'
        "<geoNameId>-999</geoNameId><gpsLatitude>999</gpsLatitude><gpsLongitude>999</gpsLongitude></location>"
        "<scenarioTags><urban/></scenarioTags>"
    )
    path.write_text("\n".join([head, *elements, "</commonRoad>"]), encoding="utf-8")
    return path


def rings(path: Path, count: int) -> Path:
    """Write an OpenStreetMap extract of roundabouts with four arms and lights, in rows and columns."""
    sketch = Sketch("Rings", 50.0, 8.0)
    side = math.ceil(math.sqrt(count))
    for number in range(count):
        x, y = _FROM_RING_M * (number % side), _FROM_RING_M * (number // side)
        corners = [(x + dx, y + dy) for dx, dy in ((20, 0), (0, 20), (-20, 0), (0, -20), (20, 0))]
        sketch.road(corners, "tertiary", junction="roundabout", oneway="yes")
        for dx, dy in ((1, 0), (0, 1), (-1, 0), (0, -1)):
            sketch.road([(x + 20 * dx, y + 20 * dy), (x + 140 * dx, y + 140 * dy)], "tertiary", f"Road {number}")
        sketch.mark((x + 20, y), highway="traffic_signals")
    sketch.write(path)
    return path


def streets(path: Path, count: int, nodes: int = 3) -> Path:
    """Write an OpenStreetMap extract of parallel streets, each with a side street; ``nodes`` of each street."""
    sketch = Sketch("Streets", 50.0, 8.0)
    for number in range(count):
        x, y = 800.0 * (number % 20), 60.0 * (number // 20)
        line = [(x + 700.0 * index / (nodes - 1), y + 3.0 * math.sin(index)) for index in range(nodes)]
        sketch.road(line, "residential", f"{_word(number)} Street", maxspeed=30)
        sketch.road([line[1], (line[1][0], y + 30.0)], "residential", f"{_word(number)} Lane")
    sketch.write(path)
    return path


def _word(number: int) -> str:
    return "".join(chr(ord("A") + int(digit)) for digit in str(number))
