"""Scores generation: whether the scenarios load, have the requested traffic at the requested place, and run.

Columns of the paper (Scenario Generation Module, Evaluation Metrics): ``json`` (a call was made), ``defaults`` (values
that the request leaves open stay open or take their default), ``load``, ``traffic``, ``runnable`` (the default planner
finishes a trajectory). Additional columns are ``place``, ``type``, ``vehicles`` and ``count``.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...engine.commonroad import read_scenario
from ...engine.execution import silent
from ...engine.planners import make_planner, simulate
from ...engine.vehicles import vehicle_of
from ...schemas.errors import NotPossible
from ...schemas.generation import USUAL_GOAL
from ...schemas.runs import NO_TRAJECTORY
from ..attempts import Attempt, EvalRequest, MadeCall, Score
from .common import built_in, last_of, refused, scored
from .files import World
from .made_files import MadeFiles, has_vehicles

_USUAL: Mapping[str, tuple[object, ...]] = {
    "density": (None, "low"),
    "duration_s": (None, 20, 20.0),
    "count": (None, 1),
    "ego": (None, "first"),
    "goal": (None, USUAL_GOAL),
    "road_classes": (None, ["roads"], []),
    "vehicles": (None, [], ["car"]),
    "scenario_type": (None, "any"),
}
"""Allowed values of an argument that the request leaves open."""


def score_generation(request: EvalRequest, attempt: Attempt, workspace: Path) -> Score:
    """Score the last generated scenarios; if no map covers the place, a refusal is correct."""
    if request.expect == "refuse" or (request.expect == "ok" and request.map_file is None):
        return refused(request, attempt, "generate_scenarios")
    made = last_of(attempt.calls, "generate_scenarios")
    if made is None:
        return scored(request, {"json": False}, ["no scenario was created"])
    return scored(request, generation_columns(request.truth, made, workspace))


def generation_columns(truth: Mapping[str, Any], made: MadeCall, workspace: Path) -> dict[str, bool | None]:
    """Return, by column, whether the scenarios of a call meet the check; None if it does not apply."""
    found = made.structured.get("scenarios", [])
    folders = [workspace / "scenarios" / str(one["scenario_id"]) for one in found]
    world = World(workspace)
    scenes = [world.scene(folder.name) for folder in folders]
    files = [MadeFiles.read(folder) for folder, scene in zip(folders, scenes, strict=True) if scene is not None]
    signalised = truth.get("feature") == "signalised_crossing"
    kind = "signalised_intersection" if signalised else truth["scenario_type"]
    country = truth["location"]["country"]
    return {
        "json": True,
        "defaults": all(
            made.arguments.get(name) in _USUAL[name] for name in truth.get("defaults", ()) if name in _USUAL
        ),
        "load": bool(scenes) and all(scene is not None for scene in scenes),
        "traffic": all(scene is not None and scene.counts.total() > 0 for scene in scenes),
        "runnable": all(_runs(folder) for folder in folders),
        "count": len(found) == truth.get("count", 1) or f"only {len(found)} different site" in made.text,
        "place": country is None or all(str(one["scenario_id"]).startswith(country) for one in found),
        "type": kind == "any" or all(str(one["site"]).startswith(kind) for one in found),
        "vehicles": any(_has_classes(files, wanted) for wanted in truth.get("vehicles_accept", [truth["vehicles"]])),
    }


def _has_classes(files: list[MadeFiles], wanted: Mapping[str, int | str]) -> bool:
    return all(has_vehicles(one, {name: _bounds(count) for name, count in wanted.items()}) for one in files)


def _bounds(count: int | str) -> tuple[int, int | None]:
    """Return the minimum and maximum count of a class: present, at least a number, or between two numbers."""
    if count == "present":
        return 1, None
    least, between, most = str(count).partition("..")
    return int(least), int(most) if between else None


def _runs(folder: Path) -> bool:
    """Return whether Frenetix with its default weights finishes a trajectory."""
    loaded = read_scenario(folder / "scenario.xml")
    planner, default, problem = make_planner("frenetix"), built_in("frenetix:Default"), loaded.problem()
    try:
        vehicle = vehicle_of(default.settings, loaded.ego_class(int(problem.planning_problem_id)))
    except NotPossible:  # a vehicle with a trailer
        return False
    run = simulate(loaded.scenario, problem, default, planner, "constant_velocity", silent, vehicle=vehicle)
    return run.final.outcome not in NO_TRAJECTORY
