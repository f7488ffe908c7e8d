"""Read the facts of a CommonRoad file: the PlannerForge paper's four metadata layers and computed features.

Paper: Methodology, Framework Setup (location, roadside constructs, participants, ego vehicle). The facts also state how
dense the recorded traffic is, and when it meets an ego that does not react.
"""

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from ...schemas.errors import UnsafeInput
from ...schemas.scenarios import EgoFacts, LocationFacts, ParticipantFacts, ReadFactsRequest, RoadFacts, ScenarioFacts
from ...schemas.text import cited, counted, enumerated, one_line, shown_name
from ...schemas.vocabulary import CIRCUMSTANCES, GoalForm
from ..commonroad import (
    LoadedScenario,
    RecordedScenario,
    Track,
    XmlLimits,
    center_of,
    has_light,
    kept_recording,
    last_recorded_step,
    limits_kmh,
    middle_of,
    parse_benchmark_id,
    scan_xml,
    schema_errors,
    sign_keys,
    signs_of,
    static_tracks,
)
from ..execution import ProgressReporter
from ..geometry import arc_length, oriented_rectangle, project, rectangles_overlap
from ..network import LaneletGraph, read_net
from ..scene import EgoRoute, ego_route, lanelets_of_pose, path_ahead
from ..traffic import words_of_hour
from ..vehicles import ego_class
from .features import AHEAD_OF_START_M, along_line, features, is_near_line
from .manoeuvres import Manoeuvre, manoeuvres, unprotected_left

if TYPE_CHECKING:
    from commonroad.planning.planning_problem import PlanningProblem
    from commonroad.scenario.scenario import Scenario


def read_facts(request: ReadFactsRequest, report: ProgressReporter) -> ScenarioFacts:
    """Return the facts of one CommonRoad file.

    Raises:
        UnsafeInput: the file is hostile, broken or not a CommonRoad file, or contains numbers outside the limits of
            scenarios; or the SUMO network next to it is not valid.
    """
    report(0.0, f"reading {shown_name(request.path.name)}")
    if request.net is not None:
        _check_net(request.net, request.file_bytes)
    recorded = kept_recording(request.path, request.file_bytes, keep=request.keep)
    report(0.6, "analysing the geometry")
    facts = _facts_of(recorded)
    return facts.model_copy(update={"faults": _faults(recorded, facts)}) if request.checks else facts


def _faults(read: RecordedScenario, facts: ScenarioFacts) -> tuple[str, ...]:
    """Return a phrase for each fault that makes runs invalid or that other tools may refuse."""
    scenario, found = read.loaded.scenario, list[str]()
    bodies = {**read.tracks, **static_tracks(scenario, last_recorded_step(scenario))}
    problems = read.loaded.planning_problems.planning_problem_dict
    for ego in facts.egos:
        start_step = int(problems[ego.problem_id].initial_state.time_step)
        size_m = ego_class(ego.vehicle_class).vehicle.size_m
        own = oriented_rectangle(np.array([ego.x_m, ego.y_m]), ego.heading_rad, size_m)
        present = ((key, body, body.index_at(start_step)) for key, body in sorted(bodies.items()))
        hit = [key for key, body, at in present if at is not None and rectangles_overlap(own, body.corners_at(at))]
        if hit:
            which = f" of problem {ego.problem_id}" if len(facts.egos) > 1 else ""
            named = [*map(str, hit[:_MOST_HIT]), *([f"{len(hit) - _MOST_HIT} more"] if len(hit) > _MOST_HIT else [])]
            found.append(f"the ego{which} overlaps road user {enumerated(named)} at its start, so its runs are invalid")
    violations = schema_errors(read.loaded.path)
    return (*found, *([f"{counted(len(violations), 'violation')} of CommonRoad's XML schema"] if violations else []))


_MOST_HIT = 4
"""How many road users that overlap the ego a fault names (chosen)."""


def _check_net(path: Path, file_bytes: int) -> None:
    """Refuse an invalid network: it is stored with the scenario for exports."""
    try:
        scan_xml(path, XmlLimits(size_bytes=file_bytes))
        read_net(path)
    except (UnsafeInput, ValueError) as error:
        reason = error.message if isinstance(error, UnsafeInput) else f"{shown_name(path.name)}: {cited(error)}"
        raise UnsafeInput(
            f"the network next to the scenario cannot be imported: {reason}",
            next_step=f"correct {shown_name(path.name)}, or remove it: the scenario can be imported without it",
        ) from error


_TAG_NAMES = {"illegal_cutin": "illegal_cut_in"}
"""commonroad-io's names of tags that have another spelling here."""


def _facts_of(read: RecordedScenario) -> ScenarioFacts:
    """Return the facts of a scenario in memory.

    Raises:
        UnsafeInput: an id violates the naming rules.
    """
    loaded, tracks = read.loaded, read.tracks
    scenario, network = loaded.scenario, loaded.scenario.lanelet_network
    country, place = parse_benchmark_id(loaded.benchmark_id)
    graph = LaneletGraph.of(network)
    problems = [problem for _, problem in sorted(loaded.planning_problems.planning_problem_dict.items())]
    last_step = last_recorded_step(scenario)
    recording = _Recording(loaded, scenario, graph, tracks, {**tracks, **static_tracks(scenario, last_step)}, last_step)
    egos = tuple(_ego(recording, problem) for problem in problems)
    first = egos[0] if egos else None
    last_goal = max((ego.goal_last_step or 0 for ego in egos), default=0)
    return ScenarioFacts(
        scenario_id=loaded.benchmark_id,
        format_version=str(scenario.scenario_id.scenario_version),
        step_s=loaded.step_s,
        horizon_steps=max(last_step, last_goal),
        location=_location(country, place, scenario),
        tags=tuple(sorted({_TAG_NAMES.get(tag.value, tag.value) for tag in scenario.tags or ()})),
        features=first.features if first else (),
        roads=RoadFacts(
            lanelets=len(network.lanelets),
            signs_ego=first.signs if first else (),
            signs_map=sign_keys(network.traffic_signs),
            traffic_light_ego=first.traffic_light if first else False,
            traffic_lights_map=len(network.traffic_lights),
            limits_ego_kmh=first.limits_kmh if first else (),
            limits_map_kmh=limits_kmh(network.traffic_signs),
        ),
        participants=ParticipantFacts(
            dynamic=_counts(scenario.dynamic_obstacles), static=_counts(scenario.static_obstacles)
        ),
        egos=egos,
        density_per_km=_density_per_km(graph, tracks.values(), _first_step(problems, tracks.values()), last_step),
        source=one_line(str(scenario.source or "")),
        circumstances=_circumstances(scenario),
    )


def _circumstances(scenario: "Scenario") -> tuple[str, ...]:
    """Return bad weather, night and rush hour, as stated in the environment element of a file."""
    environment = getattr(scenario.location, "environment", None)
    if environment is None:
        return ()
    words = {getattr(part, "value", "") for part in (environment.weather, environment.time_of_day)}
    if environment.time is not None:
        words |= set(words_of_hour(int(environment.time.hours) % 24)) - {
            "night"
        }  # the file itself states what counts as night
    return tuple(word for word in CIRCUMSTANCES if word in words)


@dataclass(frozen=True)
class _Recording:
    """The recording, from which the facts for every ego come; ``bodies`` are the tracks and the static obstacles."""

    loaded: LoadedScenario
    scenario: "Scenario"
    graph: LaneletGraph
    tracks: dict[int, Track]
    bodies: dict[int, Track]
    last_step: int


def manoeuvres_met(
    loaded: LoadedScenario,
    graph: LaneletGraph,
    tracks: dict[int, Track],
    problem: "PlanningProblem",
    vehicle_class: str,
) -> tuple[Manoeuvre, ...]:
    """Return the manoeuvres that road users make on the path of an ego with a given problem, in a scenario's lanes.

    The result is that of :func:`read_facts` for a file with these tracks and this problem.

    Args:
        loaded: the scenario that has the lanes.
        graph: its lanelets.
        tracks: all road users except the ego, by id.
        problem: the ego's start and goal.
        vehicle_class: the ego's class.
    """
    last_step = max((track.last_step for track in tracks.values()), default=0)
    recording = _Recording(loaded, loaded.scenario, graph, tracks, tracks, last_step)
    route = ego_route(loaded.scenario.lanelet_network, graph, problem)
    ego = _placed_ego(recording, problem, route, vehicle_class)
    return _manoeuvres(recording, ego, route, int(problem.initial_state.time_step))[0]


def _ego(recording: _Recording, problem: "PlanningProblem") -> EgoFacts:
    network = recording.scenario.lanelet_network
    route = ego_route(network, recording.graph, problem)
    vehicle_class = recording.loaded.ego_class(int(problem.planning_problem_id))
    ego = _placed_ego(recording, problem, route, vehicle_class)
    start_step = int(problem.initial_state.time_step)
    computed = features(network, recording.graph, recording.tracks, ego, route, start_step)
    conflict_s = _time_to_conflict_s(recording, ego, start_step)
    met, left = _manoeuvres(recording, ego, route, start_step)
    named = {one.name for one in met} | ({"unprotected_left"} if left else set())
    return ego.model_copy(
        update={
            "features": tuple(sorted({*computed, *named})),
            "manoeuvres": tuple(sorted({str(one) for one in met})),
            "time_to_conflict_s": conflict_s,
        }
    )


def _placed_ego(
    recording: _Recording, problem: "PlanningProblem", route: EgoRoute | None, vehicle_class: str
) -> EgoFacts:
    """Return the ego's start and stated goal, without facts computed from the traffic."""
    network, state = recording.scenario.lanelet_network, problem.initial_state
    point, heading = np.asarray(center_of(state.position), dtype=float), middle_of(state.orientation)
    lanelets = lanelets_of_pose(network, point, heading)
    steps = [goal.time_step for goal in problem.goal.state_list if getattr(goal, "time_step", None) is not None]
    first = [int(getattr(step, "start", step)) for step in steps]
    last = [int(getattr(step, "end", step)) for step in steps]
    signs = signs_of(network, lanelets)
    return EgoFacts(
        problem_id=int(problem.planning_problem_id),
        speed_mps=middle_of(state.velocity),
        x_m=float(point[0]),
        y_m=float(point[1]),
        heading_rad=heading,
        lanes=max((len(recording.graph.parallel_lanes([key])) for key in lanelets), default=0),
        lanelets=lanelets,
        goal_forms=_goal_forms(problem),
        goal_first_step=min(first, default=None),
        goal_last_step=max(last, default=None),
        route=route.lanelets if route else (),
        signs=sign_keys(signs),
        traffic_light=has_light(network, lanelets),
        limits_kmh=limits_kmh(signs),
        vehicle_class=vehicle_class,
    )


_FARTHEST_M = 1000.0
"""Longest part of the ego's path that is examined (chosen)."""


def _manoeuvres(
    recording: _Recording, ego: EgoFacts, route: EgoRoute | None, start_step: int
) -> tuple[tuple[Manoeuvre, ...], bool]:
    """Return the manoeuvres of the recorded traffic on the ego's path, and whether the ego turns left unprotected."""
    start = (ego.route or ego.lanelets or (None,))[0]
    if start is None:
        return (), False
    network, graph, step_s = recording.scenario.lanelet_network, recording.graph, recording.loaded.step_s
    driven_m = ego.speed_mps * step_s * max(recording.last_step - start_step, 0)
    route_m = sum(graph.length_m[key] for key in ego.route)
    path = path_ahead(network, graph, start, ego.route, min(max(driven_m + AHEAD_OF_START_M, route_m), _FARTHEST_M))
    length_m = ego_class(ego.vehicle_class).vehicle.size_m[0]
    found = manoeuvres(network, graph, recording.tracks, ego, length_m, path, start_step, step_s)
    return found, unprotected_left(network, route, path)


def _first_step(problems: Iterable["PlanningProblem"], tracks: Iterable[Track]) -> int:
    """Return the scenario's first step: the first ego start or recorded state, or 0 if there is neither."""
    starts = [int(problem.initial_state.time_step) for problem in problems]
    return min([*starts, *(track.first_step for track in tracks)], default=0)


def _density_per_km(graph: LaneletGraph, tracks: Iterable[Track], first_step: int, last_step: int) -> float:
    """Return recorded vehicles per kilometre of lanelets: the mean over all steps, rounded to 0.1."""
    length_km = sum(graph.length_m.values()) / 1000.0
    steps = sum(len(track.positions) for track in tracks)
    return round(steps / max(last_step - first_step + 1, 1) / length_km, 1) if length_km > 0 else 0.0


LONGEST_LOOK_M = 1000.0
"""Longest part of the ego's path that is examined (chosen)."""
BEYOND_M = 50.0
"""Length of path examined beyond the distance that the ego drives during the recording (chosen)."""
INSIDE_END_M = 0.1
"""Projections within this of the path's end belong to bodies beyond it (chosen)."""


def _time_to_conflict_s(recording: _Recording, ego: EgoFacts, start_step: int) -> float | None:
    """Return the seconds until an ego that keeps its path and initial speed meets the recording, or None.

    This differs from a run's time to collision (:mod:`plannerforge.engine.criticality`), which assumes that the two
    road users keep their course and speed in the plane. Here, the others move as recorded, and the ego follows its
    lanes. All are rectangles in the path's coordinates; the ego has the size of a BMW 320i. Bodies that overlap the ego
    at its start are left out, and so are those that hit it from behind.
    """
    start = (ego.route or ego.lanelets or (None,))[0]
    if start is None or not recording.bodies:
        return None
    step_s = float(recording.scenario.dt)
    look_m = min(ego.speed_mps * (recording.last_step * step_s) + BEYOND_M, LONGEST_LOOK_M)
    line, _ = path_ahead(recording.scenario.lanelet_network, recording.graph, start, ego.route, look_m)
    if len(line) < 2:
        return None
    here = project(line, np.array([ego.x_m, ego.y_m]))[0]
    length = arc_length(line)[-1]
    own_length_m, own_width_m = ego_class(ego.vehicle_class).vehicle.size_m
    times_s: list[float] = []
    for key, track in recording.bodies.items():
        if track.last_step < start_step:
            continue
        skipped = max(start_step - track.first_step, 0)
        steps = np.arange(track.first_step + skipped, track.last_step + 1) - start_step
        looked_at = slice(skipped, None if key in recording.tracks else skipped + 1)  # a static obstacle has one pose
        positions, facing = track.positions[looked_at], track.headings_rad[looked_at]
        if key in recording.tracks:
            near = is_near_line(line, positions, track.length_m + track.width_m + own_width_m)
            positions, facing, steps = positions[near], facing[near], steps[near]
        if not len(positions):
            continue
        stations, offsets, turn = along_line(line, positions, facing)
        along, across = np.abs(np.cos(turn)), np.abs(np.sin(turn))
        reach = (along * track.length_m + across * track.width_m + own_length_m) / 2
        room = (across * track.length_m + along * track.width_m + own_width_m) / 2
        ahead = stations - here - ego.speed_mps * step_s * steps
        on_path = (np.abs(offsets) < room) & (stations > 0.0) & (stations < length - INSIDE_END_M)
        meets = np.flatnonzero(on_path & (np.abs(ahead) < reach))
        if len(meets) and steps[meets[0]] > 0 and ahead[meets[0]] > 0:
            times_s.append(float(steps[meets[0]]) * step_s)
    return round(min(times_s), 2) if times_s else None


def _goal_forms(problem: "PlanningProblem") -> tuple[GoalForm, ...]:
    goal = problem.goal
    stated = {
        "lanelet": bool(goal.lanelets_of_goal_position),
        "region": any(hasattr(s, "position") for s in goal.state_list) and not goal.lanelets_of_goal_position,
        "speed": any(hasattr(state, "velocity") for state in goal.state_list),
        "orientation": any(hasattr(state, "orientation") for state in goal.state_list),
        "time": any(hasattr(state, "time_step") for state in goal.state_list),
    }
    return tuple(form for form in get_args(GoalForm) if stated[form])


def _location(country: str, place: str, scenario: "Scenario") -> LocationFacts:
    latitude, longitude = _degrees(scenario, "gps_latitude", 90.0), _degrees(scenario, "gps_longitude", 180.0)
    known = latitude is not None and longitude is not None
    return LocationFacts(
        country=country,
        place=place,
        latitude_deg=latitude if known else None,
        longitude_deg=longitude if known else None,
    )


def _degrees(scenario: "Scenario", name: str, limit: float) -> float | None:
    """Return a coordinate of the file; None if it is missing or the placeholder 999."""
    value = getattr(scenario.location, name, None) if scenario.location else None
    if value is None or not math.isfinite(float(value)) or abs(float(value)) > limit:
        return None
    return float(value)


def _counts(obstacles: list[Any]) -> dict[str, int]:
    counts = Counter(str(obstacle.obstacle_type.value) for obstacle in obstacles)
    return dict(sorted(counts.items()))
