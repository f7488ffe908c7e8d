"""The recording of a scenario as OpenSCENARIO XML 1.2 (ASAM), through scenariogeneration.

Every road user follows its recorded trajectory; the ego has its initial state and no trajectory, because the player of
the scenario drives it. OpenSCENARIO places a vehicle by the centre of its rear axle, CommonRoad by its centre: the box
of each entity states the offset of its centre. The same scenario gives the same bytes.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from lxml import etree

from ....schemas.artifacts import ForeignExport, ForeignExportRequest
from ....schemas.text import counted, one_line
from ....schemas.vocabulary import ROAD_FRICTIONS
from ...commonroad import LoadedScenario, Track, center_of, last_recorded_step, middle_of, read_scenario, static_tracks
from ...execution import ProgressReporter
from ...vehicles import ego_class, nearest_class, vehicle_classes

EGO = "Ego"
_MADE = datetime(2025, 1, 1, tzinfo=UTC)
"""A fixed date, because the current one would make every file differ."""
_CATEGORIES = {
    "car": "car",
    "taxi": "car",
    "parkedVehicle": "car",
    "priorityVehicle": "van",
    "truck": "truck",
    "bus": "bus",
    "motorcycle": "motorbike",
    "bicycle": "bicycle",
    "train": "train",
}
"""OpenSCENARIO's vehicle category by CommonRoad's obstacle type."""
_HEIGHT_M = {"truck": 3.5, "bus": 3.0, "pedestrian": 1.8, "bicycle": 1.7, "motorcycle": 1.5}
_USUAL_HEIGHT_M = 1.5
"""Usual heights, because CommonRoad has no heights (chosen)."""
_FASTEST_MPS, _HARDEST_MPS2 = 70.0, 12.0
"""Performance that no recorded vehicle exceeds (chosen): the file must state one."""


@dataclass(frozen=True)
class _Entity:
    """A road user: name, CommonRoad's kind, size, offset of its reference point behind its centre, its track."""

    name: str
    kind: str
    size_m: tuple[float, float]
    behind_m: float
    wheelbase_m: float
    track: Track

    def poses(self) -> Iterator[tuple[int, float, float, float]]:
        """Yield, for each state, the step, and the reference point's x and y in m and heading in rad."""
        rows = zip(self.track.positions.tolist(), self.track.headings_rad.tolist(), strict=True)
        for index, ((x, y), heading) in enumerate(rows):
            ahead = self.behind_m
            yield self.track.first_step + index, x - ahead * math.cos(heading), y - ahead * math.sin(heading), heading


def write_openscenario(request: ForeignExportRequest, report: ProgressReporter) -> ForeignExport:
    """Write the recording of a scenario; the roads are in the file ``request.roads`` next to it.

    Raises:
        UnsafeInput: the scenario's file is broken.
    """
    report(0.1, "reading the scenario")
    loaded = read_scenario(Path(request.scenario_path))
    report(0.3, "writing the trajectories")
    root = _document(loaded, request.roads)
    etree.indent(root, space=" ")
    Path(request.target_path).write_bytes(etree.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n")
    return ForeignExport(path=request.target_path, lost=_lost(loaded))


def _document(loaded: LoadedScenario, roads: str) -> etree._Element:
    from scenariogeneration import xosc

    moving = [_entity(track) for track in loaded.tracks.values()]
    last = last_recorded_step(loaded.scenario)
    standing = [_entity(track) for track in static_tracks(loaded.scenario, last).values()]
    entities, init = xosc.Entities(), xosc.Init()
    for one in (*moving, *standing):
        entities.add_scenario_object(
            one.name, _described(one.name, one.kind, one.size_m, one.behind_m, one.wheelbase_m)
        )
        _, x, y, heading = next(one.poses())
        init.add_init_action(one.name, xosc.TeleportAction(xosc.WorldPosition(x, y, 0, heading)))
        _add_speed(init, one.name, float(one.track.speeds_mps[0]))
    _add_ego(loaded, entities, init)
    _add_friction(loaded, init)
    end_s = last * loaded.step_s
    stop = xosc.ValueTrigger(
        "end", 0, xosc.ConditionEdge.none, xosc.SimulationTimeCondition(end_s, xosc.Rule.greaterThan), "stop"
    )
    story = xosc.StoryBoard(init, stop)
    act = xosc.Act("recording", _at_the_start())
    for one in moving:
        if len(one.track.positions) > 1:
            act.add_maneuver_group(_following(one, loaded.step_s))
    if any(len(one.track.positions) > 1 for one in moving):
        story.add_act(act)
    scenario = xosc.Scenario(
        one_line(loaded.benchmark_id),
        "PlannerForge",
        xosc.ParameterDeclarations(),
        entities,
        story,
        xosc.RoadNetwork(roadfile=roads),
        xosc.Catalog(),
        osc_minor_version=2,
        creation_date=_MADE,
    )
    return etree.fromstring(_text(scenario.get_element()))


def _text(element: Any) -> bytes:
    """Return the tree of scenariogeneration (ElementTree) as bytes."""
    from xml.etree.ElementTree import tostring

    return bytes(tostring(element))


def _entity(track: Track) -> _Entity:
    known = nearest_class(track.kind, track.length_m) if track.kind in _CATEGORIES else None
    scale = 0.0 if known is None else track.length_m / known.length_m
    behind, wheelbase = (0.0, 0.0) if known is None else (known.rear_axle_m * scale, known.wheelbase_m * scale)
    return _Entity(f"{track.kind}_{track.obstacle_id}", track.kind, track.size_m, behind, wheelbase, track)


def _described(name: str, kind: str, size_m: tuple[float, float], behind_m: float, wheelbase_m: float) -> Any:
    from scenariogeneration import xosc

    height = _HEIGHT_M.get(kind, _USUAL_HEIGHT_M)
    box = xosc.BoundingBox(size_m[1], size_m[0], height, behind_m, 0, height / 2)
    if kind == "pedestrian":
        return xosc.Pedestrian(name, 75, xosc.PedestrianCategory.pedestrian, box, model="pedestrian")
    if kind not in _CATEGORIES:
        return xosc.MiscObject(name, 1000, xosc.MiscObjectCategory.obstacle, box)
    axles = [xosc.Axle(0.6, 0.6, size_m[1] * 0.85, wheelbase_m, 0.3), xosc.Axle(0.0, 0.6, size_m[1] * 0.85, 0.0, 0.3)]
    category = xosc.VehicleCategory[_CATEGORIES[kind]]
    return xosc.Vehicle(name, category, box, *axles, _FASTEST_MPS, _HARDEST_MPS2, _HARDEST_MPS2)


def _add_speed(init: Any, name: str, speed_mps: float) -> None:
    from scenariogeneration import xosc

    at_once = xosc.TransitionDynamics(xosc.DynamicsShapes.step, xosc.DynamicsDimension.time, 0)
    init.add_init_action(name, xosc.AbsoluteSpeedAction(speed_mps, at_once))


def _add_ego(loaded: LoadedScenario, entities: Any, init: Any) -> None:
    """Add the ego of the first planning problem with its class, at its initial state."""
    from scenariogeneration import xosc

    if not loaded.planning_problems.planning_problem_dict:
        return
    problem = loaded.problem()
    state, name = problem.initial_state, loaded.ego_class(int(problem.planning_problem_id))
    (x, y), heading = (float(value) for value in center_of(state.position)), middle_of(state.orientation)
    axles, size_m = vehicle_classes()[name], ego_class(name).vehicle.size_m
    behind = axles.rear_axle_m
    entities.add_scenario_object(EGO, _described(EGO, axles.commonroad_type, size_m, behind, axles.wheelbase_m))
    place = xosc.WorldPosition(x - behind * math.cos(heading), y - behind * math.sin(heading), 0, heading)
    init.add_init_action(EGO, xosc.TeleportAction(place))
    _add_speed(init, EGO, float(middle_of(state.velocity)))


def _add_friction(loaded: LoadedScenario, init: Any) -> None:
    """Add the friction of the roads, relative to the friction of a dry road."""
    from scenariogeneration import xosc

    if loaded.friction is not None:
        road = xosc.RoadCondition(round(loaded.friction / ROAD_FRICTIONS["dry"], 4))
        init.add_global_action(xosc.EnvironmentAction(xosc.Environment("roads", roadcondition=road)))


def _following(one: _Entity, step_s: float) -> Any:
    """Return the manoeuvre of an entity: along its recorded poses, at their times."""
    from scenariogeneration import xosc

    rows = list(one.poses())
    times = [round(step * step_s, 9) for step, *_ in rows]
    places = [xosc.WorldPosition(x, y, 0, heading) for _, x, y, heading in rows]
    trajectory = xosc.Trajectory(f"track of {one.name}", False)
    trajectory.add_shape(xosc.Polyline(times, places))
    action = xosc.FollowTrajectoryAction(trajectory, xosc.FollowingMode.position, xosc.ReferenceContext.absolute, 1, 0)
    event = xosc.Event(f"{one.name} follows", xosc.Priority.override)
    event.add_action(f"{one.name} follows its track", action)
    event.add_trigger(_at_the_start())
    manoeuvre = xosc.Maneuver(f"{one.name} drives")
    manoeuvre.add_event(event)
    group = xosc.ManeuverGroup(f"{one.name} alone")
    group.add_actor(one.name)
    group.add_maneuver(manoeuvre)
    return group


def _at_the_start() -> Any:
    from scenariogeneration import xosc

    begun = xosc.SimulationTimeCondition(0, xosc.Rule.greaterOrEqual)
    return xosc.ValueTrigger("start", 0, xosc.ConditionEdge.none, begun)


def _lost(loaded: LoadedScenario) -> tuple[str, ...]:
    late = sum(track.first_step > 0 for track in loaded.tracks.values())
    without = len(loaded.scenario.dynamic_obstacles) - len(loaded.tracks)
    goals = sum(len(problem.goal.state_list) for problem in loaded.planning_problems.planning_problem_dict.values())
    more = len(loaded.planning_problems.planning_problem_dict) - 1
    counts = (
        (goals, "goal", " of the ego (the format has no goals)"),
        (more, "more planning problem", ""),
        (late, "road user", " entering later (at its first pose from the start)"),
        (without, "obstacle", " without a trajectory"),
        (len(loaded.scenario.lanelet_network.traffic_lights), "traffic light", ""),
    )
    return tuple(f"{counted(count, what)}{words}" for count, what, words in counts if count > 0)
