"""Checks that a perfect world changes nothing, what sensing costs, and what the sensors see.

Public scenarios of the shared folder are drawn by the seed and driven by Frenetix and IDM.

- ``worlds_same``: share of drawn runs in which nothing changes. The run without a world, in a perfect world that is
  spelled differently, and in a world with imperfections without effect give the same states, costs and metrics, bit
  for bit. The first two also give the same record and files. 1 is required.
- ``sensing_cost``: processor time of the sensors over that of the runs with Frenetix in the world ``lidar``
- ``sensing_cost_idm``: the same with IDM, which plans faster
- ``visible_error_max``: the largest difference between the visible share of a body and the share of rays that meet it
  first, over random scenes. The rays are cast here by shapely, one by one, every ``1 / _RAYS`` of the body's angle.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import shapely

from plannerforge.engine.execution import silent
from plannerforge.engine.perception import Bodies, Percept, Sensors, seen_shares
from plannerforge.engine.planners import run_planner
from plannerforge.evals.scoring.common import built_in
from plannerforge.schemas.planning import RunRequest, RunResponse
from plannerforge.schemas.worlds import World, world_of

from ..harness import Figures, SeededBench, share

RUNS, SCENES = 24, 40
_RAYS, _BODIES = 1500, 8
_NO_EFFECT = World(latency_s=0.001, confirmed_s=0.001, seed=5)
"""Imperfections that round to no time step: the run passes through the sensors, which report the truth."""
_OTHER_SPELLINGS = ("perfect", "missed=0, ghosts=0", "seed=7, correlation_s=2")


def measure(bench: SeededBench) -> Figures:
    """Measure the keys above."""
    draw = np.random.default_rng(bench.seed)
    paths = sorted((bench.shared / "data" / "commonroad").glob("*.xml"))
    chosen = [paths[index] for index in draw.permutation(len(paths))[: bench.limit or RUNS]]
    same, costs = list[bool](), {"frenetix:Default": [0.0, 0.0], "idm:Default": [0.0, 0.0]}
    for path in chosen:
        for name, spent in costs.items():
            same.append(_is_same(path, name))
            sensing_s, run_s = _cost(path, name)
            spent[0] += sensing_s
            spent[1] += run_s
    errors = [_visible_error(draw) for _ in range(bench.limit or SCENES)]
    return {
        "worlds_same": share(same),
        "worlds_runs": len(same),
        "sensing_cost": round(costs["frenetix:Default"][0] / costs["frenetix:Default"][1], 3),
        "sensing_cost_idm": round(costs["idm:Default"][0] / costs["idm:Default"][1], 3),
        "visible_error_max": round(max(errors), 4),
    }


def _driven(path: Path, name: str, world: World | None) -> RunResponse:
    values = {} if world is None else {"world": world}
    request = RunRequest(
        run_id="run_0", scenario_path=str(path), scenario_id=path.stem, configuration=built_in(name), **values
    )
    return run_planner(request, silent)


def _is_same(path: Path, name: str) -> bool:
    plain = _driven(path, name, None)
    spelled = [_driven(path, name, world_of(text)) for text in _OTHER_SPELLINGS]
    if any(_content(one) != _content(plain) for one in spelled):
        return False
    sensed = _driven(path, name, _NO_EFFECT)
    left_out: tuple[set[str], set[str]] = ({"world"}, {"perceived"})
    return _content(sensed, *left_out) == _content(plain, *left_out) and sensed.steps.perceived is not None


def _content(response: RunResponse, record: set[str] | None = None, steps: set[str] | None = None) -> tuple[str, str]:
    return response.record.model_dump_json(exclude=record), response.steps.model_dump_json(exclude=steps)


class _Timed:
    """Counts the processor time of ``Sensors.perceive`` while it is in place."""

    def __init__(self) -> None:
        self.spent_s = 0.0
        self._own = Sensors.perceive

    def __enter__(self) -> "_Timed":
        timer, own = self, self._own

        def perceive(sensors: Sensors, *arguments: Any) -> Percept:
            began = process_time()
            percept = own(sensors, *arguments)
            timer.spent_s += process_time() - began
            return percept

        Sensors.perceive = perceive  # type: ignore[assignment,method-assign]
        return self

    def __exit__(self, *_: object) -> None:
        Sensors.perceive = self._own  # type: ignore[method-assign]


def _cost(path: Path, name: str) -> tuple[float, float]:
    """Return the processor time in s of the sensors of a run, and of the whole run."""
    with _Timed() as timer:
        began = process_time()
        _driven(path, name, world_of("lidar"))
        return timer.spent_s, process_time() - began


def _visible_error(draw: np.random.Generator) -> float:
    """Return the largest error of the visible shares in a random scene around the origin."""
    kept: list[tuple[float, float, float, float, float]] = []
    outlines: list[shapely.Polygon] = []
    while len(kept) < _BODIES:
        away, angle = draw.uniform(5, 60), draw.uniform(-math.pi, math.pi)
        size = [(4.5, 1.8), (12.0, 2.5), (2.0, 0.6)][int(draw.integers(3))]
        body = (away * math.cos(angle), away * math.sin(angle), draw.uniform(0, math.tau), *size)
        outline = _outline(body)
        if outline.contains(shapely.Point(0, 0)) or any(outline.intersects(other) for other in outlines):
            continue
        kept.append(body)
        outlines.append(outline)
    values = np.array(kept)
    bodies = Bodies(
        values[None, :, :2],
        values[None, :, 2],
        values[:, 3:],
        np.ones(_BODIES, dtype=bool),
        np.ones((1, _BODIES), dtype=bool),
    )
    stated = seen_shares(np.zeros((1, 2)), np.zeros(1), math.tau, bodies, count=_BODIES).visible[0]
    return max(abs(float(stated[at]) - _by_rays(outlines, at)) for at in range(_BODIES))


def _outline(body: Sequence[float]) -> shapely.Polygon:
    x, y, heading, length, width = body
    box = shapely.box(-length / 2, -width / 2, length / 2, width / 2)
    turned = shapely.affinity.rotate(box, heading, origin=(0, 0), use_radians=True)
    return shapely.affinity.translate(turned, x, y)


def _by_rays(outlines: Sequence[shapely.Polygon], target: int) -> float:
    """Return the share of the rays towards a body that meet it before any other."""
    middle = outlines[target].centroid
    bearing = math.atan2(middle.y, middle.x)
    corners = list(outlines[target].exterior.coords)
    off = [math.remainder(math.atan2(y, x) - bearing, math.tau) for x, y in corners]
    angles = bearing + min(off) + (np.arange(_RAYS) + 0.5) / _RAYS * (max(off) - min(off))
    ends = 200.0 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    rays = shapely.linestrings(np.stack([np.zeros_like(ends), ends], axis=1))
    origin = shapely.Point(0, 0)
    away = np.array([shapely.distance(shapely.intersection(rays, outline), origin) for outline in outlines])
    first = np.nanargmin(np.where(np.isnan(away), np.inf, away), axis=0)
    return float(np.mean(first == target))
