"""The paper's checks of an edited scenario, made on what was written and what SUMO held, never on the product's word.

Which vehicles were handed over besides is taken from the report, and said beside the figures.
"""

from pathlib import Path
from typing import Any

import numpy as np
import shapely
from lxml import etree

from plannerforge.engine.planners.time_to_collision import MovingRectangles, corners_of
from plannerforge.engine.scenarios.tracks import Track
from plannerforge.evals.modification_drivers import behaviour_checks
from plannerforge.evals.modification_goals import goal_checks
from plannerforge.evals.modification_population import addition_checks, removal_checks
from plannerforge.evals.modification_reroutes import reroute_checks
from plannerforge.evals.modification_tracks import handover_errors
from plannerforge.evals.modification_written import Written

DEEP_M, SAME_HIT_S = 0.05, 1.0
"""Two that overlap in the recording too, so soon before or after, are not a collision of the edit."""


def checks_of(written: Written, index: int) -> dict[str, bool]:
    """The paper's checks of one edit by name."""
    truth = written.truths[index]
    if truth["op"] == "reroute":
        return reroute_checks(written, index)
    if truth["op"] == "set_behaviour":
        return behaviour_checks(written, index)
    if truth["op"] == "set_goal":
        return goal_checks(written, truth)
    if truth["op"] == "remove_vehicle":
        return removal_checks(written, index)
    return addition_checks(written, index)


def is_untouched_identical(written: Written) -> bool:
    """Whether every element but those that the edits are about has the bytes of the source.

    Those are the named and added road users, those handed over, and the problem whose goal is edited.
    """
    old, new = _elements(written.base), _elements(written.xml)
    changed = {key for key in {*old, *new} if old.get(key) != new.get(key)}
    meant = {key for index in range(len(written.truths)) for key in _road_users(written, index)}
    allowed = {str(key) for key in (*meant, *written.added(), *written.outcome.handed_over)}
    if any(truth["op"] == "set_goal" for truth in written.truths):
        allowed.add(str(written.scene.loaded.problem().planning_problem_id))
    return changed <= allowed


def unreported_collisions(written: Written) -> int:
    """Pairs that overlap by more than 5 cm on either side, did not about then in the source, and are not reported."""
    base, new = {**written.scene.standing, **written.old}, {**written.scene.standing, **written.new}
    told = {frozenset(hit.vehicles) for hit in written.outcome.collisions}
    moved = sorted(key for key in written.new if _moves_anew(written, key))
    found = set()
    for key in moved:
        for other, track in new.items():
            pair = frozenset((key, other))
            if other == key or pair in told or pair in found:
                continue
            hits = _overlap_steps(new[key], track, DEEP_M)
            known = _overlap_steps(base[key], base[other], 0.0) if key in base and other in base else []
            window = SAME_HIT_S / written.scene.step_s
            if any(all(abs(step - one) > window for one in known) for step in hits):
                found.add(pair)
    return len(found)


def handovers_of(written: Written) -> tuple[tuple[float, float], ...]:
    """For every vehicle that SUMO took over from its recording what that adds in m and m/s, from both files."""
    new, old, step_s = written.new, written.old, written.scene.step_s
    given = [one for one in written.outcome.touched if one.cause in ("edited", "handed_over") and one.vehicle_id in old]
    found = [
        handover_errors(old[one.vehicle_id], new[one.vehicle_id], round(one.from_time_s / step_s), step_s)
        for one in given
        if one.vehicle_id in new
    ]
    return tuple(one for one in found if one is not None)


def _road_users(written: Written, index: int) -> frozenset[int]:
    return frozenset() if written.truths[index]["op"] in ("set_goal", "add_vehicle") else written.meant_by(index)


def _moves_anew(written: Written, key: int) -> bool:
    """Whether a road user was not there before, or moves in another way."""
    old, new = written.old.get(key), written.new[key]
    return old is None or old.positions.shape != new.positions.shape or not np.array_equal(old.positions, new.positions)


def _elements(path: Path) -> dict[str, bytes]:
    root = etree.parse(path).getroot()
    return {
        str(element.get("id") or element.tag): etree.tostring(element, with_tail=False)
        for element in root
        if isinstance(element.tag, str)
    }


def _overlap_steps(one: Track, other: Track, depth_m: float) -> list[int]:
    begin, end = max(one.first_step, other.first_step), min(one.last_step, other.last_step) + 1
    if begin >= end:
        return []
    first, second = (_polygons(track, begin, end, depth_m) for track in (one, other))
    return [begin + int(index) for index in np.flatnonzero(shapely.intersects(first, second))]


def _polygons(track: Track, begin: int, end: int, depth_m: float) -> Any:
    """The rectangles at the steps, smaller by a depth on every side."""
    part = slice(begin - track.first_step, end - track.first_step)
    size = np.maximum(np.array([track.length_m, track.width_m]) - 2 * depth_m, 0.01)
    count = end - begin
    bodies = MovingRectangles(
        track.positions[part], track.headings_rad[part], np.tile(size, (count, 1)), np.zeros(count)
    )
    return shapely.polygons(corners_of(bodies))
