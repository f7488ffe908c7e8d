"""Edits without files: the scenario that ``apply_edits`` would write and a run would read back, with the same values.

A search edits one scenario thousands of times, and most of the time of an edit goes into XML. Here, only the touched
road users are created again, as arrays; all others, the road and the scene are those of the base. Values are rounded as
``writing.py`` rounds them, so a run is the same bit for bit. A goal is written and read once.

Edits of the whole scene (``world.TRANSFORMS``) and obstacles that the file describes by regions or intervals need the
file: :class:`NeedsFile` says so, before anything is simulated.
"""

import copy
import math
import tempfile
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...schemas.modification import Edit, ModificationRequest
from ..commonroad import EditedMotions, LoadedScenario, PlainStates, ScenarioDocument, Track, read_recorded
from ..cosimulation import SimulationSetup
from ..geometry import Points, Values, wrap_angle
from ..scene import Ego
from ..vehicles import Motion
from .apply import NET_FILE, ego_of_base, resolved_edits, simulated_edits
from .changes import FEWEST_STATES, Changes, GoalChange
from .edited_scene import SimulatedEdits
from .report import infeasible_vehicles
from .scene_cache import KeptScene, scene_of
from .world import TRANSFORMS
from .writing import AT_REST, DECIMALS, replayed_motion, starts_elsewhere, write_goal

if TYPE_CHECKING:
    from commonroad.planning.planning_problem import PlanningProblemSet

_WORTH_CUTTING = 2
"""A simulation is cut at the horizon if the recording is at least this many times as long (chosen): failures are then
simulated again in full.
"""
_HELD_GOALS = 64
"""Goals that a base keeps (chosen); a search has one or a few."""


class NeedsFile(Exception):
    """These edits can only be applied with files."""


@dataclass(frozen=True)
class EditedScenario:
    """A scenario after edits, in memory.

    ``loaded``: the scenario as a run reads it. ``simulated``: the edits after their simulation. ``infeasible``: the
    touched vehicles with a motion that a vehicle of their class cannot drive, by ascending id. ``is_cut``: whether
    simulated motions end before the recording does.
    """

    loaded: LoadedScenario
    simulated: SimulatedEdits
    infeasible: tuple[int, ...]
    is_cut: bool = False


@dataclass
class EditableScenario:
    """A base scenario that can be edited in memory any number of times. The folder holds SUMO's network.

    Use it in a ``with`` block. ``horizon_s``: how long after the ego's start the motion of simulated vehicles is
    needed; None means up to the end of the recording, as does a horizon that would save less than half of it. A shorter
    simulation does not show what a vehicle would hit later, for which ``edited`` might change its motion before.
    """

    xml: Path
    problem_id: int | None = None
    seed: int = 0
    horizon_s: float | None = None
    _goals: dict[str, "PlanningProblemSet"] = field(default_factory=dict)

    def __enter__(self) -> "EditableScenario":
        """Read the scenario and lay out its network."""
        self._folder = tempfile.TemporaryDirectory()
        self._kept: KeptScene = scene_of(self.xml, self.problem_id)
        self._first_id = ScenarioDocument.read(self.xml).highest_id + 1
        scene = self._kept.scene
        net = Path(self._folder.name) / NET_FILE
        net.write_text(scene.sumo_net, encoding="utf-8")
        self._setup = SimulationSetup(net, net.parent, scene.step_s, scene.last_step, self.seed)
        self._needed_step = scene.last_step
        if self.horizon_s is not None and scene.ego is not None:
            end = scene.ego.step + math.ceil(self.horizon_s / scene.step_s)
            if _WORTH_CUTTING * end <= scene.last_step:
                self._needed_step = end
        return self

    def __exit__(self, *_: object) -> None:
        """Remove the folder."""
        self._folder.cleanup()

    @property
    def loaded(self) -> LoadedScenario:
        """The scenario without edits."""
        return self._kept.scene.loaded

    def edited(self, edits: tuple[Edit, ...], *, whole: bool = False) -> EditedScenario:
        """Return the scenario after edits; either all edits are applied or an error is raised.

        ``whole``: simulate up to the end of the recording, whatever the horizon.

        Raises:
            NeedsFile: the edits can only be applied with files.
            InvalidRequest: an edit is not valid, or the scenario does not allow it.
            NotPossible: a vehicle would enter at an occupied position, or road users other than the ego would collide.
        """
        if any(edit.op in TRANSFORMS for edit in edits):
            raise NeedsFile
        base = self._kept.scene
        request = ModificationRequest(
            xml=self.xml,
            edits=edits,
            benchmark_id="",
            output=Path(self._folder.name),
            problem_id=self.problem_id,
            on_conflict="refuse",
            dry_run=True,
            seed=self.seed,
        )
        start = Changes(next_id=self._first_id, driven={}, ego_drive=partial(ego_of_base, self._kept, self._setup))
        resolved = resolved_edits(edits, base, start)
        setup = self._setup if whole else self._until_needed(resolved.changes)
        simulated = simulated_edits(request, self._kept, setup, start, resolved, reports_ego=False)
        is_cut = bool(simulated.result.plans) and setup.last_step < base.last_step
        return EditedScenario(self._loaded_after(simulated), simulated, infeasible_vehicles(simulated), is_cut)

    def _until_needed(self, changes: Changes) -> SimulationSetup:
        """Return the simulation up to the needed step, or until every driven vehicle has begun to drive."""
        begun = max((plan.from_step + FEWEST_STATES for plan in changes.driven.values()), default=0)
        return replace(self._setup, last_step=min(max(self._needed_step, begun), self._setup.last_step))

    def _loaded_after(self, edited: SimulatedEdits) -> LoadedScenario:
        base, changes, result = self.loaded, edited.changes, edited.result
        touched = _Touched(base)
        for key in changes.removed:
            touched.removed.add(key)
        for replay in changes.replays.values():
            if replay.is_parked:
                touched.park(replay.track)
            elif replay.recording is None:
                touched.add(replay.track, replayed_motion(replay.track, base.step_s))
            elif replay.shifted_steps:
                touched.move(replay.track)
            else:
                motion = replayed_motion(replay.track, base.step_s)
                begin = max(replay.from_step - replay.track.first_step + 1, 0)
                touched.change(replay.track, motion, begin, 0)
        for key, track in result.tracks.items():
            if result.plans[key].cause == "added":
                touched.add(track, track.motion)
            else:
                known = touched.tracks.get(key) or base.tracks[key]
                touched.change(track, track.motion, track.first_step - known.first_step + 1, 1)
        return replace(
            touched.loaded(),
            planning_problems=self._problems_after(changes),
            ego_classes=_ego_classes(base, changes.ego),
            edited=_motions(base, edited),
        )

    def _problems_after(self, changes: Changes) -> "PlanningProblemSet":
        problems = self.loaded.planning_problems
        if changes.goal is not None:
            problems = self._with_goal(changes.goal)
        if changes.ego is None or not starts_elsewhere(changes.ego, self.loaded):
            return problems
        new = copy.copy(problems)
        own = copy.copy(new.find_planning_problem_by_id(changes.ego.problem_id))
        own.initial_state = _start_state(own.initial_state, changes.ego)
        new._planning_problem_dict = {**problems.planning_problem_dict, changes.ego.problem_id: own}
        return new

    def _with_goal(self, goal: GoalChange) -> "PlanningProblemSet":
        """Return the planning problems with a new goal; the base is written with it and read once for each goal."""
        key = repr(
            (
                goal.problem_id,
                goal.center.tolist(),
                goal.heading_rad,
                goal.size_m,
                goal.steps,
                goal.speed_mps,
                goal.keeps_place,
            )
        )
        if key not in self._goals:
            document = ScenarioDocument.read(self.xml)
            write_goal(document, goal)
            path = Path(self._folder.name) / "goal.xml"
            document.write(path, self.loaded.benchmark_id)
            if len(self._goals) >= _HELD_GOALS:
                self._goals.clear()
            self._goals[key] = read_recorded(path).loaded.planning_problems
        return self._goals[key]


def _motions(base: LoadedScenario, edited: SimulatedEdits) -> EditedMotions:
    """Return what edits prescribe, together with what the base already states."""
    changes, result = edited.changes, edited.result
    ordered = {key for key, plan in result.plans.items() if plan.manoeuvres or plan.ignores_lights}
    scripted = {key for key, replay in changes.replays.items() if replay.is_scripted}
    new = [replay.script.text() for replay in changes.replays.values() if replay.script is not None]
    without = changes.removed | changes.replays.keys() | result.tracks.keys()
    kept = [text for text in base.script_texts if not any(f'"id":{key},' in text for key in without)]
    return EditedMotions(base.prescribed_ids | ordered | scripted, (*kept, *new))


def _ego_classes(base: LoadedScenario, ego: Ego | None) -> dict[int, str]:
    classes = dict(base.ego_classes)
    if ego is not None:
        classes.pop(ego.problem_id, None)
        if ego.vehicle_class != "car":
            classes[ego.problem_id] = ego.vehicle_class
    return classes


def _start_state(state: Any, ego: Ego) -> Any:
    """Return an initial state with a new start of the ego; values that the old state lacks stay absent."""
    new = copy.copy(state)
    new.position = _rounded(np.asarray(ego.position, dtype=np.float64))
    values = {"orientation": ego.heading_rad, "velocity": ego.speed_mps, **dict.fromkeys(AT_REST, 0.0)}
    for name, value in values.items():
        attribute = {"yawRate": "yaw_rate", "slipAngle": "slip_angle"}.get(name, name)
        if getattr(state, attribute, None) is not None:
            setattr(new, attribute, round(value, DECIMALS) + 0.0)
    return new


@dataclass
class _Touched:
    """The road users that edits touch, as a run reads them from the written file."""

    base: LoadedScenario
    removed: set[int] = field(default_factory=set)
    tracks: dict[int, Track] = field(default_factory=dict)
    obstacles: dict[int, Any] = field(default_factory=dict)
    parked: dict[int, Any] = field(default_factory=dict)

    def add(self, track: Track, motion: Motion) -> None:
        """Add a road user with a new motion."""
        written = _written(motion)
        size = round(track.length_m, DECIMALS), round(track.width_m, DECIMALS)
        new = replace(track, length_m=size[0], width_m=size[1], **written)
        self.tracks[track.obstacle_id] = _plain(new)
        self.obstacles[track.obstacle_id] = _obstacle(new, _shape(size), track.kind)

    def move(self, track: Track) -> None:
        """Give a road user its recording, moved in time, with unchanged values."""
        old = self._obstacle(track.obstacle_id)
        self.tracks[track.obstacle_id] = track
        self.obstacles[track.obstacle_id] = _obstacle(track, old.obstacle_shape, track.kind)

    def change(self, track: Track, motion: Motion, keeps: int, begin: int) -> None:
        """Give a road user a new motion after its first ``keeps`` states.

        ``begin``: the index of the motion's first state to use; 0 if the motion has a state for each state of the
        recording.
        """
        key = track.obstacle_id
        old, known = self._obstacle(key), self.tracks.get(key) or self.base.tracks[key]
        if key not in self.tracks:
            self._check_plain(key)
        keeps = min(keeps, len(known.positions))
        written = {name: values[keeps if begin == 0 else begin :] for name, values in _written(motion).items()}
        body = known.kind, known.size_m
        resized = begin == 0 and (track.kind, track.size_m) != body
        size = (round(track.length_m, DECIMALS), round(track.width_m, DECIMALS)) if resized else known.size_m
        kind = track.kind if resized else known.kind
        new = Track(
            obstacle_id=key,
            kind=kind,
            length_m=size[0],
            width_m=size[1],
            first_step=known.first_step,
            positions=np.concatenate([known.positions[:keeps], written["positions"]]),
            headings_rad=np.concatenate([known.headings_rad[:keeps], written["headings_rad"]]),
            speeds_mps=np.concatenate([known.speeds_mps[:keeps], written["speeds_mps"]]),
        )
        self.tracks[key] = new
        self.obstacles[key] = _obstacle(new, _shape(size) if resized else old.obstacle_shape, kind)

    def park(self, track: Track) -> None:
        """Add a parked vehicle."""
        from commonroad.scenario.obstacle import ObstacleType, StaticObstacle

        size = round(track.length_m, DECIMALS), round(track.width_m, DECIMALS)
        heading = round(wrap_angle(float(track.headings_rad[0])), DECIMALS) + 0.0
        state = _initial_state(0, _rounded(track.positions[0]), heading, 0.0)
        kind = ObstacleType(track.kind)
        self.parked[track.obstacle_id] = StaticObstacle(track.obstacle_id, kind, _shape(size), state)

    def _obstacle(self, key: int) -> Any:
        return self.obstacles.get(key) or self.base.scenario.obstacle_by_id(key)

    def _check_plain(self, key: int) -> None:
        """Raise an error unless all states of a recording are points with exact headings and speeds."""
        states = self.base.plain_states.get(key)
        if states is None or "velocity" not in states.columns:
            raise NeedsFile

    def loaded(self) -> LoadedScenario:
        """Return the base with these road users."""
        base, scenario = self.base, copy.copy(self.base.scenario)
        dynamic = {key: one for key, one in scenario._dynamic_obstacles.items() if key not in self.removed}
        static = {key: one for key, one in scenario._static_obstacles.items() if key not in self.removed}
        scenario._dynamic_obstacles = {**dynamic, **self.obstacles}
        scenario._static_obstacles = {**static, **self.parked}
        tracks = {key: track for key, track in base.tracks.items() if key not in self.removed} | self.tracks
        states = {key: one for key, one in base.plain_states.items() if key not in self.removed}
        for key, track in self.tracks.items():
            columns = {"orientation": track.headings_rad[1:], "velocity": track.speeds_mps[1:]}
            states[key] = PlainStates(track.positions[1:], columns)
        new = replace(base, scenario=scenario, plain_states=states)
        vars(new)["tracks"] = dict(sorted(tracks.items()))  # the cached property, which would be computed anew
        return new


def _plain(track: Track) -> Track:
    """Return a track as the base class, without what a driven track has in addition."""
    return Track(
        track.obstacle_id,
        track.kind,
        track.length_m,
        track.width_m,
        track.first_step,
        track.positions,
        track.headings_rad,
        track.speeds_mps,
    )


def _rounded(values: Values | Points) -> Any:
    """Return values rounded as in a file; Python rounds correctly, NumPy does not always."""
    flat = [round(value, DECIMALS) + 0.0 for value in values.ravel().tolist()]
    return np.array(flat, dtype=np.float64).reshape(values.shape)


def _written(motion: Motion) -> dict[str, Any]:
    """Return the positions, headings and speeds of a motion, rounded as in a file."""
    wrapped = np.array([wrap_angle(heading) for heading in motion.headings_rad.tolist()])
    return {
        "positions": _rounded(motion.positions),
        "headings_rad": _rounded(wrapped),
        "speeds_mps": _rounded(motion.speeds_mps),
    }


def _shape(size_m: tuple[float, float]) -> Any:
    from commonroad.geometry.shape import Rectangle

    return Rectangle(*size_m)


def _initial_state(step: int, position: Points, heading_rad: float, speed_mps: float) -> Any:
    from commonroad.scenario.state import InitialState

    return InitialState(
        time_step=step,
        position=position,
        orientation=heading_rad,
        velocity=speed_mps,
        acceleration=0.0,
        yaw_rate=0.0,
        slip_angle=0.0,
    )


def _obstacle(track: Track, shape: Any, kind: str) -> Any:
    """Return a moving obstacle with its first and last states only, as ``read_recorded`` does."""
    from commonroad.prediction.prediction import TrajectoryPrediction
    from commonroad.scenario.obstacle import DynamicObstacle, ObstacleType
    from commonroad.scenario.state import CustomState
    from commonroad.scenario.trajectory import Trajectory

    def state(index: int) -> Any:
        return CustomState(
            time_step=track.first_step + index,
            position=track.positions[index],
            orientation=float(track.headings_rad[index]),
            velocity=float(track.speeds_mps[index]),
        )

    begin = _initial_state(
        track.first_step, track.positions[0], float(track.headings_rad[0]), float(track.speeds_mps[0])
    )
    prediction = None
    if len(track.positions) > 1:
        last = len(track.positions) - 1
        states = [state(index) for index in dict.fromkeys((1, last))]
        prediction = TrajectoryPrediction(Trajectory(track.first_step + 1, states), shape)
    return DynamicObstacle(track.obstacle_id, ObstacleType(kind), shape, begin, prediction)
