"""Recordings moved in time that are driven after all, because they would hit somebody, and the words for it."""

from plannerforge.engine.edits.cascade import Resimulated
from plannerforge.engine.edits.changes import Changes
from plannerforge.engine.edits.collisions import Body, body_of_track, new_overlaps
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.edits.shifted_entries import bodies_asked_for, shifted_body

MOST_NAMED = 3


def driven_shifts(changes: Changes, result: Resimulated) -> tuple[int, ...]:
    """The vehicles that edits only move in time and that are driven nevertheless, by ascending id."""
    shifted = [key for key, one in changes.replays.items() if one.recording is not None]
    return tuple(key for key in shifted if key in result.tracks and result.plans[key].cause == "handed_over")


def why_driven(vehicles: tuple[int, ...], scene: Scene, changes: Changes, result: Resimulated) -> list[str]:
    """For the first three of some vehicles that are moved in time: from when on they are driven and why."""
    found = [key for key in driven_shifts(changes, result) if key in vehicles]
    bodies = bodies_asked_for(scene, changes, result) if found else {}
    said = [_why(key, scene, changes, result, bodies) for key in found[:MOST_NAMED]]
    return said + ([f"{len(found) - MOST_NAMED} more are driven, too"] if len(found) > MOST_NAMED else [])


def _why(key: int, scene: Scene, changes: Changes, result: Resimulated, bodies: dict[int, Body]) -> str:
    driven = f"{key} is driven from {result.tracks[key].first_step * scene.step_s:.1f} s on"
    mine = shifted_body(changes.replays[key])
    after = {one: body_of_track(track.whole(result.plans[one].start)) for one, track in result.tracks.items()}
    for there in (bodies, after):
        hits = new_overlaps([mine], (body for other, body in there.items() if other != key), {key: mine})
        if hits:
            return f"{driven}: its recording would hit vehicle {hits[0].second} at {hits[0].step * scene.step_s:.1f} s"
    return f"{driven}, because others react"
