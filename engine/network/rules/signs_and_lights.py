"""Rules on traffic signs, lights and stop lines: they must exist, belong to a lanelet, and be where they act."""

from collections.abc import Iterator

import numpy as np
from commonroad.scenario.traffic_light import TrafficLightState
from commonroad.scenario.traffic_sign import SupportedTrafficSignCountry

from ....schemas.text import cited, quoted
from ...commonroad import SPEED_LIMITS, LaneletElement, RoadDocument, is_known_number
from ...geometry import length_m, project
from .rule import Defect, rule


@rule("error", why="References to it are ambiguous; commonroad-io rejects the file or keeps one of the two.")
def repeated_id(document: RoadDocument) -> Iterator[Defect]:
    """Two elements of the file have the same id."""
    names: dict[int, list[str]] = {}
    for key, name in document.ids:
        names.setdefault(key, []).append(name)
    for key, holders in names.items():
        if len(holders) > 1:
            yield Defect(f"id {key} belongs to {len(holders)} elements: {', '.join(holders)}", (key,))


@rule("error", why="The reader fails or drops the rule that the sign expresses.")
def unknown_sign(document: RoadDocument) -> Iterator[Defect]:
    """A lanelet or stop line refers to a traffic sign that is not in the file."""
    known = {sign.sign_id for sign in document.signs}
    for lanelet in document.lanelets:
        for key in sorted({*lanelet.sign_ids, *lanelet.stop_line.sign_ids} - known):
            yield Defect(f"traffic sign {key} is not in the file", (lanelet.lanelet_id, key))


@rule("error", why="The reader fails, or treats the junction as one without lights.")
def unknown_light(document: RoadDocument) -> Iterator[Defect]:
    """A lanelet or stop line refers to a traffic light that is not in the file."""
    known = {light.light_id for light in document.lights}
    for lanelet in document.lanelets:
        for key in sorted({*lanelet.light_ids, *lanelet.stop_line.light_ids} - known):
            yield Defect(f"traffic light {key} is not in the file", (lanelet.lanelet_id, key))


@rule("error", why="The sign has no effect; commonroad-io does not read the file.")
def unused_sign(document: RoadDocument) -> Iterator[Defect]:
    """No lanelet refers to a traffic sign."""
    used = {key for lanelet in document.lanelets for key in lanelet.sign_ids}
    for sign in document.signs:
        if sign.sign_id not in used:
            yield Defect("no lanelet refers to this sign", (sign.sign_id,), sign.position)


@rule("warning", why="It is drawn, but no vehicle stops at it.")
def unused_light(document: RoadDocument) -> Iterator[Defect]:
    """No lanelet refers to a traffic light."""
    used = {key for lanelet in document.lanelets for key in lanelet.light_ids}
    for light in document.lights:
        if light.light_id not in used:
            yield Defect("no lanelet refers to this light", (light.light_id,), light.position)


@rule("error", why="The schema requires one, and without it the sign has no meaning.")
def sign_without_plate(document: RoadDocument) -> Iterator[Defect]:
    """A traffic sign has no sign element."""
    for sign in document.signs:
        if not sign.plates:
            yield Defect("has no sign element", (sign.sign_id,), sign.position)


@rule("warning", why="The reader treats it as an unknown sign: a limit or a right of way is lost.")
def unknown_sign_number(document: RoadDocument) -> Iterator[Defect]:
    """CommonRoad does not know the number of a sign for the country of the benchmark id."""
    countries = {country.value for country in SupportedTrafficSignCountry}
    country = document.country if document.country in countries else SupportedTrafficSignCountry.ZAMUNDA.value
    for sign in document.signs:
        for number, _ in sign.plates:
            if not is_known_number(number, country):
                yield Defect(f"{country} has no sign {cited(number)}", (sign.sign_id,), sign.position)


_FASTEST_LIMIT_MPS = 60.0
"""Chosen: 216 km/h, above all posted limits; limits in km/h are above it."""


@rule("warning", why="Limits are in m/s; a larger one is probably in km/h, and planners would aim at it.")
def implausible_speed_limit(document: RoadDocument) -> Iterator[Defect]:
    """A speed limit is not a number, not above 0, or above 60 m/s."""
    for sign in document.signs:
        for number, values in sign.plates:
            for text in values if number in SPEED_LIMITS else ():
                if not 0 < _speed(text) <= _FASTEST_LIMIT_MPS:
                    yield Defect(f"a limit of {cited(text)} m/s", (sign.sign_id,), sign.position)


def _speed(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")


@rule("warning", why="Its colour at any time is undefined.")
def light_without_cycle(document: RoadDocument) -> Iterator[Defect]:
    """An active traffic light has no cycle."""
    for light in document.lights:
        if light.active and not light.phases:
            yield Defect("is active but has no cycle", (light.light_id,), light.position)


@rule("error", why="The cycle is inconsistent: the sum of its durations is wrong.")
def phase_without_duration(document: RoadDocument) -> Iterator[Defect]:
    """A phase of a traffic light lasts 0 steps or fewer."""
    for light in document.lights:
        for steps, _ in light.phases:
            if steps <= 0:
                yield Defect(f"a phase lasts {steps} steps", (light.light_id,), light.position)


_COLOURS_SHOWN = 5


@rule("warning", why="Vehicles that obey it wait forever.")
def light_never_green(document: RoadDocument) -> Iterator[Defect]:
    """The cycle of an active traffic light shows neither green nor inactive."""
    for light in document.lights:
        colours = {colour for _, colour in light.phases}
        if light.active and colours and not colours & {"green", "inactive"}:
            yield Defect(
                f"shows only {', '.join(map(quoted, sorted(colours)[:_COLOURS_SHOWN]))}",
                (light.light_id,),
                light.position,
            )


@rule("error", why="The reader rejects the file.")
def unknown_colour(document: RoadDocument) -> Iterator[Defect]:
    """A phase of a traffic light shows a colour that CommonRoad does not know."""
    known = {state.value for state in TrafficLightState}
    for light in document.lights:
        for colour in sorted({colour for _, colour in light.phases} - known):
            yield Defect(f"shows {cited(colour)}", (light.light_id,), light.position)


_FARTHEST_SIGN_M = 50.0
"""Chosen: signs are at junctions, which are smaller."""


@rule("warning", why="Its position or the reference is wrong.")
def sign_far_away(document: RoadDocument) -> Iterator[Defect]:
    """A traffic sign (except a speed limit, which continues to apply) is more than 50 m from all its lanelets."""
    from shapely import Point

    holders_of: dict[int, list[LaneletElement]] = {}
    for lanelet in document.drawn:
        for key in dict.fromkeys(lanelet.sign_ids):
            holders_of.setdefault(key, []).append(lanelet)
    for sign in document.signs:
        if any(number in SPEED_LIMITS for number, _ in sign.plates):
            continue
        holders = holders_of.get(sign.sign_id, [])
        if sign.position is None or not holders or not np.isfinite(sign.position).all():
            continue
        distance = min(float(lanelet.polygon.distance(Point(*sign.position))) for lanelet in holders)
        if distance > _FARTHEST_SIGN_M:
            keys = tuple(lanelet.lanelet_id for lanelet in holders)
            yield Defect(f"is {distance:.0f} m from its lanelets", (sign.sign_id, *keys), sign.position)


_FARTHEST_STOP_LINE_M = 3.0
"""Chosen: a lane's width."""


@rule("warning", why="Vehicles would stop for a line that they do not cross.")
def stop_line_misplaced(document: RoadDocument) -> Iterator[Defect]:
    """Both ends of a stop line are more than 3 m outside the lanelet."""
    from shapely import LineString

    for lanelet in filter(_has_drawn_stop_line, document.drawn):
        line = lanelet.stop_line.points
        distance = float(lanelet.polygon.distance(LineString(line)))
        if distance > _FARTHEST_STOP_LINE_M:
            yield Defect(f"its stop line is {distance:.1f} m outside", (lanelet.lanelet_id,), line[0])


_SHORTEST_WITH_STOP_LINE_M = 10.0
"""Chosen: on a shorter lanelet, beginning and end are about the same place."""


@rule("warning", why="Vehicles would stop far before the line's junction, or after it.")
def stop_line_at_beginning(document: RoadDocument) -> Iterator[Defect]:
    """The middle of a stop line is closer to the beginning than to the end of a lanelet of at least 10 m."""
    for lanelet in filter(_has_drawn_stop_line, document.drawn):
        line, length = lanelet.stop_line.points, length_m(lanelet.center)
        station, _ = project(lanelet.center, line.mean(axis=0))
        if length >= _SHORTEST_WITH_STOP_LINE_M and station < length / 2:
            message = f"its stop line is {station:.1f} m after the beginning of {length:.1f} m"
            yield Defect(message, (lanelet.lanelet_id,), line[0])


def _has_drawn_stop_line(lanelet: LaneletElement) -> bool:
    return len(lanelet.stop_line.points) >= 2 and bool(np.isfinite(lanelet.stop_line.points).all())
