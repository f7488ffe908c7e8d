"""Whether who enters later finds his place free once everybody's motion is known.

While edits are resolved, vehicles that they drive are known at their first step only.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ...schemas.errors import NotPossible
from ...schemas.modification import Edit
from ..commonroad import Track
from ..cosimulation import DrivePlan, Replay
from ..geometry import project
from ..scene import Scene
from ..vehicles import EGO_SIZE_M
from .changes import Changes, EditStep
from .placement import CLEARANCE_M, Place, free_places, gets_onto, occupant_at
from .simulation import (
    Body,
    Resimulated,
    bodies_after,
    body_of_touched,
    body_of_track,
    new_overlaps,
    overlap_steps,
    scene_after,
)
from .trajectory import moved_in_time

# ---------- entry_conflicts
# Added vehicles that collide as they enter although the request left their speed open.

SOON_S = 2.0
"""A collision so soon after the entry is one of place and speed; what comes later is one of driving."""
SLOWER_SHARES = (0.5, 0.0)


@dataclass(frozen=True)
class _Conflict:
    """An added vehicle, the edit that left its speed open, and whom it collides with as it enters."""

    edit: int
    plan: DrivePlan
    other: int

    @property
    def vehicle_id(self) -> int:
        """The id of the added vehicle."""
        return self.plan.start.obstacle_id


def slower_entries(
    edits: tuple[Edit, ...], scene: Scene, changes: Changes, result: Resimulated
) -> tuple[tuple[Edit, ...], tuple[str, ...]] | None:
    """The edits with half the speed, or none, where that keeps an added vehicle clear of whom it would run into.

    Returns:
        The edits, and a sentence on each vehicle that enters slower; None where nobody does.
    """
    slower, said = list(edits), []
    bodies = _bodies(scene, changes, result)
    for one in _conflicts(edits, scene, changes, result):
        usual_mps = float(one.plan.start.speeds_mps[0])
        clear = [share for share in SLOWER_SHARES if _is_clear(bodies[one.vehicle_id], bodies[one.other], share, scene)]
        if clear and usual_mps > 0.0 and slower[one.edit].speed is None:
            speed = f"{usual_mps * clear[0]:.1f}"
            slower[one.edit] = edits[one.edit].model_copy(update={"speed": f"{speed}m/s"})
            why = f"because it would collide with vehicle {one.other}"
            said.append(f"vehicle {one.vehicle_id} enters with {speed} instead of {usual_mps:.1f} m/s, {why}")
    return (tuple(slower), tuple(said)) if said else None


def check_entries(edits: tuple[Edit, ...], scene: Scene, changes: Changes, result: Resimulated) -> None:
    """Refuse that a vehicle enters where somebody runs over it at once who cannot brake enough, as on its own lane.

    Raises:
        NotPossible: naming who comes, and when the place can be entered.
    """
    for one in _conflicts(edits, scene, changes, result):
        coming = None if one.other in changes.driven else scene.tracks.get(one.other)
        if coming is None or not _is_hit(one.plan.start, coming, one.plan.from_step):
            continue
        speed_mps = float(coming.speeds_mps[coming.index_at(one.plan.from_step) or 0])
        raise NotPossible(
            f"the {one.plan.vehicle_class.name} that enters lanelet {one.plan.lanelets[0]} at "
            f"{one.plan.from_step * scene.step_s:.1f} s is hit by vehicle {one.other}, which comes there with "
            f"{speed_mps:.1f} m/s and cannot brake enough",
            valid=[*_next_time(scene, changes, one.plan), "a speed, and the collision is reported"],
            next_step="choose another place or time, or name a speed",
        )


def _conflicts(edits: tuple[Edit, ...], scene: Scene, changes: Changes, result: Resimulated) -> Iterator[_Conflict]:
    left_open = {
        key: index
        for index, added in enumerate(changes.added_by_edit)
        for key in added
        if edits[index].speed is None and key in changes.driven
    }
    for hit in result.overlaps:
        for key, other in ((hit.first, hit.second), (hit.second, hit.first)):
            if key in left_open and (hit.step - changes.driven[key].from_step) * scene.step_s <= SOON_S:
                yield _Conflict(left_open[key], changes.driven[key], other)


def _bodies(scene: Scene, changes: Changes, result: Resimulated) -> dict[int, Body]:
    regions = {region.obstacle_id: body_of_track(region.track) for region in scene.regions}
    recorded = {key: body_of_track(track) for key, track in (scene.tracks | scene.standing).items()}
    driven = {key: body_of_touched(track) for key, track in result.tracks.items()}
    return {key: body for key, body in (regions | recorded | driven).items() if key not in changes.removed}


def _is_clear(added: Body, other: Body, share: float, scene: Scene) -> bool:
    """Whether an added vehicle keeps clear of another one for a while if it is slower by a share on the same way."""
    count = min(len(added.positions), round(SOON_S / scene.step_s) + 1)
    steps = np.round(np.arange(count) * share).astype(int)
    slower = Body(added.key, added.first_step, added.positions[steps], added.headings_rad[steps], added.size_m)
    return next(overlap_steps(slower, other), None) is None


def _is_hit(start: Track, coming: Track, step: int) -> bool:
    """Whether a recorded vehicle gets onto or close to the place of an entry, however hard it brakes from a step on."""
    size = start.length_m + 2 * CLEARANCE_M, start.width_m + CLEARANCE_M
    return gets_onto(coming, step, start.positions[0], float(start.headings_rad[0]), size)


def _next_time(scene: Scene, changes: Changes, plan: DrivePlan) -> list[str]:
    """When nobody recorded is on the place or comes too fast for it any more, as ``time_s``; empty where never."""
    there = [track for key, track in scene.tracks.items() if key not in changes.removed]
    for step in range(plan.from_step + 1, scene.last_step):
        if not any(_is_hit(plan.start, track, step) for track in there):
            return [f"time_s={step * scene.step_s:g}"]
    return []


# ---------- shifted_entries
# Recordings moved in time that begin on top of somebody: refused, as such a place is for an added vehicle.

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


# ---------- departures
# Whether who enters later finds his place free once everybody's motion is known.
#
# While edits are resolved, vehicles that they drive are known at their first step only.

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
