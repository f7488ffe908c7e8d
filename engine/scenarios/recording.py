"""What the recorded traffic does: how dense it is, and when it meets an ego that does not react."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from plannerforge.engine.geometry.polyline import Points, arc_length, headings, project, project_all
from plannerforge.engine.network.lanelet_graph import LaneletGraph
from plannerforge.engine.scenarios.tracks import Track, size_of
from plannerforge.schemas.scenarios import EgoFacts

if TYPE_CHECKING:
    from commonroad.scenario.scenario import Scenario

EGO_SIZE_M = (4.5, 1.8)
LONGEST_LOOK_M = 1000.0


def density_per_km(graph: LaneletGraph, tracks: Iterable[Track], last_step: int) -> float:
    """Recorded vehicles per kilometre of lanelets: the mean over the recording, rounded to 0.1."""
    length_km = sum(graph.length_m.values()) / 1000.0
    steps = sum(len(track.positions) for track in tracks)
    return round(steps / (last_step + 1) / length_km, 1) if length_km > 0 else 0.0


def standing_tracks(scenario: "Scenario", last_step: int) -> dict[int, Track]:
    """Static obstacles as tracks that do not move."""
    found = {}
    for obstacle in scenario.static_obstacles:
        state: Any = obstacle.initial_state
        position = np.asarray(getattr(state.position, "center", state.position), dtype=float)
        length, width = size_of(obstacle.obstacle_shape)
        heading = getattr(state, "orientation", 0.0)
        found[int(obstacle.obstacle_id)] = Track(
            obstacle_id=int(obstacle.obstacle_id),
            kind=str(obstacle.obstacle_type.value),
            length_m=length,
            width_m=width,
            first_step=0,
            positions=np.repeat(position[None, :], last_step + 1, axis=0),
            headings_rad=np.full(last_step + 1, float(getattr(heading, "start", heading))),
            speeds_mps=np.zeros(last_step + 1),
        )
    return found


def look_ahead_m(ego: EgoFacts, duration_s: float) -> float:
    """How much of the ego's path the recording can matter for."""
    return min(ego.speed_mps * duration_s + 50.0, LONGEST_LOOK_M)


def time_to_collision_s(
    line: Points, ego: EgoFacts, tracks: Iterable[Track], step_s: float, start_step: int
) -> float | None:
    """Seconds until an ego that keeps its path and initial speed meets the recording; None where it never does.

    Both are rectangles along the path's coordinates, the ego a car of 4.5 m by 1.8 m. Whoever overlaps the ego at its
    start is left out, and so is who runs into it from behind.

    Args:
        line: centre line of the ego's path, shape (n, 2).
    """
    here = project(line, np.array([ego.x_m, ego.y_m]))[0]
    ends, turned = arc_length(line), headings(line)
    first: float | None = None
    for track in tracks:
        if track.last_step < start_step:
            continue
        skipped = max(start_step - track.first_step, 0)
        steps = np.arange(track.first_step + skipped, track.last_step + 1) - start_step
        stations, beside = project_all(line, track.positions[skipped:])
        segments = np.clip(np.searchsorted(ends, stations, side="right") - 1, 0, len(turned) - 1)
        turn = track.headings_rad[skipped:] - turned[segments]
        along, across = np.abs(np.cos(turn)), np.abs(np.sin(turn))
        reach = (along * track.length_m + across * track.width_m + EGO_SIZE_M[0]) / 2
        room = (across * track.length_m + along * track.width_m + EGO_SIZE_M[1]) / 2
        ahead = stations - here - ego.speed_mps * step_s * steps
        on_path = (np.abs(beside) < room) & (stations > 0.0) & (stations < ends[-1] - 0.1)
        meets = np.flatnonzero(on_path & (np.abs(ahead) < reach))
        if len(meets) and steps[meets[0]] > 0 and ahead[meets[0]] > 0:
            time_s = float(steps[meets[0]]) * step_s
            first = time_s if first is None else min(first, time_s)
    return None if first is None else round(first, 2)
