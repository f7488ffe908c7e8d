"""Added vehicles that collide as they enter although the request left their speed open."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from plannerforge.engine.edits.braking_reach import gets_onto
from plannerforge.engine.edits.cascade import Resimulated
from plannerforge.engine.edits.changes import Changes, DrivePlan
from plannerforge.engine.edits.collisions import Body, body_of_touched, body_of_track, overlap_steps
from plannerforge.engine.edits.occupancy import CLEARANCE_M
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.scenarios.tracks import Track
from plannerforge.schemas.errors import NotPossible
from plannerforge.schemas.modification import Edit

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
