"""Rules on intersections: their incoming lanelets and where those lead."""

from collections.abc import Iterator

from ...commonroad import RoadDocument
from .rule import Defect, rule


@rule("error", why="Right of way and turning directions there are undefined; the reader may fail.")
def unknown_lanelet_at_intersection(document: RoadDocument) -> Iterator[Defect]:
    """An intersection refers to a lanelet or an arm that is not in the file."""
    for intersection in document.intersections:
        arms = {incoming.incoming_id for incoming in intersection.incomings}
        for incoming in intersection.incomings:
            named = {*incoming.lanelet_ids, *incoming.exit_ids}
            for key in sorted(key for key in named if key not in document.by_id):
                message = f"lanelet {key} of arm {incoming.incoming_id} is not in the file"
                yield Defect(message, (intersection.intersection_id, key))
            if incoming.left_of is not None and incoming.left_of not in arms:
                message = f"arm {incoming.left_of}, which arm {incoming.incoming_id} is left of, is not in the file"
                yield Defect(message, (intersection.intersection_id, incoming.left_of))


@rule("error", why="The schema requires one; without it, the intersection is meaningless.")
def intersection_without_incoming(document: RoadDocument) -> Iterator[Defect]:
    """An intersection has no incoming arm."""
    for intersection in document.intersections:
        if not intersection.incomings:
            yield Defect("has no incoming arm", (intersection.intersection_id,))


@rule("error", why="No vehicle can come from there, so the arm is meaningless.")
def incoming_without_lanelet(document: RoadDocument) -> Iterator[Defect]:
    """An arm of an intersection lists no lanelet that leads in."""
    for intersection in document.intersections:
        for incoming in intersection.incomings:
            if not incoming.lanelet_ids:
                message = f"arm {incoming.incoming_id} lists no lanelet that leads in"
                yield Defect(message, (intersection.intersection_id, incoming.incoming_id))


@rule("warning", why="Turning directions are unknown: vehicles from there seem to have no exit.")
def incoming_without_exit(document: RoadDocument) -> Iterator[Defect]:
    """An arm of an intersection lists no lanelet to the right, straight on or to the left."""
    for intersection in document.intersections:
        for incoming in intersection.incomings:
            if incoming.lanelet_ids and not incoming.exit_ids:
                message = f"arm {incoming.incoming_id} lists no exit"
                yield Defect(message, (intersection.intersection_id, incoming.incoming_id))


@rule("error", why="The turning direction that the intersection states cannot be driven.")
def exit_not_behind_incoming(document: RoadDocument) -> Iterator[Defect]:
    """A lanelet to the right, straight on or to the left does not follow any lanelet of its arm."""
    known = document.by_id
    for intersection in document.intersections:
        for incoming in intersection.incomings:
            behind = {key for own in incoming.lanelet_ids if own in known for key in known[own].successors}
            for key in sorted(key for key in set(incoming.exit_ids) - behind if key in known):
                message = f"lanelet {key} follows no lanelet of arm {incoming.incoming_id}"
                yield Defect(message, (intersection.intersection_id, incoming.incoming_id, key))


@rule("warning", why="The arm that a vehicle comes from is ambiguous, and so is the right of way.")
def lanelet_in_two_incomings(document: RoadDocument) -> Iterator[Defect]:
    """A lanelet belongs to two arms of one intersection."""
    for intersection in document.intersections:
        arms: dict[int, list[int]] = {}
        for incoming in intersection.incomings:
            for key in incoming.lanelet_ids:
                arms.setdefault(key, []).append(incoming.incoming_id)
        for key, named in arms.items():
            if len(named) > 1:
                message = f"lanelet {key} belongs to arms {', '.join(map(str, named))}"
                yield Defect(message, (intersection.intersection_id, key))
