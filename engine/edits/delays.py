"""What kept a driven vehicle from getting on: red lights, standing, and lanelets that are driven slowly."""

from plannerforge.engine.edits.handover import TouchedTrack
from plannerforge.engine.edits.scene import Scene

STANDING_MPS = 0.1
LEAST_STANDING_S = 1.0
SLOW_MPS = 8.0
"""A lanelet whose limit or bend allows less is a reason to be late."""

AT_THE_LIMIT, LEAST_SHARE = 0.9, 0.5
"""Who drives at so much of what its lanelets allow, for so much of its time, is held to it."""

RED = frozenset("ru")


def delay(scene: Scene, track: TouchedTrack) -> str:
    """Where a vehicle stood longest, or else which lanelet made it slow, as the end of a sentence; "" for neither."""
    stood_s, key, red_s = _longest_stand(scene, track)
    if stood_s >= LEAST_STANDING_S:
        where = "at a red light" if red_s > stood_s / 2 else "standing"
        return f", after {stood_s:.1f} s {where} on lanelet {key}"
    slow = _slow_lanelet(scene, track)
    return (
        ""
        if slow is None
        else f", on lanelets that allow no more than {scene.driven_speeds_mps[slow]:.1f} m/s ({slow})"
    )


def _longest_stand(scene: Scene, track: TouchedTrack) -> tuple[float, int, float]:
    """How long a vehicle stood in a lanelet in s, its id, and how long every light there was red meanwhile."""
    stands: dict[int, list[int]] = {}
    for index, (lane, speed) in enumerate(zip(track.lanes, track.motion.speeds_mps, strict=False)):
        if speed < STANDING_MPS:
            for key in scene.layout.lanelets_of_lane.get(lane, ())[-1:]:
                stands.setdefault(key, []).append(track.first_step + index)
    if not stands:
        return 0.0, 0, 0.0
    key, steps = max(stands.items(), key=lambda stand: (len(stand[1]), -stand[0]))
    red = sum(is_red(scene, key, step) for step in steps)
    return len(steps) * scene.step_s, key, red * scene.step_s


def is_red(scene: Scene, lanelet_id: int, step: int) -> bool:
    """Whether a lanelet has lights and all of them are red, or red and yellow, at a time step."""
    letters = [one.letter_at(step * scene.step_s) for one in scene.signals if lanelet_id in one.lanelets]
    return bool(letters) and RED.issuperset(letters)


def _slow_lanelet(scene: Scene, track: TouchedTrack) -> int | None:
    """The lanelet that held a vehicle to its own low speed for longest; None where it drove slower or freely."""
    held: dict[int, int] = {}
    for lane, speed in zip(track.lanes, track.motion.speeds_mps, strict=False):
        for key in scene.layout.lanelets_of_lane.get(lane, ())[-1:]:
            allowed = scene.driven_speeds_mps[key]
            if allowed < SLOW_MPS and speed >= AT_THE_LIMIT * allowed:
                held[key] = held.get(key, 0) + 1
    if sum(held.values()) < LEAST_SHARE * len(track.motion.speeds_mps):
        return None
    return max(held, key=lambda key: (held[key], -key))
