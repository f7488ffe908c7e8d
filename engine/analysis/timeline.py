"""The moments before a run ended: speed, acceleration, what the cost was made of, how near the other was."""

from pathlib import Path

import numpy as np

from ...schemas.results import TimelineStep
from ...schemas.runs import RunRecord, RunSteps
from ..commonroad import Track, kept_recording
from ..geometry import oriented_rectangle
from .run_set import RunSet, driven_tracks

_MOMENTS, _LAST_S = 10, 3.0
"""Entries of a timeline and the span that they cover (chosen): a collision is decided in its last seconds."""


def timeline(runs: RunSet, record: RunRecord) -> tuple[TimelineStep, ...]:
    """At most ten moments of the last three seconds, the last one being the end; empty without steps."""
    steps = runs.steps.get(record.run_id)
    if steps is None or not steps.x_m:
        return ()
    tracks = _tracks(runs, record) | driven_tracks(steps)
    last = len(steps.x_m) - 1
    first = max(last - round(_LAST_S / record.step_s), 0)
    chosen = sorted({round(float(index)) for index in np.linspace(first, last, min(_MOMENTS, last - first + 1))})
    return tuple(_moment(record, steps, index, tracks) for index in chosen)


def _tracks(runs: RunSet, record: RunRecord) -> dict[int, Track]:
    path = next((source.path for source in runs.scenarios if source.scenario_id == record.scenario_id), None)
    return kept_recording(Path(path)).tracks if path is not None else {}


def _moment(record: RunRecord, steps: RunSteps, index: int, tracks: dict[int, Track]) -> TimelineStep:
    hit = record.collision.obstacle_id if record.collision is not None else None
    considered = {hit: tracks[hit]} if hit is not None and hit in tracks else tracks
    nearest, gap = _nearest(steps, index, considered, (record.ego_length_m, record.ego_width_m))
    term, share = _largest_cost(steps, steps.first_step + index)
    return TimelineStep(
        time_s=round(index * record.step_s, 9),
        speed_mps=steps.speed_mps[index],
        acceleration_mps2=steps.acceleration_mps2[index],
        obstacle_id=nearest,
        gap_m=gap,
        largest_cost=term,
        largest_cost_share=share,
    )


def _nearest(
    steps: RunSteps, index: int, tracks: dict[int, Track], size: tuple[float, float]
) -> tuple[int | None, float | None]:
    import shapely

    center = np.array([steps.x_m[index], steps.y_m[index]])
    ego = shapely.Polygon(oriented_rectangle(center, steps.heading_rad[index], size))
    gaps = []
    for track in tracks.values():
        at = track.index_at(steps.first_step + index)
        if at is not None:
            heading = float(track.headings_rad[at])
            other = oriented_rectangle(track.positions[at], heading, (track.length_m, track.width_m))
            gaps.append((float(ego.distance(shapely.Polygon(other))), track.obstacle_id))
    if not gaps:
        return None, None
    gap, obstacle_id = min(gaps)
    return obstacle_id, gap


def _largest_cost(steps: RunSteps, step: int) -> tuple[str | None, float | None]:
    planned = [i for i, plan_step in enumerate(steps.plan_steps) if plan_step <= step]
    if not planned:
        return None, None
    at = planned[-1]
    terms = {term: values[at] for term, values in sorted(steps.costs.items()) if at < len(values)}
    total = sum(terms.values())
    if total <= 0:
        return None, None
    term = max(terms, key=lambda name: (terms[name], name))
    return term, terms[term] / total
