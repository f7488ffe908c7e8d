"""Derives the cause of a failed run from its stored record and steps and from the motion of the other party."""

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from plannerforge.engine.analysis import driven_tracks
from plannerforge.engine.commonroad import Track, read_scenario
from plannerforge.engine.geometry import wrap_angle
from plannerforge.engine.planners.traffic.recorded import RecordedTraffic
from plannerforge.schemas.runs import RunRecord, RunSteps

from ..tracks import ahead_and_left_m

_STANDING_MPS = 0.5
"""Below it a vehicle counts as standing (chosen)."""
_SAME_WAY_RAD = math.pi / 4
"""Largest angle between headings of the same direction; around a quarter turn they cross, beyond it they oppose."""
_LISTED_CONSTRAINTS = 2


def cause(run: RunRecord, steps: RunSteps, scenario: Path) -> str:
    """Return one line on what ended the run, and on a collision with an obstacle how the two met."""
    if run.collision is not None and run.collision.obstacle_id is not None:
        other = _track(run.collision.obstacle_id, steps, scenario)
        return f"{meeting(run, steps, other)} at {run.collision.time_s:.1f} s"
    stood_s = run.step_s * int((np.array(steps.speed_mps[1:]) < _STANDING_MPS).sum())
    return run.reason + (f"; the ego stood for {stood_s:.1f} s" if stood_s else "")


def rejections(run: RunRecord) -> str:
    """Return the constraints that rejected most candidates over the whole run."""
    most = sorted(run.rejected_candidates.items(), key=lambda item: (-item[1], item[0]))
    return ", ".join(f"{name} {count}" for name, count in most[:_LISTED_CONSTRAINTS]) or "none"


def is_wrap(rejected: Mapping[str, int]) -> bool:
    """Return True if candidates were rejected as after a heading wrap: by the yaw rate more than by all else.

    At a wrap the heading jumps by 2π, and only the check of the yaw rate sees that as such. If a curve is too tight,
    the curvature rate or the acceleration rejects more.

    Args:
        rejected: number of candidates of one planning step by constraint.
    """
    others = (count for name, count in rejected.items() if name != "yaw_rate")
    return rejected.get("yaw_rate", 0) > max(others, default=0)


def meeting(run: RunRecord, steps: RunSteps, other: Track) -> str:
    """Return how the ego and another road user met at the end of a run, by the position of each in the other's
    frame.
    """
    step = steps.first_step + len(steps.x_m) - 1
    index = other.index_at(step) or 0
    theirs = (*other.positions[index].tolist(), float(other.headings_rad[index]))
    ours = (steps.x_m[-1], steps.y_m[-1], steps.heading_rad[-1])
    speed, their_speed = steps.speed_mps[-1], float(other.speeds_mps[index])
    who = f"{other.kind} {other.obstacle_id}"
    ego = "the standing ego" if speed < _STANDING_MPS else f"the ego ({speed:.1f} m/s)"
    them = f"the standing {who}" if their_speed < _STANDING_MPS else f"{who} ({their_speed:.1f} m/s)"
    turned = abs(wrap_angle(theirs[2] - ours[2]))
    if speed >= _STANDING_MPS and their_speed >= _STANDING_MPS and turned > _SAME_WAY_RAD:
        way = "came towards" if turned > math.pi - _SAME_WAY_RAD else "crossed the way of"
        return f"{them} {way} {ego}"
    if _is_in_front(theirs, ours, run.ego_width_m):
        return f"{ego} ran into {them}"
    if _is_in_front(ours, theirs, other.width_m):
        return f"{them} ran into {ego}" + (" from behind" if turned < _SAME_WAY_RAD else "")
    return f"{ego} and {them} touched side by side"


def _is_in_front(place: tuple[float, float, float], of: tuple[float, float, float], width_m: float) -> bool:
    """Return True if a place is more ahead of a rectangle than to its side."""
    ahead_m, left_m = ahead_and_left_m(np.array(place[:2]), np.array(of[:2]), of[2])
    return ahead_m > 0 and abs(left_m) < max(width_m, ahead_m)


def _track(obstacle_id: int, steps: RunSteps, scenario: Path) -> Track:
    """Return the actual motion of an obstacle in the run."""
    traffic = RecordedTraffic(read_scenario(scenario).scenario)
    recorded = {track.obstacle_id: track for track in (*traffic.standing, *traffic.moving)}
    return (recorded | driven_tracks(steps))[obstacle_id]
