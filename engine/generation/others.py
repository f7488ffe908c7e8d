"""Finds or scripts the manoeuvre that a request wants from another road user: ``cut_in``, or ``cut_in:truck``.

SUMO's traffic is first searched for an ego that encounters the manoeuvre. If there is none, an edit with a prescribed
motion creates the manoeuvre. Either way, the computed features of the written file confirm it; searches use the same
features.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, product
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from ...schemas.errors import InvalidRequest
from ...schemas.generation import RequestedManoeuvre, SiteType
from ...schemas.modification import Edit, ModificationRequest
from ..commonroad import LoadedScenario, Track, kept_recording
from ..edits import SCENARIO_FILE, apply_edits
from ..execution import silent
from ..geometry import Points
from ..network import LaneletGraph
from ..scenarios import Manoeuvre, manoeuvres_met
from ..traffic import GeneratedVehicle
from ..vehicles import PEDESTRIAN, class_by_size, vehicle_classes
from .planning_problem import PlanningTask
from .writer import STEP_S, planning_problem_element

if TYPE_CHECKING:
    from commonroad.planning.planning_problem import PlanningProblem
    from commonroad.scenario.lanelet import LaneletNetwork

MOST_PAIRS = 10_000
"""Pairs of an ego and another road user examined in one draw of traffic, the egos nearest to the site first.

Chosen: covers all egos of usual traffic, about 50 of 200 vehicles. A pair takes about a millisecond, so five draws take
nearly a minute.
"""
MOST_TRIES = 12
"""Lists of edits tried for one request, over all draws of traffic (chosen): in dense traffic each takes up to 3.5 s."""
NEAREST = 4
"""Vehicles of the traffic that an edit is tried on, the nearest to the ego first (chosen)."""
BRAKES_MPS2 = 4.5
"""Most drivers brake harder than this for an unexpected object on the road (AASHTO, A Policy on Geometric Design, 2011:
stopping sight distance).
"""
BEGINS_S = 1.5
"""Time after the ego's start when a scripted leader brakes or changes lane (chosen)."""
GAPS_S = (1.5, 2.0, 2.5)
"""Time gaps tried in turn for an added leader; the largest is below a lead vehicle's headway of 3 s."""
CUT_IN_GAPS_S = (1.0, 2.0)
"""Time gaps tried in turn for a scripted cut-in."""
AHEAD_M = (10.0, 20.0, 35.0, 50.0)
"""Longitudinal distance from the ego's centre at which a cut-in vehicle is added in the next lane (chosen)."""
FASTEST_SHARE = 0.9
"""An added vehicle drives as fast as the ego, but at most this share of its class's maximum speed (chosen)."""
WALKS_S = (4.0, 6.0, 8.0)
"""The ego's travel times to the place at which an added pedestrian crosses (chosen)."""
LEAST_MPS = 3.0
"""An ego that starts slower does not come near what is scripted ahead of it (chosen)."""
LIKELY_AT: Mapping[str, tuple[SiteType, ...]] = MappingProxyType(
    {
        "cut_in": ("highway", "ramp"),
        "cut_out": ("highway", "ramp"),
        "merging": ("ramp",),
        "overtaking": ("highway",),
        "lead_brakes_hard": ("highway", "urban"),
        "crossing": ("intersection", "signalised_intersection"),
        "oncoming_turns": ("intersection", "signalised_intersection", "urban"),
    }
)
"""Types of sites at which others make a manoeuvre more often."""
_DOES = {
    "cut_in": "cuts in",
    "cut_out": "cuts out",
    "merging": "merges",
    "overtaking": "overtakes",
    "lead_brakes_hard": "brakes hard ahead",
    "crossing": "crosses",
    "oncoming_turns": "turns across from the oncoming side",
}


_STAND_IN = "; an ordinary driver in the ego's place does not collide"


def first_of(wanted: RequestedManoeuvre, met: Sequence[Manoeuvre], class_of: Callable[[int], str]) -> Manoeuvre | None:
    """Return the earliest manoeuvre that matches the requested manoeuvre, or None if there is no match."""
    fitting = [one for one in met if one.name == wanted.name]
    if wanted.vehicle_class is not None:
        fitting = [one for one in fitting if class_of(one.obstacle_id) == wanted.vehicle_class]
    return min(fitting, key=lambda one: (one.step, one.obstacle_id), default=None)


@dataclass(frozen=True)
class FoundManoeuvre:
    """The manoeuvre in a written file: road user, class and step; ``edits`` lists the edits that made it, if any."""

    name: str
    obstacle_id: int
    vehicle_class: str
    step: int
    edits: tuple[str, ...] = ()

    def in_words(self) -> str:
        """Return as text who does what and when, and whether the traffic or an edit causes it."""
        who = f"{self.vehicle_class} {self.obstacle_id} {_DOES[self.name]} at {self.step * STEP_S:.1f} s"
        if not self.edits:
            return f"{who}, in SUMO's traffic"
        return f"{who}, scripted because no traffic had it: {'; '.join(self.edits)}{_STAND_IN}"


class EgoChoice:
    """Finds the cars that meet a manoeuvre if they are the ego; examines up to ``MOST_PAIRS`` pairs.

    Args:
        path: a scenario with this traffic and any ego; only its lanes are used.
        others_of: returns the other road users for an ego, as the file would list them.
    """

    def __init__(self, path: Path, others_of: Callable[[PlanningTask], Sequence[GeneratedVehicle]]) -> None:
        self._loaded = kept_recording(path, keep=False).loaded
        self._graph = LaneletGraph.of(self._loaded.scenario.lanelet_network)
        self._others_of = others_of
        self._pairs = 0
        self._met: dict[str, tuple[tuple[Manoeuvre, ...], tuple[str, ...]]] = {}

    def happens(self, wanted: RequestedManoeuvre, task: PlanningTask) -> bool:
        """Return whether the ego of a task meets the manoeuvre; False if this ego is not among those examined."""
        key = task.ego.vehicle_id
        if key not in self._met:
            if self._pairs >= MOST_PAIRS:
                return False
            others = self._others_of(task)
            self._pairs += len(others)
            tracks = {number: _track(number, other) for number, other in enumerate(others)}
            problem = _problem(task, self._loaded.scenario.lanelet_network)
            met = manoeuvres_met(self._loaded, self._graph, tracks, problem, task.ego.vehicle_class.name)
            self._met[key] = met, tuple(other.vehicle_class.name for other in others)
        met, classes = self._met[key]
        return first_of(wanted, met, classes.__getitem__) is not None


def found_in(path: Path, wanted: RequestedManoeuvre, classes: dict[int, str]) -> FoundManoeuvre | None:
    """Return the manoeuvre in a written file, or None if it is not present.

    Args:
        path: the file.
        wanted: the manoeuvre.
        classes: our classes by obstacle id; other classes follow from type and size.
    """
    recorded = kept_recording(path)
    loaded, tracks = recorded.loaded, recorded.tracks

    def class_of(key: int) -> str:
        known = class_by_size(tracks[key].kind, tracks[key].length_m)
        return classes.get(key) or (known.name if known is not None else tracks[key].kind)

    one = first_of(wanted, _met(loaded, tracks), class_of)
    return None if one is None else FoundManoeuvre(one.name, one.obstacle_id, class_of(one.obstacle_id), one.step)


def _met(loaded: LoadedScenario, tracks: dict[int, Track]) -> tuple[Manoeuvre, ...]:
    problem = loaded.problem()
    graph = LaneletGraph.of(loaded.scenario.lanelet_network)
    return manoeuvres_met(loaded, graph, tracks, problem, loaded.ego_class(int(problem.planning_problem_id)))


def _track(key: int, vehicle: GeneratedVehicle) -> Track:
    motion, (length_m, width_m) = vehicle.motion, vehicle.size_m
    kind = vehicle.vehicle_class.commonroad_type
    return Track(key, kind, length_m, width_m, 0, motion.positions, motion.headings_rad, motion.speeds_mps)


def _problem(task: PlanningTask, network: "LaneletNetwork") -> "PlanningProblem":
    """Return the planning problem of a task as a reader of the file gets it."""
    from commonroad.common.reader.file_reader_xml import PlanningProblemFactory

    return PlanningProblemFactory.create_from_xml_node(planning_problem_element(1, task), network)


@dataclass(frozen=True)
class ScriptedScenario:
    """A file in which edits make the manoeuvre; ``added`` maps the id of each new vehicle to its class.

    A vehicle that replaces another vehicle keeps its id.
    """

    path: Path
    found: FoundManoeuvre
    added: dict[int, str]


def scripted(
    path: Path,
    benchmark_id: str,
    wanted: RequestedManoeuvre,
    classes: dict[int, str],
    folder: Path,
    seed: int,
    numbers: Iterator[int],
    needed: Collection[str] = (),
) -> ScriptedScenario | None:
    """Return the scenario with an actor that makes the manoeuvre, or None if no edit achieves it.

    If a vehicle of another class makes the manoeuvre, it is replaced. Otherwise an edit scripts a suitably placed
    vehicle of the traffic, or adds a vehicle if there is none. In the result, neither the other vehicles nor an
    ordinary driver in the ego's place collide.

    Args:
        path: the scenario without the manoeuvre.
        benchmark_id: the id that the file gets.
        wanted: the manoeuvre.
        classes: our classes by obstacle id.
        folder: where files are written.
        seed: the seed of the simulation that drives the edited vehicles.
        numbers: the tries that the request has left; each list of edits takes one.
        needed: classes that must keep all their vehicles, because the request asks for that number.
    """
    recorded = kept_recording(path, keep=False)
    same = found_in(path, wanted.of_any_class, classes) if wanted.vehicle_class is not None else None
    tries = _tries(recorded.loaded, recorded.tracks, wanted, classes)
    on_foot = same is not None and PEDESTRIAN.name in (wanted.vehicle_class, same.vehicle_class)
    if same is not None and not on_foot and same.vehicle_class not in needed:
        other = Edit(op="replace", vehicles=[str(same.obstacle_id)], vehicle_class=wanted.vehicle_class)
        tries = chain([(other,)], tries)
    for edits, number in zip(tries, numbers, strict=False):
        output = folder / f"scripted_{number}"
        request = ModificationRequest(
            xml=path, edits=edits, benchmark_id=benchmark_id, output=output, on_conflict="refuse", seed=seed
        )
        try:
            outcome = apply_edits(request, silent)
        except InvalidRequest:
            continue
        if outcome.ego_after is None or outcome.ego_after.risk_score == 0:
            continue
        added = {
            key: str(edit.vehicle_class)
            for edit, report in zip(edits, outcome.edits, strict=True)
            for key in report.vehicles
            if edit.op in ("add_vehicle", "replace")
        }
        found = found_in(output / SCENARIO_FILE, wanted, classes | added)
        if found is not None:
            words = tuple(edit.in_words() for edit in edits)
            return ScriptedScenario(output / SCENARIO_FILE, replace(found, edits=words), added)
    return None


def _tries(
    loaded: LoadedScenario, tracks: dict[int, Track], wanted: RequestedManoeuvre, classes: dict[int, str]
) -> Iterator[tuple[Edit, ...]]:
    """Yield lists of edits that may create the manoeuvre, in the order in which they are tried."""
    state = loaded.problem().initial_state
    place, speed_mps = np.asarray(state.position), float(state.velocity)
    if speed_mps < LEAST_MPS:
        return
    fitting = [key for key in tracks if wanted.vehicle_class in (None, classes.get(key, tracks[key].kind))]
    near = nearest_at(place, int(state.time_step), {key: tracks[key] for key in fitting})[:NEAREST]
    if can_be_scripted(wanted):
        usual = PEDESTRIAN.name if wanted.name == "crossing" else "car"
        yield from _TRIES[wanted.name](_Surroundings(tuple(near), wanted.vehicle_class or usual, speed_mps))


def nearest_at(place: Points, step: int, tracks: Mapping[int, Track]) -> list[int]:
    """Return the ids of the road users that are present at a step, ordered by distance to a place (2,) in m."""
    there = {key: (track, track.index_at(step)) for key, track in tracks.items()}
    away_m = {
        key: float(np.linalg.norm(track.positions[index] - place))
        for key, (track, index) in there.items()
        if index is not None
    }
    return sorted(away_m, key=lambda key: (away_m[key], key))


@dataclass(frozen=True)
class _Surroundings:
    """The input of attempts: vehicles near the ego, nearest first; the class of an actor; the ego's speed."""

    near: tuple[int, ...]
    vehicle_class: str
    speed_mps: float


def _cut_ins(there: _Surroundings) -> Iterator[tuple[Edit, ...]]:
    for key in there.near:
        yield (Edit(op="cut_in", vehicles=[str(key)], gap_s=CUT_IN_GAPS_S[0]),)
    own_mps = _speed_of(there.vehicle_class, there.speed_mps)
    speed = None if own_mps == there.speed_mps else f"{own_mps:.2f}m/s"
    for gap_s, ahead_m, side in product(CUT_IN_GAPS_S, AHEAD_M, ("left", "right")):
        entry = _added(there.vehicle_class, there.speed_mps, lane=side, offset_m=ahead_m)
        yield entry, Edit(op="cut_in", vehicles=["new:0"], gap_s=gap_s, speed=speed)


def _brakings(there: _Surroundings) -> Iterator[tuple[Edit, ...]]:
    def brakes(who: str) -> Edit:
        return Edit(op="set_speed", vehicles=[who], speed="0m/s", rate_mps2=BRAKES_MPS2, time_s=BEGINS_S)

    yield (brakes("lead"),)
    for gap_s in GAPS_S:
        yield _added(there.vehicle_class, there.speed_mps, lane="same", gap_s=gap_s), brakes("new:0")


def _cut_outs(there: _Surroundings) -> Iterator[tuple[Edit, ...]]:
    def moves_out(who: str, side: str) -> Edit:
        return Edit.model_validate(
            {"op": "change_lane", "vehicles": [who], "lane": side, "lateral_s": 3.0, "time_s": BEGINS_S}
        )

    for side in ("left", "right"):
        yield (moves_out("lead", side),)
    for gap_s in GAPS_S:
        for side in ("left", "right"):
            yield _added(there.vehicle_class, there.speed_mps, lane="same", gap_s=gap_s), moves_out("new:0", side)


def _crossings(there: _Surroundings) -> Iterator[tuple[Edit, ...]]:
    if there.vehicle_class != PEDESTRIAN.name:
        return
    for walk_s in WALKS_S:
        for side in ("right", "left"):
            yield (
                Edit.model_validate(
                    {
                        "op": "add_vehicle",
                        "vehicle_class": there.vehicle_class,
                        "at": "ego",
                        "offset_m": round(there.speed_mps * walk_s, 1),
                        "side": side,
                    }
                ),
            )


def _oncoming_turns(there: _Surroundings) -> Iterator[tuple[Edit, ...]]:
    for key in there.near:
        yield (Edit(op="reroute", vehicles=[str(key)], turn="left"),)


_TRIES: dict[str, Callable[[_Surroundings], Iterator[tuple[Edit, ...]]]] = {
    "cut_in": _cut_ins,
    "cut_out": _cut_outs,
    "lead_brakes_hard": _brakings,
    "crossing": _crossings,
    "oncoming_turns": _oncoming_turns,
}
"""Manoeuvres that edits can make; the others must occur in the traffic."""


def can_be_scripted(wanted: RequestedManoeuvre) -> bool:
    """Return whether edits can create a manoeuvre; they cannot make a vehicle cross the ego's path."""
    return wanted.name in _TRIES and (wanted.name != "crossing" or wanted.vehicle_class in (None, PEDESTRIAN.name))


def _added(vehicle_class: str, speed_mps: float, **where: object) -> Edit:
    speed = f"{_speed_of(vehicle_class, speed_mps):.2f}m/s"
    return Edit.model_validate(
        {"op": "add_vehicle", "vehicle_class": vehicle_class, "at": "ego", "speed": speed, **where}
    )


def _speed_of(vehicle_class: str, speed_mps: float) -> float:
    return min(speed_mps, FASTEST_SHARE * vehicle_classes()[vehicle_class].maximum_speed_mps)
