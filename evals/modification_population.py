"""Judges of the edit P, by the road users of both files."""

from dataclasses import dataclass

import numpy as np
import shapely

from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.geometry.polyline import Points, oriented_rectangle, point_at, project
from plannerforge.engine.scenarios.tracks import Track
from plannerforge.evals.modification_drivers import is_of_its_class
from plannerforge.evals.modification_reach import SHARES, nearest_m, places_along, places_on
from plannerforge.evals.modification_reroutes import ends_right, others_stay
from plannerforge.evals.modification_written import Truth, Written

PLACE_TOLERANCE_M, SPEED_TOLERANCE_MPS = 2.0, 0.01
EGO_LENGTH_M = 4.5
CLEARANCE_M = 1.0
"""A vehicle enters later than asked only where somebody is on its place or so near."""

REACTION_S, HARDEST_BRAKING_MPS2 = 0.5, 8.0
"""A driver brakes so late, and no harder."""

PASSING_M = 0.5
"""Whoever passes by nearer than that is said to hit."""


@dataclass(frozen=True)
class Kind:
    """A CommonRoad obstacle type, and between which lengths and widths in m vehicles of a class are."""

    commonroad_type: str
    lengths_m: tuple[float, float]
    widths_m: tuple[float, float]

    def fits(self, track: Track) -> bool:
        """Whether a road user is of this class."""
        sizes = ((track.length_m, self.lengths_m), (track.width_m, self.widths_m))
        return track.kind == self.commonroad_type and all(low <= size <= high for size, (low, high) in sizes)


KINDS = {
    "car": Kind("car", (3.5, 5.5), (1.5, 2.2)),
    "truck": Kind("truck", (6.0, 12.0), (2.2, 2.6)),
    "bus": Kind("bus", (9.0, 14.0), (2.3, 2.6)),
    "motorcycle": Kind("motorcycle", (1.8, 2.6), (0.6, 1.0)),
    "bicycle": Kind("bicycle", (1.4, 2.0), (0.4, 0.8)),
}


def removal_checks(written: Written, index: int) -> dict[str, bool]:
    """Those who are meant are gone, and nobody else."""
    meant = written.meant_by(index)
    gone = not meant & set(written.new)
    told = meant == set(written.outcome.edits[index].vehicles)
    return {"P_count": bool(meant) and gone and told, "P_target": gone, "P_others": others_stay(written)}


def addition_checks(written: Written, index: int) -> dict[str, bool]:
    """As many as asked, of the class, where, when, how fast and to where they were asked for; all others stay."""
    truth, told = written.truths[index], written.outcome.edits[index].vehicles
    added = [key for key in told if key in written.added()]
    left_out = [key for key in told if key in written.meant_to_go()]
    there = [written.new[key] for key in added]
    return {
        "P_count": len(added) + len(left_out) == truth["count"] and _adds_up(written),
        "P_class": all(KINDS[truth["class"]].fits(one) and is_of_its_class(written, one.obstacle_id) for one in there),
        "P_target": all(_is_placed(written, track, truth, place) for place, track in enumerate(there)),
        "P_speed": all(_has_speed(track, truth) for track in there),
        "P_departure": all(_departs(written, track, truth) for track in there),
        "P_destination": all(_gets_there(written, key, truth) for key in added),
        "P_others": others_stay(written),
    }


def is_taken(scene: Scene, truth: Truth) -> bool:
    """Whether anybody recorded is, when the first vehicle is to enter, on a place that is asked for, or close to it."""
    step, size = _entry_step(scene, truth), _largest_size(truth, CLEARANCE_M)
    places = _places(scene, truth, 0, sum(KINDS[truth["class"]].lengths_m) / 2)
    for place in places:
        room = shapely.Point(place).buffer(float(np.hypot(*size)) / 2)
        for other in (*scene.tracks.values(), *scene.standing.values()):
            index = other.index_at(step)
            if index is not None and room.intersects(_body(other, index, 0.0)):
                return True
    return scene.ego is not None and any(
        float(np.linalg.norm(place - scene.ego.position)) <= size[0] + EGO_LENGTH_M / 2 for place in places
    )


def is_run_over(scene: Scene, truth: Truth) -> bool:
    """Whether anybody recorded gets onto such a place on his way, or close to it, although he brakes as hard as he can.

    He does not know of the vehicle before it enters, and takes some time to brake.
    """
    places = _places(scene, truth, 0, sum(KINDS[truth["class"]].lengths_m) / 2)
    rooms = [room for place in places for room in _rooms(scene, place, _largest_size(truth, PASSING_M))]
    for other in scene.tracks.values():
        index = other.index_at(_entry_step(scene, truth))
        if index is None:
            continue
        speed_mps = max(float(other.speeds_mps[index]), 0.0)
        stops_after_m = speed_mps * REACTION_S + speed_mps**2 / (2 * HARDEST_BRAKING_MPS2)
        steps_m = np.linalg.norm(np.diff(other.positions[index:], axis=0), axis=1)
        last = index + int((np.cumsum(steps_m) <= stops_after_m).sum())
        if any(room.intersects(_body(other, at, 0.0)) for room in rooms for at in range(index, last + 1)):
            return True
    return False


def _entry_step(scene: Scene, truth: Truth) -> int:
    return round((truth.get("depart_s") or 0.0) / scene.step_s)


def _largest_size(truth: Truth, larger_m: float) -> tuple[float, float]:
    """Length and width in m of the largest vehicle of the class, with some room on all its sides."""
    kind = KINDS[truth["class"]]
    return kind.lengths_m[1] + 2 * larger_m, kind.widths_m[1] + 2 * larger_m


def _rooms(scene: Scene, place: Points, size: tuple[float, float]) -> list[shapely.Polygon]:
    """Rectangles around a place along all lanelets that it lies on."""
    found = []
    for key in scene.network.find_lanelet_by_position([place])[0]:
        line = scene.network.find_lanelet_by_id(key).center_vertices
        heading_rad = point_at(line, project(line, place)[0])[1]
        found.append(shapely.Polygon(oriented_rectangle(place, heading_rad, size)))
    return found


def _adds_up(written: Written) -> bool:
    """Whether the new file has exactly as many new road users as all edits together add."""
    asked = sum(truth["count"] for truth in written.truths if truth["op"] == "add_vehicle")
    gone = written.meant_to_go() - set(written.old)
    return len(written.added()) + len(gone) == int(asked)


def _is_placed(written: Written, track: Track, truth: Truth, index: int) -> bool:
    """Whether an added vehicle starts where it was asked for: where the corpus says, or by the rules of its words."""
    places = _places(written.scene, truth, index, track.length_m)
    return nearest_m(track.positions[0], places) <= PLACE_TOLERANCE_M


def _places(scene: Scene, truth: Truth, index: int, length_m: float) -> list[Points]:
    network, where = scene.network, truth["where"]
    if truth.get("resolved"):
        place = truth["resolved"][index]
        line = network.find_lanelet_by_id(place["lanelet"]).center_vertices
        return [point_at(line, place["s_m"])[0]]
    if "lanelet" in where:
        return places_on(network, where["lanelet"], SHARES[where["position"]], length_m)
    start = np.asarray(scene.loaded.problem().initial_state.position, dtype=float)
    return places_along(network, start, float(where["offset_m"]))


def _has_speed(track: Track, truth: Truth) -> bool:
    asked = truth.get("speed_mps")
    return asked is None or abs(float(track.speeds_mps[0]) - float(asked)) <= SPEED_TOLERANCE_MPS


def _departs(written: Written, track: Track, truth: Truth) -> bool:
    """At the asked step, or as soon after one that was named as nobody is on the place."""
    asked = round((truth.get("depart_s") or 0.0) / written.scene.step_s)
    if asked == 0:
        return track.first_step == 0
    return track.first_step >= asked and all(_is_taken(written, track, s) for s in range(asked, track.first_step))


def _is_taken(written: Written, track: Track, step: int) -> bool:
    place = _body(track, 0, CLEARANCE_M)
    others = (other for key, other in {**written.new, **written.scene.standing}.items() if key != track.obstacle_id)
    found = ((other, other.index_at(step)) for other in others)
    return any(index is not None and place.intersects(_body(other, index, 0.0)) for other, index in found)


def _body(track: Track, index: int, larger_m: float) -> shapely.Polygon:
    size = (track.length_m + 2 * larger_m, track.width_m + 2 * larger_m)
    return shapely.Polygon(oriented_rectangle(track.positions[index], float(track.headings_rad[index]), size))


def _gets_there(written: Written, key: int, truth: Truth) -> bool:
    destination = truth.get("destination_lanelet")
    return destination is None or ends_right(written, key, frozenset([int(destination)]))
