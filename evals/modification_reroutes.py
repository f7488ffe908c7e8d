"""Judges of the edit T, by the route that SUMO drove and the motion that was written."""

from plannerforge.evals.modification_arrivals import Journey
from plannerforge.evals.modification_drivers import is_of_its_class
from plannerforge.evals.modification_tracks import ON_ROUTE_SHARE, arrives_on
from plannerforge.evals.modification_written import Written


def reroute_checks(written: Written, index: int) -> dict[str, bool]:
    """The vehicle is there, its route ends on the target and it drives along it; body and all others are kept."""
    truth, meant = written.truths[index], written.meant_by(index)
    targets = frozenset(int(key) for key in truth["target_lanelets"])
    through = frozenset(int(key) for key in truth.get("via", ()))
    told = meant == set(written.outcome.edits[index].vehicles)
    ends = all(ends_right(written, key, targets) and _tells_so(written, index, key, targets) for key in meant)
    return {
        "tgt": meant <= set(written.new),
        "T_ends": bool(meant) and ends and all(_routed_over(written, key, {one}) for key in meant for one in through),
        "T_preserve": told and others_stay(written) and all(is_of_its_class(written, key) for key in meant),
    }


def ends_right(written: Written, key: int, targets: frozenset[int]) -> bool:
    """Whether a vehicle is routed over a target, drives along that route, and arrives or is late with reason."""
    if key not in written.new or not _routed_over(written, key, targets):
        return False
    track = written.new[key]
    if written.sumo.share_on_route(key, track.positions) < ON_ROUTE_SHARE:
        return False
    return arrives(written, key, targets) or journey(written, key, targets).is_late_with_reason()


def arrives(written: Written, key: int, targets: frozenset[int]) -> bool:
    """Whether the written motion of a vehicle gets onto a target and stays there or drives on from it."""
    return key in written.new and arrives_on(written.scene.network, written.new[key], 0, set(targets))


def journey(written: Written, key: int, targets: frozenset[int]) -> Journey:
    """The way of a vehicle of the new file, among all others there."""
    everybody = {**written.scene.standing, **written.new}
    return Journey(written.scene.network, written.new[key], targets, everybody, written.scene.step_s)


def others_stay(written: Written) -> bool:
    """Whether nobody is gone but those who are meant to go."""
    return set(written.old) - set(written.new) == written.meant_to_go() & set(written.old)


def _routed_over(written: Written, key: int, lanelets: "frozenset[int] | set[int]") -> bool:
    network = written.scene.network
    return any(written.sumo.leads_over(key, network.find_lanelet_by_id(one).center_vertices) for one in lanelets)


def _tells_so(written: Written, index: int, key: int, targets: frozenset[int]) -> bool:
    """Whether the report says of a vehicle what its motion shows, with a reason where it does not arrive."""
    told = [route for route in written.outcome.edits[index].routes if route.vehicle_id == key]
    if len(told) != 1 or told[0].arrives is None:
        return False
    return told[0].arrives == arrives(written, key, targets) and (told[0].arrives or bool(told[0].reason))
