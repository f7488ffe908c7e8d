"""What kept a driven vehicle from getting on: red lights, standing, slow lanelets, and who drove ahead."""

from collections.abc import Mapping, Sequence

import numpy as np

from plannerforge.engine.edits.handover import TouchedTrack
from plannerforge.engine.edits.leaders import in_words, leader
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.geometry.polyline import project
from plannerforge.engine.scenarios.tracks import Track

STANDING_MPS = 0.1
LEAST_STANDING_S = 1.0
SLOW_MPS = 8.0
"""A lanelet whose limit or bend allows less is a reason to be late."""

AT_THE_LIMIT, LEAST_SHARE = 0.9, 0.5
"""Who drives at so much of what its lanelets allow, for so much of its time, is held to it."""

AT_LINE_M = 3.0
"""Who stands no farther than this before the end of a lanelet is the first at its line."""

RED = frozenset("ru")


def delay(scene: Scene, track: TouchedTrack, others: Mapping[int, Track], driven: tuple[int, ...] = ()) -> str:
    """What held a vehicle up, as the end of a sentence: where it stood longest, slow lanelets, somebody ahead, or "".

    ``others``: everybody as the edits leave them. ``driven``: the lanelets that it gets onto; with its bumper over the
    line of the next one it stands on the last.
    """
    steps, key = _longest_stand(scene, track, driven)
    stood_s = len(steps) * scene.step_s
    if stood_s >= LEAST_STANDING_S:
        where = f"{_standing(scene, track, steps, key)} lanelet {key}"
        return f", after {stood_s:.1f} s {where}{_behind(scene, track, others, steps)}"
    slow = _slow_lanelet(scene, track)
    if slow is None:
        behind = _behind(scene, track, others, range(track.first_step, track.last_step + 1))
        return f",{behind}" if behind else ""
    return f", on lanelets that allow no more than {scene.driven_speeds_mps[slow]:.1f} m/s ({slow})"


def _behind(scene: Scene, track: TouchedTrack, others: Mapping[int, Track], steps: Sequence[int]) -> str:
    """Behind whom a vehicle was for most of some steps, in words; "" for nobody."""
    ahead = leader(track, others, np.array(steps) - track.first_step)
    return "" if ahead is None else f" behind {in_words(scene, ahead)}"


def _standing(scene: Scene, track: TouchedTrack, steps: list[int], key: int) -> str:
    """How a vehicle stands on a lanelet at some steps, in words that end before the lanelet's name."""
    if sum(is_red(scene, key, step) for step in steps) > len(steps) / 2:
        return "at a red light on"
    return "waiting at the junction after" if _is_at_junction(scene, track, steps[-1], key) else "standing on"


def _is_at_junction(scene: Scene, track: TouchedTrack, step: int, key: int) -> bool:
    """Whether a vehicle is the first at the end of a lanelet that leads into a junction."""
    lane = scene.layout.table.lanes[key]
    if key not in scene.layout.lane_of or scene.layout.lane_of.keys() >= set(scene.layout.table.successors[key]):
        return False
    front = track.fronts[step - track.first_step]
    return project(lane.center, front)[0] >= lane.length_m - AT_LINE_M


def _longest_stand(scene: Scene, track: TouchedTrack, driven: tuple[int, ...]) -> tuple[list[int], int]:
    """The steps at which a vehicle stood in the lanelet in which it stood longest, and its id; no steps if in none."""
    stands: dict[int, list[int]] = {}
    for index, (lane, speed) in enumerate(zip(track.lanes, track.motion.speeds_mps, strict=False)):
        if speed < STANDING_MPS:
            under = scene.layout.lanelets_of_lane.get(lane, ())
            for key in [key for key in under if key in driven or not driven][-1:] or driven[-1:]:
                stands.setdefault(key, []).append(track.first_step + index)
    if not stands:
        return [], 0
    key, steps = max(stands.items(), key=lambda stand: (len(stand[1]), -stand[0]))
    return steps, key


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
