"""Recordings moved in time that begin on top of somebody: refused, as such a place is for an added vehicle."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from plannerforge.engine.edits.cascade import Resimulated, bodies_after
from plannerforge.engine.edits.changes import Changes, EditStep, Replay
from plannerforge.engine.edits.collisions import Body, body_of_track, new_overlaps
from plannerforge.engine.edits.entry_conflicts import SOON_S
from plannerforge.engine.edits.occupancy import CLEARANCE_M
from plannerforge.engine.edits.scene import EGO_SIZE_M, Scene
from plannerforge.engine.edits.shift_time import moved_in_time
from plannerforge.schemas.errors import NotPossible
from plannerforge.schemas.modification import Edit

EGO = 0
"""Stands for the ego's id; obstacles have positive ones."""


@dataclass(frozen=True)
class _Shift:
    """The vehicles that an edit moves in time by so many steps, each as all edits leave it, by id."""

    steps: int
    replays: Mapping[int, Replay]


def check_shifted_entries(
    edits: tuple[Edit, ...], steps: tuple[EditStep, ...], scene: Scene, changes: Changes, result: Resimulated
) -> None:
    """Refuse that a recording moved in time begins on top of somebody whom it does not overlap as recorded.

    Raises:
        NotPossible: naming both, and by how much else the edit can move its vehicles.
    """
    shifts = [at for at, edit in enumerate(edits) if edit.op == "shift_time"]
    bodies = bodies_asked_for(scene, changes, result) if shifts else {}
    for key, other in _on_top(changes, result, bodies):
        at = max(at for at in shifts if {key, other} & set(steps[at].vehicles))
        when_s = changes.replays[key].track.first_step * scene.step_s
        raise NotPossible(
            f"at {when_s:.1f} s, where its recording moved in time begins, vehicle {key} would be on top of "
            f"{'the ego' if other == EGO else f'vehicle {other}'}",
            valid=_fitting_times(_shift(edits[at], steps[at], scene, changes), scene, bodies),
            next_step="choose another time_s, or leave the vehicle out",
        )


def bodies_asked_for(scene: Scene, changes: Changes, result: Resimulated) -> dict[int, Body]:
    """Everybody as the edits leave them but for who is handed over because of them, and the ego where it starts."""
    asked = {key: track for key, track in result.tracks.items() if result.plans[key].cause != "handed_over"}
    bodies = bodies_after(scene, changes, replace(result, tracks=asked))
    bodies |= {key: shifted_body(one) for key, one in changes.replays.items() if key not in asked}
    return bodies | {body.key: body for body in _ego(scene)}


def shifted_body(replay: Replay) -> Body:
    """A recording as it is moved in time."""
    return replace(body_of_track(replay.track), shifted_steps=replay.shifted_steps)


def _on_top(changes: Changes, result: Resimulated, bodies: Mapping[int, Body]) -> Iterator[tuple[int, int]]:
    """Who of those that are moved in time begins on top of whom, as everybody drives or would drive but for them."""
    shifted = {key: one for key, one in changes.replays.items() if one.recording is not None}
    for hit in result.overlaps:
        for key, other in ((hit.first, hit.second), (hit.second, hit.first)):
            if key in shifted and shifted[key].track.first_step == hit.step:
                yield key, other
    moved = {key: shifted_body(one) for key, one in shifted.items()}
    for key, body in moved.items():
        yield from ((key, other) for other in _hit(_beginning(body, 1), bodies, moved))


def _hit(body: Body, bodies: Mapping[int, Body], moved: Mapping[int, Body]) -> tuple[int, ...]:
    """Whom the beginning of a recording moved in time overlaps, and did not as recorded."""
    hits = new_overlaps([body], (one for other, one in bodies.items() if other != body.key), moved)
    return tuple(hit.second for hit in hits)


def _beginning(body: Body, states: int) -> Body:
    return replace(body, positions=body.positions[:states], headings_rad=body.headings_rad[:states])


def _shift(edit: Edit, step: EditStep, scene: Scene, changes: Changes) -> _Shift:
    replays = {key: changes.replays[key] for key in step.vehicles if key in changes.replays}
    return _Shift(round((edit.time_s or 0.0) / scene.step_s), replays)


def _fitting_times(shift: _Shift, scene: Scene, bodies: Mapping[int, Body]) -> list[str]:
    """The nearest smaller and larger ``time_s`` at which nobody is met soon where the vehicles of an edit begin."""
    found = []
    for sign in (-1, 1):
        tried = (shift.steps + sign * more for more in range(1, 2 * scene.last_step))
        found += [next((steps for steps in tried if steps and _fits(shift, steps, scene, bodies)), None)]
    nearest = sorted((steps for steps in found if steps is not None), key=lambda steps: abs(steps - shift.steps))
    return [f"time_s={steps * scene.step_s:g}" for steps in nearest]


def _fits(shift: _Shift, steps: int, scene: Scene, bodies: Mapping[int, Body]) -> bool:
    moved = {}
    for key, one in shift.replays.items():
        total = one.shifted_steps + steps - shift.steps
        track = None if one.recording is None else moved_in_time(one.recording, total, scene)
        if track is None:
            return False
        size_m = track.length_m + 2 * CLEARANCE_M, track.width_m + CLEARANCE_M
        moved[key] = replace(body_of_track(track), size_m=size_m, shifted_steps=total)
    there = {**bodies, **moved}
    states = round(SOON_S / scene.step_s) + 1
    return not any(_hit(_beginning(body, states), there, moved) for body in moved.values())


def _ego(scene: Scene) -> tuple[Body, ...]:
    if scene.ego is None:
        return ()
    return (Body(EGO, scene.ego.step, scene.ego.position[None], np.array([scene.ego.heading_rad]), EGO_SIZE_M),)
