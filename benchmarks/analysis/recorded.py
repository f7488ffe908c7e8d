"""Determines who hit whom in runs on public scenarios, independently of the product.

The other road users are commonroad-io's obstacles, and the ego is the driven motion. The kinds follow the rules of
``docs/runs.md``.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from commonroad.common.file_reader import CommonRoadFileReader
from mcp import Client
from numpy.typing import NDArray
from shapely import LineString, Point

from plannerforge.schemas.runs import RunRecord, RunSteps

from ..harness import SeededBench, ask, finished_batch
from .public_runs import PREDICTION, RawRuns, public_batch, public_server, raw_runs

SECOND_PLANNER = "idm:Default"
"""Keeps its lane and yields, so that it collides in cases in which Frenetix does not."""
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Hit:
    """A collision of a run with an obstacle of its file."""

    record: RunRecord
    steps: RunSteps
    obstacle: Any
    step: int
    others: tuple[Any, ...] = ()

    @property
    def at(self) -> int:
        """The entry of the driven states at which both overlap first."""
        return min(self.step - self.steps.first_step, len(self.steps.x_m) - 1)

    def own(self, index: int) -> Array:
        """x, y, heading and speed of the ego."""
        s = self.steps
        return np.array([s.x_m[index], s.y_m[index], s.heading_rad[index], s.speed_mps[index]])

    def other(self, index: int) -> Array | None:
        """Return the same for the other at a driven state or one after the run; None if it is not there."""
        return pose_of(self.obstacle, self.steps.first_step + index)

    @property
    def own_size(self) -> Array:
        """Length and width."""
        return np.array([self.record.ego_length_m, self.record.ego_width_m])

    @cached_property
    def size(self) -> Array:
        """Length and width of the other."""
        return size_of(self.obstacle)


def pose_of(obstacle: Any, step: int) -> Array | None:
    """Return x, y, heading and speed of an obstacle at a step, or None if it is not there."""
    state = obstacle.state_at_time(step)
    if state is None:
        return None
    speed = float(getattr(state, "velocity", 0.0) or 0.0)
    return np.array([*np.asarray(state.position)[:2], float(state.orientation), speed])


def size_of(obstacle: Any) -> Array:
    """Return length and width of an obstacle; circles are squares."""
    shape = obstacle.obstacle_shape
    radius = getattr(shape, "radius", None)
    return np.array([2 * radius, 2 * radius]) if radius is not None else np.array([shape.length, shape.width])


def corners(pose: Array, size: Array, more_m: float = 0.0) -> Array:
    """Return the corners of a rectangle enlarged by a margin on every side."""
    half = size / 2 + more_m
    signs = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * half
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    turned: Array = signs @ np.array([[cosine, sine], [-sine, cosine]]) + pose[:2]
    return turned


def overlap(one: Array, other: Array, headings: tuple[float, float]) -> bool:
    """Return True if two rectangles overlap, by the axes of both."""
    for heading in (headings[0], headings[0] + math.pi / 2, headings[1], headings[1] + math.pi / 2):
        axis = np.array([math.cos(heading), math.sin(heading)])
        a, b = one @ axis, other @ axis
        if a.max() < b.min() or b.max() < a.min():
            return False
    return True


def side_of(pose: Array, size: Array, others: Array) -> str:
    """Return the side of a body beyond which another body extends farthest."""
    away = others - pose[:2]
    along = away @ np.array([math.cos(pose[2]), math.sin(pose[2])])
    left = away @ np.array([-math.sin(pose[2]), math.cos(pose[2])])
    gaps = {
        "front": along.min() - size[0] / 2,
        "rear": -along.max() - size[0] / 2,
        "left": left.min() - size[1] / 2,
        "right": -left.max() - size[1] / 2,
    }
    return max(gaps, key=lambda name: gaps[name])


def kind_of(hit: Hit) -> str:
    """Return the kind of a contact by the table of ``docs/runs.md``: the first row that holds."""
    index = max(hit.at - 1, 0)
    own, other = hit.own(index), hit.other(index)
    if other is None:
        index, other = hit.at, hit.other(hit.at)
        own = hit.own(index)
    if other is None:
        return "unclear"
    stands, other_stands = own[3] < 0.1, other[3] < 0.1
    if stands != other_stands:
        return "onto_standing_ego" if stands else "into_standing"
    turned = abs(math.remainder(other[2] - own[2], math.tau))
    if turned > math.pi / 4:
        return "oncoming" if turned >= 3 * math.pi / 4 else "crossing"
    ours = side_of(own, hit.own_size, corners(other, hit.size))
    theirs = side_of(other, hit.size, corners(own, hit.own_size))
    if ours == "rear" or (theirs == "front" and ours != "front"):
        if _came_in(hit, index, ego_is_ahead=True):
            return "cut_in_by_ego"
        return "rear_end_by_other" if ours == "rear" else "side"
    if ours == "front":
        if _came_in(hit, index, ego_is_ahead=False):
            return "cut_in"
        return "rear_end_by_ego" if theirs == "rear" else "side"
    return "side"


def _came_in(hit: Hit, index: int, *, ego_is_ahead: bool) -> bool:
    """Return True if the leader was next to the follower's path within 3 s and moved farther across than it."""
    back = min(round(3.0 / hit.record.step_s), index)
    while back and hit.other(index - back) is None:
        back -= 1
    if back < 1:
        return False
    own = [hit.own(i) for i in range(index - back, index + 1)]
    other = [pose for i in range(index - back, index + 1) if (pose := hit.other(i)) is not None]
    ahead, behind = (own, other) if ego_is_ahead else (other, own)
    end = behind[-1]
    on = end[:2] + 100.0 * np.array([math.cos(end[2]), math.sin(end[2])])
    way = LineString([*(pose[:2] for pose in behind), on])
    beside = any(way.distance(Point(pose[:2])) > (hit.own_size[1] + hit.size[1]) / 2 for pose in ahead)
    return beside and abs(_across(ahead)) > abs(_across(behind))


def _across(poses: list[Array]) -> float:
    first, moved = poses[0], poses[-1][:2] - poses[0][:2]
    return float(math.cos(first[2]) * moved[1] - math.sin(first[2]) * moved[0])


async def public_hits(bench: SeededBench) -> tuple[list[Hit], Mapping[str, Any]]:
    """Return the collisions of two planners on public scenarios, and the product's statements, by run id."""
    async with public_server(bench) as client:
        first = await public_batch(bench, client)
        second = await finished_batch(
            client, scenarios=raw_scenarios(bench, first), configs=[SECOND_PLANNER], prediction=PREDICTION
        )
        hits = [hit for batch in (first, second) for hit in _hits(raw_runs(bench, batch))]
        return hits, {hit.record.run_id: await _contact(client, hit.record.run_id) for hit in hits}


def raw_scenarios(bench: SeededBench, batch_id: str) -> list[str]:
    """Return the scenarios of a batch."""
    return list(raw_runs(bench, batch_id).batch.scenarios)


async def _contact(client: Client, run_id: str) -> Mapping[str, Any] | None:
    contact: Mapping[str, Any] | None = (await ask(client, "analyze_results", results=[run_id]))["review"]["contact"]
    return contact


def _hits(raw: RawRuns) -> list[Hit]:
    found = []
    for record in raw.valid:
        if record.collision is None or record.collision.obstacle_id is None:
            continue
        scenario, _ = CommonRoadFileReader(str(Path(raw.files[record.scenario_id]))).open()
        obstacle = scenario.obstacle_by_id(record.collision.obstacle_id)
        if obstacle is not None and hasattr(obstacle, "state_at_time"):
            others = tuple(
                other for other in scenario.obstacles if other is not obstacle and hasattr(other, "state_at_time")
            )
            found.append(Hit(record, raw.steps[record.run_id], obstacle, record.collision.step, others))
    return found
