"""The content of players as whole numbers: centimetres, milliradians and differences, so that pages stay small.

Text of scenarios and runs is untrusted: this module reduces it to one printable line, ``pages.py`` escapes it, and the
page's scripts only ever set it as text.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....schemas.measures import metric_words
from ....schemas.planning import RunPlans
from ....schemas.rendering import ViewPane, ViewRequest
from ....schemas.results import with_unit
from ....schemas.reviews import RunReview
from ....schemas.runs import ReviewRequest, RunSeries, RunSource, ScenarioSource, ending
from ....schemas.text import measured, one_line
from ...analysis import METRICS, Course, RunSet, course_of, read_series, read_steps, review_runs
from ...commonroad import Track, kept_recording
from ...execution import silent
from ...geometry import Points, Values, length_m, point_at
from ..content import DrivenPath, LaneletShape, ScenarioContent, Viewport, content_of, driven_path
from ..road import dividers, outer_edges
from .data import (
    AreaView,
    DriveView,
    LaneletView,
    Line,
    MomentView,
    PaneView,
    PlanView,
    PlayerView,
    RoadView,
    SceneView,
    SignalView,
    StandingView,
    TrackView,
)

_MOST_SAMPLES = 300_000
"""Most states of road users in a scene, about 4 MB; beyond it, only every second, third … step is kept (chosen)."""
_MOST_ROAD_POINTS = 150_000
"""Most points of roads in a scene, about 1 MB; beyond it, lines are drawn more coarsely (chosen)."""
_FINEST_M = 0.02
"""Deviation of a drawn line from the file's, less than a pixel at any useful zoom (chosen)."""
_ARROW_EVERY_M, _SHORTEST_WITH_ARROW_M = 30.0, 8.0
"""Spacing of the direction marks along a lanelet, and the shortest lanelet with a mark (chosen)."""
_EGO_ID = 0
"""The ego's id among road users; obstacle ids are positive."""
LONGEST_SENTENCE = 400
"""Most characters of a sentence in a view (chosen)."""


def player_view(request: ViewRequest) -> PlayerView:
    """Return the data of a player; panes that show the same scenario share its scene.

    Raises:
        UnsafeInput: The file of a scenario cannot be read.
        ResourceFailure: The steps of a run cannot be read.
    """
    contents = {one.scenario.scenario_id: read_content(one.scenario) for one in request.panes}
    notes, panes = list[str](), list[PaneView]()
    paths: dict[str, list[DrivenPath]] = {key: [] for key in contents}
    for pane in request.panes:
        key = pane.scenario.scenario_id
        drive = None
        if pane.run is not None:
            path = driven_path(pane.run)
            if path is None:
                notes.append(f"{pane.run.record.run_id} has no driven states: {_ending(pane.run, None)}")
            else:
                paths[key].append(path)
                drive = drive_view(pane.run, path, pane.scenario, contents[key].origin)
                plans = tuple(_plans(pane.plans_path, contents[key].origin))
                drive = drive.model_copy(update={"plans": plans})
        if pane.note:
            notes.append(one_line(pane.note, LONGEST_SENTENCE))
        panes.append(PaneView(title=pane_title(pane), scenario_id=one_line(key), drive=drive))
    scenes = []
    for key, content in contents.items():
        scene, scene_notes = scene_view(content, paths[key])
        scenes.append(scene)
        notes += scene_notes
    return PlayerView(title=one_line(request.title), scenes=tuple(scenes), panes=tuple(panes), notes=tuple(notes))


def pane_title(pane: ViewPane) -> str:
    """Return the title of a pane: the run's configuration, or the scenario."""
    return one_line(pane.scenario.scenario_id if pane.run is None else pane.run.record.config_name)


@dataclass(frozen=True)
class _Placed:
    """The content of a scenario, and the origin (2,) in m of its view."""

    content: ScenarioContent
    origin: Points


def read_content(source: ScenarioSource) -> _Placed:
    """Return the content of a scenario's file; its origin is a whole number of metres.

    Raises:
        UnsafeInput: The file cannot be read.
    """
    content = content_of(kept_recording(Path(source.path)))
    viewport = Viewport.of(content)
    return _Placed(content, np.round(viewport.middle))


def scene_view(placed: _Placed, paths: Sequence[DrivenPath] = ()) -> tuple[SceneView, list[str]]:
    """Return a scenario in the player's format, and notes on what is left out."""
    content, origin = placed.content, placed.origin
    viewport = Viewport.of(content, paths, content.ego_step)
    low, high = _cm(np.array([[viewport.x_min, viewport.y_min], [viewport.x_max, viewport.y_max]]) - origin)
    samples = sum(len(track.positions) for track in content.tracks.values())
    stride = -(-samples // _MOST_SAMPLES) if samples else 1
    notes = [f"{content.scenario_id}: only every {stride}th traffic step is kept"] if stride > 1 else []
    scene = SceneView(
        scenario_id=one_line(content.scenario_id),
        step_s=content.step_s,
        origin_m=(float(origin[0]), float(origin[1])),
        first_step=min([content.ego_step, *(track.first_step for track in content.tracks.values())]),
        last_step=max([content.last_step, *(path.last_step for path in paths)]),
        shown_cm=(int(low[0]), int(low[1]), int(high[0]), int(high[1])),
        road=_road(content, origin),
        tracks=tuple(track_view(track, origin, stride) for track in content.tracks.values()),
        start=_start(content, origin),
    )
    return scene, notes


def _cm(metres: Points | Values) -> NDArray[np.int64]:
    return np.rint(np.asarray(metres) * 100).astype(np.int64)


def _differences(values: NDArray[np.int64]) -> tuple[int, ...]:
    """Return the first value, followed by the differences between consecutive values."""
    return tuple(np.diff(values, prepend=0).tolist())


def _line(points: Points, origin: Points, tolerance_m: float = _FINEST_M) -> Line:
    import shapely

    thin = shapely.LineString(points).simplify(tolerance_m, preserve_topology=False) if len(points) > 2 else None
    return _sent(np.asarray(points if thin is None or thin.is_empty else thin.coords), origin)


def _sent(points: Points, origin: Points) -> Line:
    return tuple(np.diff(_cm(points - origin), axis=0, prepend=[[0, 0]]).ravel().tolist())


def track_view(track: Track, origin: Points, stride: int = 1, *, driven: bool = False) -> TrackView:
    """Return a road user's motion, every ``stride`` steps."""
    kept = slice(None, None, stride)
    place = _cm(track.positions[kept] - origin)
    return TrackView(
        obstacle_id=track.obstacle_id,
        kind=one_line(track.kind),
        length_cm=round(100 * track.length_m),
        width_cm=round(100 * track.width_m),
        first_step=track.first_step,
        stride=stride,
        x_cm=_differences(place[:, 0]),
        y_cm=_differences(place[:, 1]),
        heading_mrad=_differences(np.rint(np.unwrap(track.headings_rad[kept]) * 1000).astype(np.int64)),
        speed_cmps=_differences(_cm(track.speeds_mps[kept])),
        driven=driven,
    )


def _start(content: ScenarioContent, origin: Points) -> TrackView | None:
    if content.ego_position is None:
        return None
    start = Track(
        obstacle_id=_EGO_ID,
        kind=content.ego_class,
        length_m=content.ego_size_m[0],
        width_m=content.ego_size_m[1],
        first_step=content.ego_step,
        positions=content.ego_position[None, :],
        headings_rad=np.array([content.ego_heading_rad]),
        speeds_mps=np.array([content.ego_speed_mps]),
    )
    return track_view(start, origin)


def _road(content: ScenarioContent, origin: Points) -> RoadView:
    plain = [lanelet for lanelet in content.lanelets if not lanelet.inside_intersection]
    sides = [side for one in plain for side in ((one.left, one.left_neighbour), (one.right, one.right_neighbour))]
    edges = list(_joined(outer_edges([line for line, neighbour in sides if neighbour is None], content.lanelets)))
    between = list(dividers(plain))
    points = sum(len(one.left) + len(one.right) for one in content.lanelets) + sum(map(len, edges + between))
    tolerance_m = _FINEST_M * max(1.0, points / _MOST_ROAD_POINTS)

    def lines(many: Iterable[Points]) -> tuple[Line, ...]:
        return tuple(_line(points, origin, tolerance_m) for points in many)

    return RoadView(
        lanelets=tuple(
            LaneletView(lanelet_id=one.lanelet_id, outline=_line(one.outline, origin, tolerance_m))
            for one in content.lanelets
        ),
        edges=lines(edges),
        dividers=lines(between),
        arrows=tuple(number for lanelet in plain for number in _arrows(lanelet, origin)),
        stop_lines=lines(content.stop_lines),
        pavements=lines(content.pavements),
        crossings=lines(content.crossings),
        goals=lines(content.goals),
        signals=tuple(_signals(content, origin)),
        standing=tuple(
            StandingView(obstacle_id=one.vehicle_id, kind=one_line(one.kind), outline=_line(one.corners, origin, 0.0))
            for one in content.standing
        ),
    )


def _joined(pieces: Sequence[Points]) -> Iterable[Points]:
    """Join consecutive pieces (2, 2) into lines."""
    line: list[Points] = []
    for piece in pieces:
        if line and not np.array_equal(line[-1], piece[0]):
            yield np.array(line)
            line = []
        line += [piece[0], piece[1]] if not line else [piece[1]]
    if line:
        yield np.array(line)


def _arrows(lanelet: LaneletShape, origin: Points) -> Iterable[int]:
    length = length_m(lanelet.center)
    if length < _SHORTEST_WITH_ARROW_M:
        return
    count = max(int(length / _ARROW_EVERY_M), 1)
    for station in (np.arange(count) + 0.5) * length / count:
        point, heading = point_at(lanelet.center, float(station))
        x, y = _cm(point - origin)
        yield from (int(x), int(y), round(1000 * heading))


def _signals(content: ScenarioContent, origin: Points) -> Iterable[SignalView]:
    for signal in content.signals:
        x, y = _cm(signal.position - origin)
        phases = [(state, len(list(group))) for state, group in groupby(signal.cycle)]
        yield SignalView(
            signal_id=signal.signal_id,
            x_cm=int(x),
            y_cm=int(y),
            states=tuple(state for state, _ in phases),
            steps=tuple(count for _, count in phases),
            offset=signal.offset,
        )


def drive_view(source: RunSource, path: DrivenPath, scenario: ScenarioSource, origin: Points) -> DriveView:
    """Return the data of a run over a scene, with its nearest road users and its moments."""
    record, steps = source.record, read_steps(source)
    if steps is None:
        raise ValueError(f"{record.run_id} was driven, so it has steps")
    runs = RunSet((source,), scenarios=(scenario,))
    course = course_of(runs, record)
    review = review_runs(ReviewRequest(runs=(source,), scenarios=(scenario,)), silent).reviews[0]
    ego = Track(
        obstacle_id=_EGO_ID,
        kind=record.ego_class,
        length_m=record.ego_length_m,
        width_m=record.ego_width_m,
        first_step=path.first_step,
        positions=path.positions,
        headings_rad=path.headings_rad,
        speeds_mps=path.speeds_mps,
    )
    costs = {name: tuple(round(value, 4) for value in values) for name, values in steps.costs.items() if any(values)}
    hit = record.collision
    return DriveView(
        run_id=record.run_id,
        config_id=record.config_id,
        name=one_line(record.config_name),
        outcome=record.outcome,
        ending=_ending(source, review),
        prediction=record.prediction,
        traffic=record.traffic,
        ego=track_view(ego, origin),
        acceleration_cmps2=_differences(_cm(np.asarray(steps.acceleration_mps2))),
        **_nearness(course),
        plan_steps=steps.plan_steps,
        costs={one_line(name): values for name, values in costs.items()},
        rejected={one_line(name): counts for name, counts in steps.rejected.items() if any(counts)},
        collision_step=None if hit is None or hit.obstacle_id is None else hit.step,
        collision_id=None if hit is None else hit.obstacle_id,
        moments=tuple(_moments(source, review, path.first_step)),
        figures=tuple(figures(source)),
        others=tuple(track_view(track, origin, driven=True) for track in path.others.values()),
        **_over_time(read_series(source), origin),
    )


def _over_time(series: RunSeries | None, origin: Points) -> dict[str, Any]:
    """Return the series of a run as fields of ``DriveView``; empty for a run that was stored without them."""
    if series is None:
        return {}
    degrees = 180 / math.pi
    states = {
        "lateral offset (m)": series.lateral_offset_m,
        "heading error (°)": tuple(round(degrees * value, 2) for value in series.heading_error_rad),
        "steering (°)": tuple(round(degrees * value, 2) for value in series.steering_rad),
    }
    planned = {"desired speed (m/s)": series.desired_speed_mps, **series.numbers}
    reasons = {"reason for desired speed": series.desired_speed_reasons}
    areas = [
        AreaView(step=one.step, name=one_line(one.name), outline=_sent(np.column_stack([one.x_m, one.y_m]), origin))
        for one in series.polygons
    ]
    return {
        "series": {name: values for name, values in states.items() if values},
        "planned": {one_line(name): values for name, values in planned.items() if values},
        "told": {one_line(name): values for name, values in (reasons | series.texts).items() if values},
        "areas": tuple(areas),
    }


def _plans(path: str, origin: Points) -> Iterable[PlanView]:
    """Yield the plans of a run from its file, if there is one."""

    def line(numbers: Sequence[float]) -> Line:
        return _sent(np.reshape(numbers, (-1, 2)), origin)

    plans = RunPlans.model_validate_json(Path(path).read_bytes()).plans if path else ()
    for one in plans:
        yield PlanView(
            step=one.step,
            plan=line(one.plan),
            candidates=tuple(map(line, one.candidates)),
            predictions=tuple(map(line, one.predictions)),
        )


def _ending(source: RunSource, review: RunReview | None) -> str:
    record = source.record
    return one_line(ending(record.outcome, record.reason, review), LONGEST_SENTENCE)


def _nearness(course: Course | None) -> dict[str, tuple[int | None, ...]]:
    if course is None:
        return {"gap_cm": (), "nearest": (), "collision_cs": ()}

    def hundredths(values: Values) -> tuple[int | None, ...]:
        return tuple(None if np.isnan(value) else round(100 * value) for value in values.tolist())

    return {
        "gap_cm": hundredths(course.gap_m),
        "nearest": tuple(None if key < 0 else key for key in course.obstacle_ids),
        "collision_cs": hundredths(course.time_to_collision_s),
    }


def _moments(source: RunSource, review: RunReview, first_step: int) -> Iterable[MomentView]:
    """Return the moments of a run in order of time; the decisive one is the contact, otherwise the closest
    encounter.
    """
    record = source.record

    def step(time_s: float) -> int:
        return first_step + round(time_s / record.step_s)

    found = []
    if record.collision is not None:
        words = record.collision.kind if review.contact is None else review.contact.in_words()
        found.append(MomentView(step=record.collision.step, words=words, decisive=True))
    if (near := review.closest) is not None:
        words = f"closest: {near.gap_m:.2f} m to {near.other} {near.place}"
        found.append(MomentView(step=step(near.time_s), words=words, decisive=record.collision is None))
    if (urgent := review.most_urgent) is not None:
        words = f"shortest time to collision: {urgent.time_to_collision_s:.2f} s with {urgent.other} {urgent.place}"
        found.append(MomentView(step=step(urgent.time_s), words=words))
    found += [
        MomentView(step=step(one.time_s), words=f"largest {one.name}: {one.value:.2f} {one.unit}")
        for one in review.largest
    ]
    found += [MomentView(step=step(one.time_s), words=one.in_words()) for one in review.uncomfortable]
    printed = [one.model_copy(update={"words": one_line(one.words, LONGEST_SENTENCE)}) for one in found]
    return sorted(printed, key=lambda moment: moment.step)


def figures(source: RunSource) -> Iterable[tuple[str, str]]:
    """Yield each defined metric of a run, as its name in words and its value with the unit."""
    for metric in METRICS:
        value = metric.value(source.record)
        if value is not None:
            yield metric_words(metric.name), with_unit(measured(value), metric.unit)
