"""Whether who enters later finds his place free once everybody's motion is known.

While edits are resolved, vehicles that they drive are known at their first step only.
"""

from collections.abc import Mapping
from dataclasses import replace

from plannerforge.engine.edits.cascade import Resimulated, scene_after
from plannerforge.engine.edits.changes import Changes
from plannerforge.engine.edits.occupancy import free_places, occupant_at
from plannerforge.engine.edits.placing import Place
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.geometry.polyline import project
from plannerforge.engine.scenarios.tracks import Track
from plannerforge.schemas.errors import NotPossible

UNCHANGED = Changes(next_id=0, driven={})


def check_departures(scene: Scene, changes: Changes, result: Resimulated) -> None:
    """Refuse that somebody enters after the first step where a vehicle that the edits drive is by then.

    Raises:
        NotPossible: a place is taken; the nearest free ones are named, and when it is free.
    """
    departures = _departures(changes)
    later = {key: start for key, start in departures.items() if start.first_step > 0}
    after = scene_after(scene, changes, result) if later else scene
    for key, start in later.items():
        not_yet = {one for one, other in departures.items() if other.first_step >= start.first_step}
        by_then = replace(after, tracks={one: track for one, track in after.tracks.items() if one not in not_yet})
        who = _occupant(by_then, start, start.first_step)
        if who:
            place, when_s = _place(scene, changes, start), start.first_step * scene.step_s
            where = "the place" if place is None else f"lanelet {place.lanelet_id} at {place.station_m:.1f} m"
            raise NotPossible(
                f"{where} is taken by {who} at {when_s:.1f} s, as the edits have it drive, so that {start.kind} {key} "
                "cannot enter then",
                valid=[*_free_places(by_then, place, start), *_next_free_time(by_then, start)],
                next_step="choose a free place or another departure",
            )


def entering_onto(ego: Track, scene: Scene, changes: Changes) -> tuple[int, ...]:
    """Who enters later just where an ego that drives like an ordinary driver is then, by ascending id."""
    alone = replace(scene, tracks={ego.obstacle_id: ego}, standing={}, regions=(), ego=None)
    later = {key: start for key, start in _departures(changes).items() if start.first_step > ego.first_step}
    return tuple(key for key, start in later.items() if _occupant(alone, start, start.first_step))


def _departures(changes: Changes) -> Mapping[int, Track]:
    """Where and when everybody enters whom edits put in, by ascending id."""
    driven = {key: plan.start for key, plan in changes.driven.items() if plan.cause == "added"}
    walking = {key: replay.track for key, replay in changes.replays.items() if replay.recording is None}
    return dict(sorted((driven | walking).items()))


def _occupant(scene: Scene, start: Track, step: int) -> str:
    size, heading_rad = (start.length_m, start.width_m), float(start.headings_rad[0])
    return occupant_at(scene, UNCHANGED, start.positions[0], heading_rad, size, step)


def _next_free_time(scene: Scene, start: Track) -> list[str]:
    """When the place is free again, as ``time_s``; empty where it is not before the scenario ends."""
    steps = range(start.first_step + 1, scene.last_step)
    free = next((step for step in steps if not _occupant(scene, start, step)), None)
    return [] if free is None else [f"time_s={free * scene.step_s:g}"]


def _place(scene: Scene, changes: Changes, start: Track) -> Place | None:
    """Where on its way a vehicle enters; None for who walks."""
    plan = changes.driven.get(start.obstacle_id)
    if plan is None:
        return None
    lane = scene.layout.table.lanes[plan.lanelets[0]]
    return Place(plan.lanelets[0], project(lane.center, start.positions[0])[0])


def _free_places(scene: Scene, place: Place | None, start: Track) -> list[str]:
    size = start.length_m, start.width_m
    return [] if place is None else free_places(scene, UNCHANGED, place, size, start.first_step)
