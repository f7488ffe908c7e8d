"""Edit T: let recorded vehicles drive their recording earlier or later."""

from dataclasses import replace

from plannerforge.engine.edits.changes import Changes, EditStep, Replay
from plannerforge.engine.edits.manoeuvre_plans import named
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.edits.selection import nearest_ids, select
from plannerforge.engine.scenarios.tracks import Track
from plannerforge.schemas.errors import InvalidRequest, NotPossible
from plannerforge.schemas.modification import Edit

FEWEST_STATES = 3


def shift_time(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Move the recordings of the selected vehicles in time; what falls outside the scenario is cut off.

    The motion itself stays as recorded, unless the vehicle would hit somebody: then it is handed over like any other.

    Raises:
        InvalidRequest: no time, or one that leaves nothing of a recording.
        NotPossible: a vehicle that was added, is driven by an earlier edit, or has no trajectory.
    """
    steps = 0 if edit.time_s is None else round(edit.time_s / scene.step_s)
    if steps == 0:
        raise InvalidRequest(
            "shift_time needs a time_s of at least one time step",
            valid=["time_s=2 (later)", "time_s=-1.5 (earlier)"],
            next_step=f"name a time_s of {scene.step_s:g} or more, or of {-scene.step_s:g} or less",
        )
    vehicles = select(edit.vehicles, scene, changes)
    for vehicle_id in vehicles:
        _check(scene, changes, vehicle_id)
        before = changes.replays.get(vehicle_id)
        recording = before.recording if before and before.recording else scene.tracks[vehicle_id]
        total = steps + (before.shifted_steps if before else 0)
        track = moved_in_time(recording, total, scene)
        if track is None:
            raise _nothing_left(recording, total, scene)
        changes = changes.with_replay(Replay(track, scene.matcher.match(track), recording, total))
    how = f"{abs(steps) * scene.step_s:g} s {'later' if steps > 0 else 'earlier'}"
    return EditStep(changes, vehicles, f"{named(vehicles)} {how} than recorded")


def moved_in_time(track: Track, steps: int, scene: Scene) -> Track | None:
    """The track so many steps later, without what lies before step 0 or after the scenario's last step.

    None where hardly anything is left.
    """
    first = max(track.first_step + steps, 0)
    begin = first - steps - track.first_step
    end = min(len(track.positions), scene.last_step + 1 - steps - track.first_step)
    if end - begin < FEWEST_STATES:
        return None
    return replace(
        track,
        first_step=first,
        positions=track.positions[begin:end],
        headings_rad=track.headings_rad[begin:end],
        speeds_mps=track.speeds_mps[begin:end],
    )


def _check(scene: Scene, changes: Changes, vehicle_id: int) -> None:
    if changes.is_added(vehicle_id):
        raise NotPossible(f"vehicle {vehicle_id} is not recorded", next_step=f"leave it out with '!{vehicle_id}'")
    if vehicle_id in changes.driven:
        raise NotPossible(
            f"vehicle {vehicle_id} does not drive its recording any more",
            next_step="shift it before the edit that drives it, on the scenario without that edit",
        )
    if vehicle_id not in scene.tracks:
        raise NotPossible(
            f"obstacle {vehicle_id} has no trajectory that moves in time",
            valid=nearest_ids(vehicle_id, list(scene.tracks)),
            next_step="name one that drives",
        )


def _nothing_left(track: Track, steps: int, scene: Scene) -> InvalidRequest:
    low = (FEWEST_STATES - 1 - track.last_step) * scene.step_s
    high = (scene.last_step - FEWEST_STATES + 1 - track.first_step) * scene.step_s
    return InvalidRequest(
        f"{steps * scene.step_s:g} s leave nothing of vehicle {track.obstacle_id}'s recording",
        valid=[f"time_s in {low:g} … {high:g}"],
        next_step="shift it by less",
    )
