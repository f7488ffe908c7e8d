"""The product's answers about a file, translated back into the terms of the original.

A judge reads one aspect as named values: numbers (compared within the law's tolerance), and texts and ids (compared
exactly). Angles are unit vectors, which do not depend on full turns; sets of ids are sorted tuples.
"""

import random
import re
import tempfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from lxml import etree

from plannerforge.engine.commonroad import ScenarioDocument, Track, read_recorded, static_tracks
from plannerforge.engine.criticality import drive_criticality
from plannerforge.engine.edits import apply_edits, scene_of
from plannerforge.engine.execution import silent
from plannerforge.engine.generation.checks import check_scenario
from plannerforge.engine.geometry import BoxTrack
from plannerforge.engine.network import check_file
from plannerforge.engine.planners import run_planner
from plannerforge.engine.scenarios import describe, read_facts
from plannerforge.engine.vehicles.models import EGO_SIZE_M
from plannerforge.evals.scoring.common import built_in
from plannerforge.schemas.errors import PlannerForgeError
from plannerforge.schemas.modification import Edit, ModificationRequest
from plannerforge.schemas.planning import RunRequest
from plannerforge.schemas.scenarios import DescribeRequest, EgoFacts, ReadFactsRequest, ScenarioFacts

from .relations import Frame

Answer = dict[str, Any]
PLANNER = "frenetix:Default"
PLACE_M, DESCRIPTION_M = 0.011, 0.11
"""Rules round places to a centimetre, and descriptions to 0.1 m or m/s."""
_NUMBER = re.compile(r"\d+(\.\d+)?")


@dataclass(frozen=True)
class TranslatedFile:
    """A file and how to translate it back; ``edit`` is the edit for its judge, in the original's terms."""

    path: Path
    frame: Frame
    edit: Edit | None = None


def _points(frame: Frame, points: Any) -> tuple[tuple[float, float], ...]:
    return tuple((float(x), float(y)) for x, y in frame.points(np.asarray(points, dtype=float).reshape(-1, 2)))


def _direction(frame: Frame, heading_rad: float) -> tuple[float, float]:
    x, y = frame.directions(np.array([heading_rad]))[0]
    return float(x), float(y)


def _sorted(frame: Frame, keys: Iterable[int]) -> tuple[int, ...]:
    return tuple(sorted({frame.element(key) for key in keys}))


def _step(frame: Frame, step: int | None) -> int | None:
    return None if step is None else step - frame.steps


# Facts and features


@lru_cache(maxsize=2)
def _read_facts(path: Path) -> ScenarioFacts:
    return read_facts(ReadFactsRequest(path=path), silent)


def _facts(asked: TranslatedFile) -> Answer:
    """Return the facts of the catalogue without the computed features."""
    facts, frame = _read_facts(asked.path), asked.frame
    answer: Answer = {
        "scenario_id": facts.scenario_id,
        "format_version": facts.format_version,
        "step_s": facts.step_s,
        "horizon_steps": facts.horizon_steps - frame.steps,
        "location": (facts.location.country, facts.location.place),
        "coordinates": (facts.location.latitude_deg, facts.location.longitude_deg),
        "tags": facts.tags,
        "lanelets": facts.roads.lanelets - frame.added,
        "signs_map": facts.roads.signs_map,
        "limits_map_kmh": facts.roads.limits_map_kmh,
        "lights_map": facts.roads.traffic_lights_map,
        "participants": (sorted(facts.participants.dynamic.items()), sorted(facts.participants.static.items())),
        "density_per_km": facts.density_per_km,
    }
    for ego in facts.egos:
        answer |= {f"ego {frame.element(ego.problem_id)}: {key}": value for key, value in _ego(frame, ego).items()}
    return answer


def _ego(frame: Frame, ego: EgoFacts) -> Answer:
    return {
        "place": _points(frame, [(ego.x_m, ego.y_m)]),
        "heading": _direction(frame, ego.heading_rad),
        "speed": ego.speed_mps,
        "lanes": ego.lanes,
        "lanelets": _sorted(frame, ego.lanelets),
        "goal": (ego.goal_forms, _step(frame, ego.goal_first_step), _step(frame, ego.goal_last_step)),
        "route": frame.way(ego.route),
        "time_to_conflict_s": ego.time_to_conflict_s,
        "signs": ego.signs,
        "traffic_light": ego.traffic_light,
        "limits_kmh": ego.limits_kmh,
    }


def _features(asked: TranslatedFile) -> Answer:
    """Return the computed features of every planning problem; left and right are the original's."""
    return {
        f"ego {asked.frame.element(ego.problem_id)}": tuple(sorted(map(asked.frame.sided, ego.features)))
        for ego in _read_facts(asked.path).egos
    }


# Rules, the recording, criticality


def _rules(asked: TranslatedFile) -> Answer:
    """Return the findings' places by rule and elements (empty if a lanelet was cut)."""
    checked, frame = check_file(asked.path), asked.frame
    found: dict[str, list[tuple[float, float]]] = {"unreadable": [] if not checked.unreadable else [(0.0, 0.0)]}
    for finding in checked.findings:
        elements = _sorted(frame, finding.elements)
        place = () if finding.where is None else _points(frame, [finding.where])
        found.setdefault(f"{finding.severity} {finding.rule} {elements}", []).extend(place)
    return {key: tuple(sorted(places)) for key, places in found.items()}


@lru_cache(maxsize=2)
def _tracks_of(path: Path) -> tuple[dict[int, Track], dict[int, Track]]:
    """Return the moving and the standing road users of a file."""
    recorded = read_recorded(path)
    return recorded.tracks, static_tracks(recorded.loaded.scenario, 0)


def _recording(asked: TranslatedFile) -> Answer:
    """Return the road users as the product reads them."""
    moving, standing = _tracks_of(asked.path)
    answer: Answer = {}
    for track in moving.values():
        answer |= _track(asked.frame, track, _step(asked.frame, track.first_step))
    for track in standing.values():
        answer |= _track(asked.frame, track, 0)
    return answer


def _track(frame: Frame, track: Track, first_step: int | None, name: str = "") -> Answer:
    own = f"{name or frame.element(track.obstacle_id)}"
    return {
        f"{own}: body": (track.kind, first_step, len(track.positions), track.length_m, track.width_m),
        f"{own}: positions": frame.points(track.positions),
        f"{own}: headings": frame.directions(track.headings_rad),
        f"{own}: speeds": np.asarray(track.speeds_mps),
    }


def _criticality(asked: TranslatedFile) -> Answer:
    """Return the criticality of the longest recorded road user's drive among the others."""
    moving, standing = _tracks_of(asked.path)
    if not moving:
        return {}
    ego = min(moving.values(), key=lambda track: (-len(track.positions), asked.frame.element(track.obstacle_id)))
    figures = drive_criticality(ego, [one for one in moving.values() if one is not ego], standing.values())
    return {
        "ego": asked.frame.element(ego.obstacle_id),
        "minimum_distance_m": figures.minimum_distance_m,
        "minimum_time_to_collision_s": figures.minimum_time_to_collision_s,
        "minimum_time_headway_s": figures.minimum_time_headway_s,
        "risk_score": figures.risk_score,
    }


# The document, the description, the checks of generation


def canonical(root: Any) -> bytes:
    """Return a tree as bytes, without meaningless white space and comments."""
    for text in root.iter():
        if isinstance(text.tag, str):
            text.text = (text.text or "").strip() or None
            text.tail = None
    return bytes(etree.tostring(root, method="c14n2", with_comments=False))


def rewritten(path: Path, folder: Path) -> Path:
    """Return the file as the product's document writes it when nothing was edited."""
    document = ScenarioDocument.read(path)
    written = folder / f"rewritten-{path.name}"
    document.write(written, document.root.get("benchmarkID", ""))
    return written


def _description(asked: TranslatedFile) -> Answer:
    """Return the description's text: the ego's route, the vehicles' positions, the lanelets' successors."""
    request = DescribeRequest(path=asked.path, detail="vehicles", focus=None, radius_m=80.0)
    told, frame = describe(request, silent), asked.frame
    answer: Answer = {"vehicles_total": told.vehicles_total}
    if told.ego is not None:
        answer |= {
            "ego lanes": told.ego.lanes,
            "ego route": frame.way(told.ego.route),
            "way": frame.sided(told.ego.way),
        }
    for vehicle in told.vehicles:
        lanelet = None if vehicle.lanelet is None else frame.element(vehicle.lanelet)
        times = (vehicle.from_s, round(vehicle.until_s, 2))
        where = _NUMBER.sub("#", frame.sided(vehicle.where))  # its figures, rounded to metres, are those below
        answer[f"{frame.element(vehicle.vehicle_id)}"] = (where, lanelet, *times, vehicle.moves)
        figures = (vehicle.speed_mps, vehicle.distance_m, vehicle.ahead_m, vehicle.gap_m)
        answer[f"{frame.element(vehicle.vehicle_id)}: figures"] = figures
    return answer


def _checks(asked: TranslatedFile) -> Answer:
    """Return the results of generation's own checks of the file, for an ego that keeps its initial motion.

    Empty if the goal is not a region, as generated goals are.
    """
    recorded = read_recorded(asked.path)
    problems = recorded.loaded.planning_problems.planning_problem_dict.values()
    if not problems or not all(
        hasattr(getattr(goal, "position", None), "center") for one in problems for goal in one.goal.state_list
    ):
        return {}
    state, step_s = recorded.loaded.problem().initial_state, recorded.loaded.step_s
    heading = float(state.orientation)
    ahead_m = np.arange(20)[:, None] * step_s * float(state.velocity)
    positions = np.asarray(state.position) + ahead_m * np.array([np.cos(heading), np.sin(heading)])
    ego = BoxTrack(positions, np.full(len(positions), heading), EGO_SIZE_M)
    checks = check_scenario(asked.path, ego, check_file(asked.path).findings)
    return {
        "schema_valid": checks.schema_valid,
        "goal_reachable": checks.goal_reachable,
        "collisions_at_start": checks.collisions_at_start,
        "overlapping_pairs": checks.overlapping_pairs,
        "recorded_ego_collision_free": checks.recorded_ego_collision_free,
        "centers_on_lanelets": checks.centers_on_lanelets,
        "infeasible": _sorted(asked.frame, checks.infeasible_vehicles),
    }


# Edits and planner runs

_TURNED: Final = {"left": "right", "right": "left"}


def drawn_edit(path: Path, draw: random.Random) -> Edit | None:
    """Return an edit of one kind on a moving vehicle, or None if the file has no such vehicle."""
    scene = scene_of(path).scene
    moving = [key for key, track in scene.tracks.items() if key in scene.matches and track.speeds_mps.mean() > 1.0]
    if not moving:
        return None
    vehicles = [str(draw.choice(sorted(moving)))]
    return draw.choice(
        [
            Edit(op="set_speed", vehicles=vehicles, speed="6m/s", time_s=1.0),
            Edit(op="change_lane", vehicles=vehicles, lane=draw.choice(["left", "right"]), time_s=1.0),
            Edit(op="reroute", vehicles=vehicles, turn=draw.choice(["left", "right", "straight"])),
            Edit(op="shift_time", vehicles=vehicles, time_s=1.0),
            Edit(op="set_behaviour", vehicles=vehicles, preset="cautious"),
            Edit(op="remove_vehicle", vehicles=vehicles),
            Edit(op="add_vehicle", vehicle_class="car", at=f"vehicle:{vehicles[0]}", offset_m=-20.0),
        ]
    )


def _there(edit: Edit, frame: Frame, step_s: float) -> Edit:
    """Return the edit in the terms of the changed file."""
    new = {old: there for there, old in frame.ids.items() if old not in frame.cut}
    changed: Answer = {"vehicles": [str(new.get(int(key), int(key))) for key in edit.vehicles]}
    if edit.at is not None:
        key = int(edit.at.removeprefix("vehicle:"))
        changed["at"] = f"vehicle:{new.get(key, key)}"
    for name in ("lane", "turn"):
        side = getattr(edit, name)
        changed[name] = _TURNED.get(side, side) if frame.mirrored and side is not None else side
    if edit.time_s is not None and edit.op != "shift_time":
        changed["time_s"] = edit.time_s + frame.steps * step_s
    return edit.model_copy(update=changed)


def _edited(asked: TranslatedFile) -> Answer:
    """Return the refusal by its reason, or the touched vehicles and their motions."""
    if asked.edit is None:
        return {}
    frame = asked.frame
    recorded = read_recorded(asked.path)
    edit = _there(asked.edit, frame, recorded.loaded.step_s)
    with tempfile.TemporaryDirectory() as folder:
        request = ModificationRequest(
            xml=asked.path, edits=(edit,), benchmark_id=recorded.loaded.benchmark_id, output=Path(folder)
        )
        try:
            outcome = apply_edits(request, silent)
        except PlannerForgeError as error:
            return {"refused": (error.code, error.reason)}
        known = {*recorded.tracks}
        tracks = read_recorded(outcome.xml).tracks if outcome.xml else {}
    touched = {one.vehicle_id: one for one in outcome.touched}
    answer: Answer = {
        "op": edit.op,
        "removed": _sorted(frame, outcome.removed),
        "touched": tuple(sorted(_name(frame, key, known) for key in touched)),
        "collisions": len(outcome.collisions),
        "done": tuple(one.done for one in outcome.edits),
    }
    for key in touched:
        if key in tracks:
            first = _step(frame, tracks[key].first_step)
            answer |= _track(frame, tracks[key], first, _name(frame, key, known))
    return answer


def _name(frame: Frame, key: int, known: set[int]) -> str:
    return str(frame.element(key)) if key in known else "added"


def _run(asked: TranslatedFile) -> Answer:
    """Return the end and the motion of a run of the default planner."""
    request = RunRequest(
        run_id="symmetry", scenario_path=str(asked.path), scenario_id="symmetry", configuration=built_in(PLANNER)
    )
    response, frame = run_planner(request, silent), asked.frame
    record, steps = response.record, response.steps
    hit = record.collision
    return {
        "outcome": record.outcome,
        "invalid_reason": record.invalid_reason,
        "collision": None
        if hit is None
        else (None if hit.obstacle_id is None else frame.element(hit.obstacle_id), hit.kind, hit.step - frame.steps),
        "first_step": steps.first_step - frame.steps,
        "positions": frame.points(np.column_stack([steps.x_m, steps.y_m])),
        "speeds": np.array(steps.speed_mps),
        "planned": [step - steps.first_step for step in steps.plan_steps],
        "costs": [float(sum(values)) for values in zip(*steps.costs.values(), strict=True)],
        "rejected": [sum(counts) for counts in zip(*steps.rejected.values(), strict=True)],
    }


Judge = Callable[[TranslatedFile], Answer]
CHEAP: Final[Mapping[str, Judge]] = {
    "facts": _facts,
    "features": _features,
    "rules": _rules,
    "recording": _recording,
    "criticality": _criticality,
}
"""Judges for every file; ``document`` is one more, which compares files."""
DEAR: Final[Mapping[str, Judge]] = {"description": _description, "checks": _checks, "edit": _edited, "run": _run}
"""Judges for a sample of files, because they simulate."""
