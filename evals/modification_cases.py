"""One worker's share of the modification bench: everything that is measured on one file or one corpus line."""

import json
import time
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from plannerforge.engine.edits.apply import SCENARIO_FILE, apply_edits
from plannerforge.engine.edits.operations import resolve_edits
from plannerforge.engine.edits.round_trip import round_trip
from plannerforge.engine.edits.scenario_document import ScenarioDocument
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.execution.progress import silent
from plannerforge.engine.scenarios.reader import read_scenario
from plannerforge.engine.scenarios.tracks import Track
from plannerforge.engine.traffic.drivability import check_drivability
from plannerforge.engine.traffic.smoothing import Motion
from plannerforge.engine.traffic.vehicle_classes import nearest_class
from plannerforge.evals.modification_checks import (
    Written,
    checks_of,
    handovers_of,
    is_untouched_identical,
    is_valid,
    unreported_collisions,
)
from plannerforge.evals.modification_refusals import corpus_refusal, drawn_refusals
from plannerforge.evals.modification_requests import Asked, Presets, drawn_requests, edit_of
from plannerforge.evals.modification_safety import Shift, executed, new_id, planner_run, shifts_of
from plannerforge.schemas.errors import PlannerForgeError
from plannerforge.schemas.modification import ModificationOutcome, ModificationRequest, TouchedVehicle
from plannerforge.schemas.runs import RunRecord

POSITION_M, SPEED_MPS = 0.01, 0.01
SETTLED_S = 1.0
ON_FOOT = ("pedestrian",)
"""The drivability checker judges vehicles."""


@dataclass(frozen=True)
class Physical:
    """The drivability checker's verdicts on a touched vehicle.

    ``settled``: from its hand-over + 1 s on (an added one: from its start), None where nothing is left then;
    ``recorded``: on its old recording; ``handed_over``: no edit names it.
    """

    settled: bool | None
    whole: bool
    closed_form: bool
    recorded: bool | None
    handed_over: bool = False


@dataclass(frozen=True)
class Case:
    """What came of one request; ``refused`` holds the reason where nothing was made.

    ``is_first``: nobody tried to edit the scenario before, so that its file was read for this. ``handovers``: m beyond
    v·dt and m/s of each vehicle that SUMO took over.
    """

    task: str
    name: str
    refused: str = ""
    checks: dict[str, bool] = field(default_factory=dict)
    valid: bool = False
    untouched_identical: bool = False
    touched: int = 0
    handed_over: int = 0
    collisions: int = 0
    unreported: int = 0
    handovers: tuple[tuple[float, float], ...] = ()
    physical: tuple[Physical, ...] = ()
    edit_s: float = 0.0
    edit_cpu_s: float = 0.0
    is_first: bool = False
    executed: bool | None = None
    in_several_calls_equal: bool | None = None


@dataclass(frozen=True)
class Measured:
    """All of one job: cases, refusals that were right and asked for, round trip, shifts of danger.

    ``no_request``: tasks of which the scenario allows nothing. ``not_to_refuse``: lines of the corpus for which going
    on is right too. ``off_lanes``: those of ``road_users`` off all lanelets: SUMO shows them in the round trip, while a
    re-simulation keeps their recording and leaves them out of SUMO.
    """

    cases: tuple[Case, ...] = ()
    refused_right: tuple[tuple[str, bool], ...] = ()
    round_trip_error: str | None = None
    shifts: tuple[Shift, ...] = ()
    no_request: tuple[str, ...] = ()
    not_to_refuse: tuple[str, ...] = ()
    road_users: int = 0
    off_lanes: int = 0


@dataclass(frozen=True)
class Effort:
    """What is measured besides the edits, which takes longer than they do.

    ``planner``: it drives what the drawn edits made; ``safety``: what the recipes of the safety table made too.
    ``every_vehicle``: the drivability checker judges all touched vehicles, not one that an edit names.
    """

    planner: bool = False
    safety: bool = False
    every_vehicle: bool = False


def measure_file(path: Path, presets: Presets, effort: Effort) -> Measured:
    """Round trip, one drawn edit of each task, refusals and the recipes of the safety table."""
    scene = Scene.of(read_scenario(path))
    base = planner_run(path) if effort.planner else None
    drawn = list(drawn_requests(scene, path.stem, presets))
    asked = [requests for _, requests in drawn if requests]
    with TemporaryDirectory() as name:
        folder = Path(name)
        cases = [_first_possible(path, scene, requests, folder, base, effort) for requests in asked]
        return Measured(
            cases=tuple(replace(case, is_first=index == 0 and case.is_first) for index, case in enumerate(cases)),
            refused_right=tuple(
                (f"{path.stem}: {one.must_name[0]}", is_refused(path, one)) for one in drawn_refusals(scene)
            ),
            no_request=tuple(task for task, requests in drawn if not requests),
            road_users=len(scene.tracks) + len(scene.standing),
            off_lanes=len([key for key in scene.tracks | scene.standing if key not in scene.matches]),
            round_trip_error=_round_trip_error(scene),
            shifts=shifts_of(path, scene, folder, base if effort.safety else None),
        )


def measure_line(line: str, data: Path, effort: Effort) -> Measured:
    """A request of the corpus with its ground truth as arguments."""
    row = json.loads(line)
    truth, path = row["truth"], data / row["scenario"]
    if row["expect"] != "ok":
        refusal = corpus_refusal(row)
        if refusal is None:
            return Measured(not_to_refuse=(row["id"],))
        return Measured(refused_right=((row["id"], is_refused(path, refusal)),))
    truths = truth["edits"]
    asked = Asked(row["task"].removeprefix("modification_"), tuple(edit_of(one) for one in truths), tuple(truths))
    scene = Scene.of(read_scenario(path))
    base = planner_run(path) if effort.planner else None
    with TemporaryDirectory() as folder:
        case = _first_possible(path, scene, [asked], Path(folder), base, effort, name=row["id"])
        return Measured((replace(case, is_first=False),))


def _first_possible(
    path: Path,
    scene: Scene,
    asked: Sequence[Asked],
    folder: Path,
    base: RunRecord | None,
    effort: Effort,
    *,
    name: str = "",
) -> Case:
    """The first request that the scenario allows, carried out and checked; the last refusal where none is."""
    reason = ""
    for attempt, one in enumerate(asked):
        try:
            outcome, wall_s, cpu_s = _edited(path, one, folder)
        except PlannerForgeError as error:
            reason = error.text
            continue
        case = _checked(path, scene, one, outcome, name or path.stem, every_vehicle=effort.every_vehicle)
        ran = None if base is None else executed(folder / SCENARIO_FILE, base)
        return replace(case, edit_s=wall_s, edit_cpu_s=cpu_s, executed=ran, is_first=attempt == 0)
    return Case(asked[0].task, name or path.stem, reason)


def _edited(path: Path, asked: Asked, folder: Path, earlier: int = 0) -> tuple[ModificationOutcome, float, float]:
    """The outcome, and the wall and processor seconds that it took."""
    request = ModificationRequest(
        xml=path, edits=asked.edits, benchmark_id=new_id(path), output=folder, earlier=earlier
    )
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    outcome = apply_edits(request, silent)
    return outcome, time.perf_counter() - wall_s, time.process_time() - cpu_s


def _checked(
    path: Path, scene: Scene, asked: Asked, outcome: ModificationOutcome, name: str, *, every_vehicle: bool
) -> Case:
    changes, _ = resolve_edits(asked.edits, scene, ScenarioDocument.read(path).highest_id + 1)
    written = Written.of(path, scene, changes, outcome)
    checks: dict[str, bool] = {}
    for truth, report in zip(asked.truths, outcome.edits, strict=True):
        for check, passed in checks_of(written, truth, report).items():
            checks[check] = checks.get(check, True) and passed
    return Case(
        task=asked.task,
        name=name,
        checks=checks,
        valid=is_valid(written),
        untouched_identical=is_untouched_identical(written),
        touched=len(outcome.touched),
        handed_over=len(outcome.handed_over),
        collisions=len(outcome.collisions),
        unreported=unreported_collisions(written),
        handovers=handovers_of(written),
        physical=_physical(written, name, every_vehicle=every_vehicle),
        in_several_calls_equal=_in_several_calls(path, asked, written.xml) if len(asked.edits) > 1 else None,
    )


def _physical(written: Written, seed: str, *, every_vehicle: bool) -> tuple[Physical, ...]:
    """Verdicts on all touched vehicles, or on one drawn of those that the edits name."""
    tracks = written.tracks()
    there = [
        one
        for one in written.outcome.touched
        if one.vehicle_id in tracks and tracks[one.vehicle_id].kind not in ON_FOOT
    ]
    if not every_vehicle:
        named = [one for one in there if one.cause != "handed_over"]
        there = [named[zlib.crc32(seed.encode()) % len(named)]] if named else []
    return tuple(_verdicts(written, one, tracks[one.vehicle_id]) for one in there)


def _verdicts(written: Written, one: TouchedVehicle, track: Track) -> Physical:
    step_s = written.scene.step_s
    first = round(one.from_time_s / step_s) - track.first_step
    settled = first + (0 if one.cause == "added" else round(SETTLED_S / step_s))
    old = written.scene.tracks.get(one.vehicle_id)
    calm = _is_drivable(track, settled, len(track.positions), step_s) if settled + 1 < len(track.positions) else None
    return Physical(
        settled=calm,
        whole=calm is not False and _is_drivable(track, first, settled + 1, step_s),
        closed_form=one.feasible,
        recorded=None if old is None else _is_drivable(old, first, len(old.positions), step_s),
        handed_over=one.cause == "handed_over",
    )


def _is_drivable(track: Track, begin: int, end: int, step_s: float) -> bool:
    """Whether a vehicle with the axles of its class can drive a part of a track."""
    chassis = nearest_class(track.kind, track.length_m)
    motion = _motion(track, begin, end)
    axles = {"wheelbase_m": chassis.wheelbase_m, "rear_axle_m": chassis.rear_axle_m}
    return check_drivability(motion, step_s, **axles).feasible


def _motion(track: Track, begin: int, end: int) -> Motion:
    speeds = track.speeds_mps[begin:end]
    return Motion(track.positions[begin:end], track.headings_rad[begin:end], speeds, speeds * 0.0)


def _in_several_calls(path: Path, asked: Asked, xml: Path) -> bool:
    """Whether the last of several calls, one for each edit, writes the same bytes."""
    with TemporaryDirectory() as folder:
        outcome, _, _ = _edited(path, asked, Path(folder), earlier=len(asked.edits) - 1)
        return outcome.xml is not None and outcome.xml.read_bytes() == xml.read_bytes()


def is_refused(path: Path, asked: Asked) -> bool:
    """Whether a request is refused with a reason that names what is wrong, and writes nothing."""
    with TemporaryDirectory() as folder:
        try:
            _edited(path, asked, Path(folder))
        except PlannerForgeError as error:
            named = all(word.lower() in error.text.lower() for word in asked.must_name)
            return bool(asked.must_name) and named and not any(Path(folder).iterdir())
    return False


def _round_trip_error(scene: Scene) -> str:
    """Empty if everybody comes back as put in."""
    found = round_trip(scene)
    good = not found.missing and found.position_error_m <= POSITION_M and found.speed_error_mps <= SPEED_MPS
    where = f"{len(found.missing)} states missing, {found.position_error_m:.3f} m, {found.speed_error_mps:.3f} m/s"
    return "" if good else where
