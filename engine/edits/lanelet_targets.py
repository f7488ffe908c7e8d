"""Which lanelets the argument ``to`` means, and how they are reached."""

import itertools
from collections.abc import Iterable, Sequence

import numpy as np

from plannerforge.engine.edits.altered_scene import populated
from plannerforge.engine.edits.changes import Changes
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.edits.selection import nearest_ids, select
from plannerforge.schemas.errors import InvalidRequest, NotPossible, UnknownName, closest

NAME_ONE = "name one of these; describe_scenario with detail=lanelets lists all"


def target_lanelets(texts: Sequence[str], scene: Scene, changes: Changes) -> frozenset[int]:
    """Lanelets named by id, by SUMO edge (all its lanes) or as ``lanelet_of:SELECTOR``.

    Raises:
        InvalidRequest: none is named.
        UnknownName: a lanelet or edge that does not exist.
    """
    if not texts:
        raise InvalidRequest("no lanelet is named in 'to'", valid=[*scene.layout.lane_of][:12], next_step="name one")
    return frozenset(key for text in texts for key in _named(text.strip(), scene, changes))


def _named(text: str, scene: Scene, changes: Changes) -> tuple[int, ...]:
    if text.startswith("lanelet_of:"):
        meant = select([text.removeprefix("lanelet_of:")], scene, changes)
        return tuple(_lanelet_at_start(key, populated(scene, changes)) for key in meant)
    if text in scene.layout.edges:
        return scene.layout.edges[text]
    return (known_lanelet(text, scene),)


def known_lanelet(text: str, scene: Scene) -> int:
    """The drivable lanelet with this id, or under this lane of SUMO's (edge, underscore, index).

    Raises:
        UnknownName: no such lanelet or edge; the nearest ids are named.
    """
    lanes = scene.layout.table.lanes
    if text.isdigit() and int(text) in lanes:
        return int(text)
    if len(scene.layout.lanelets_of_lane.get(text, ())) == 1:
        return scene.layout.lanelets_of_lane[text][0]
    if text.isdigit():
        every = {lanelet.lanelet_id for lanelet in scene.network.lanelets}
        what = "is no lanelet that vehicles drive on" if int(text) in every else "is no lanelet of the scenario"
        raise UnknownName(f"{text} {what}", valid=nearest_ids(int(text), list(lanes)), next_step=NAME_ONE)
    known = [*map(str, lanes), *scene.layout.edges]
    raise UnknownName(f"'{text}' is no lanelet or edge", valid=closest(text, known), next_step=NAME_ONE)


def reach(scene: Scene, starts: Iterable[int], targets: Iterable[int], who: str) -> tuple[int, ...]:
    """Lanelets from a start to the nearest target, both included.

    Raises:
        NotPossible: no target can be reached; those that can are named, the nearest to a target first.
    """
    begin, wanted = tuple(starts), sorted(targets)
    route = scene.lanelet_graph.shortest_route(begin, wanted)
    if route is None:
        raise NotPossible(
            f"lanelet {' or '.join(map(str, wanted))} cannot be reached by {who}"
            f" from lanelet {', '.join(map(str, begin))}: no successors or lane changes lead there",
            valid=_by_distance_to(wanted, reachable_lanelets(scene, begin), scene),
            next_step="choose a lanelet that can be reached",
        )
    return route


def way_through(
    scene: Scene, start: int, via: Sequence[str], targets: frozenset[int], changes: Changes, who: str
) -> tuple[int, ...]:
    """Lanelets from a start to the nearest target, through the given lanelets or edges in their order.

    Raises:
        UnknownName: a lanelet or edge that does not exist.
        NotPossible: one of the legs cannot be driven.
    """
    way: tuple[int, ...] = (start,)
    for wanted in (*(target_lanelets([text], scene, changes) for text in via), targets):
        way += drive_to(scene, way[-1], wanted, who, is_there=way == (start,))[1:]
    return way


def drive_to(scene: Scene, start: int, targets: frozenset[int], who: str, *, is_there: bool = False) -> tuple[int, ...]:
    """Lanelets that a vehicle drives from its own to the nearest target, both included.

    ``is_there``: it is on the start already, so that it may steer over from there inside a junction.

    Raises:
        NotPossible: no target can be reached, or only by a change of lanes inside a junction.
    """
    route = scene.driven_graph.shortest_route([start], sorted(targets))
    if route is None and is_there:
        route = scene.graph_from_inside(start).shortest_route([start], sorted(targets))
    if route is not None:
        return route
    way = reach(scene, [start], targets, who)
    changes = [pair for pair in itertools.pairwise(way) if pair[1] in scene.lanelet_graph.neighbours[pair[0]]]
    wrong, right = next(pair for pair in changes if not set(pair) <= set(scene.layout.lane_of))
    raise NotPossible(
        f"{who} would have to change from lanelet {wrong} to {right} inside a junction, where SUMO's vehicles keep "
        "their lanes",
        valid=nearest_driven(scene, start, sorted(targets)),
        next_step="choose a target before or behind the junction",
    )


def nearest_driven(scene: Scene, start: int, targets: Sequence[int]) -> list[int]:
    """Lanelets that SUMO's vehicles reach from one without changing lanes inside a junction, nearest to a target first.

    As the crow flies.
    """
    return _by_distance_to(targets, sorted(scene.driven_graph.reachable([start])), scene)


def reachable_lanelets(scene: Scene, starts: Sequence[int]) -> list[int]:
    """Lanelets outside junctions that can be reached, the fewest lanelets away first, without the starts."""
    order: list[int] = list(starts)
    for key in order:
        onward = {*scene.lanelet_graph.successors.get(key, ()), *scene.lanelet_graph.neighbours.get(key, ())}
        order += sorted(after for after in onward if after not in order)
    return [key for key in order if key not in starts and key in scene.layout.lane_of]


def _by_distance_to(targets: Sequence[int], lanelets: Sequence[int], scene: Scene) -> list[int]:
    """Lanelets by how near their centre line comes to that of any target, as the crow flies."""
    lanes = scene.layout.table.lanes
    wanted = np.vstack([lanes[key].center for key in targets])

    def distance_m(key: int) -> float:
        return float(np.linalg.norm(lanes[key].center[:, None] - wanted[None], axis=2).min())

    return sorted(lanelets, key=lambda key: (round(distance_m(key), 3), key))


def _lanelet_at_start(vehicle_id: int, scene: Scene) -> int:
    match = scene.matches.get(vehicle_id)
    if match is None:
        raise NotPossible(
            f"vehicle {vehicle_id} is on no lanelet",
            valid=[f"lanelet_of:{key}" for key in nearest_ids(vehicle_id, list(scene.matches))],
            next_step="name another vehicle, or a lanelet by its id",
        )
    track = scene.tracks.get(vehicle_id)
    index = track.index_at(scene.ego.step) if track and scene.ego else None
    return match.at(index or 0)
