"""One worker's share of the modification bench: all measurements on one file or one corpus line."""

import json
import time
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import anyio

from plannerforge.engine.commonroad import Track, read_scenario
from plannerforge.engine.edits import SCENARIO_FILE, apply_edits
from plannerforge.engine.edits.entries import HIT_ON_ENTRY, PLACE_TAKEN
from plannerforge.engine.execution import silent
from plannerforge.engine.scene import Scene
from plannerforge.engine.workspace import Recipe, Workspace
from plannerforge.evals.ground_truth.modification import (
    EditRequest,
    Presets,
    corpus_refusal,
    drawn_refusals,
    drawn_requests,
    edit_of,
)
from plannerforge.schemas.errors import PlannerForgeError, WorkerFailure
from plannerforge.schemas.modification import (
    Edit,
    EditReport,
    ModificationOutcome,
    ModificationRequest,
    ModifyScenarioArguments,
    TouchedVehicle,
)
from plannerforge.schemas.runs import RunRecord
from plannerforge.workflows.modification import modify_scenario
from plannerforge.workflows.scenario_storage import store_scenario

from ..harness import call_in_process
from ..symmetries.fresh_data import fresh_scenario
from ..tracks import is_drivable
from .arrivals import refusal_is_right
from .judges import (
    arrives,
    checks_of,
    handovers_of,
    is_run_over,
    is_taken,
    is_untouched_identical,
    unreported_collisions,
)
from .round_trip import round_trip
from .safety import Shift, executed, new_id, planner_run, shifts_of
from .written import Written, enter_later_on_request, is_strictly_valid, is_valid

POSITION_M, SPEED_MPS = 0.01, 0.01
"""Tolerances of the round trip."""
SETTLED_S = 1.0
"""After a hand-over, the motion is SUMO's alone."""
COMPOSITE = "composite"
ON_FOOT = ("pedestrian",)
"""The drivability checker judges vehicles."""


@dataclass(frozen=True)
class Physical:
    """The drivability checker's verdicts on a touched vehicle.

    ``settled``: from 1 s after its hand-over on (an added one: from its start), None if nothing is left then;
    ``recorded``: on its old recording; ``handed_over``: no edit names it.
    """

    settled: bool | None
    whole: bool
    closed_form: bool
    recorded: bool | None
    handed_over: bool = False


@dataclass(frozen=True)
class Refusal:
    """A refused request that should have been carried out.

    ``is_right``: physics prevents such a rerouting, or a road user occupies the place or cannot brake before it; None
    if the bench has no rule for it, as for a class that a road does not allow.
    """

    task: str
    reason: str
    is_right: bool | None


@dataclass(frozen=True)
class Case:
    """The result of one request; ``refused`` holds the reason if nothing was written.

    ``tries``: refused requests before it, and itself if it was refused. ``arrivals``: for each vehicle sent to a
    target, whether the written motion arrives. ``is_first``: the scenario was not edited before, so its file was read
    for this. ``handovers``: m beyond v·dt and m/s of each vehicle that SUMO took over. ``valid`` allows vehicles to
    enter later if requested, which the schema cannot express; ``enter_later`` counts them, and ``strictly_valid`` does
    not allow them.
    """

    task: str
    name: str
    refused: str = ""
    tries: tuple[Refusal, ...] = ()
    checks: dict[str, bool] = field(default_factory=dict)
    arrivals: tuple[bool, ...] = ()
    valid: bool = False
    strictly_valid: bool = False
    enter_later: int = 0
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
    """All results of one job: cases, right refusals as requested, round trip, shifts of risk.

    ``no_request``: tasks that the scenario does not allow. ``not_to_refuse``: lines of the corpus for which going on is
    right too. ``off_lanes``: those of ``road_users`` off all lanelets: SUMO shows them in the round trip, while a
    re-simulation keeps their recording and leaves them out of SUMO. ``unread``: why the product does not read a fresh
    scenario; ``crashed``: a failure other than a refusal.
    """

    cases: tuple[Case, ...] = ()
    refused_right: tuple[tuple[str, bool], ...] = ()
    round_trip_error: str | None = None
    shifts: tuple[Shift, ...] = ()
    no_request: tuple[str, ...] = ()
    not_to_refuse: tuple[str, ...] = ()
    road_users: int = 0
    off_lanes: int = 0
    unread: str = ""
    crashed: str = ""


@dataclass(frozen=True)
class Effort:
    """Measurements in addition to the edits, which take longer than the edits.

    ``planner``: drives the results of the drawn edits; ``safety``: also those of the recipes of the safety table.
    ``every_vehicle``: the drivability checker judges all touched vehicles, not one that an edit names. ``recipes``:
    whether the edits of the safety table are made at all.
    """

    planner: bool = False
    safety: bool = False
    every_vehicle: bool = False
    recipes: bool = True


def measure_file(path: Path, presets: Presets, effort: Effort) -> Measured:
    """Measure the round trip, one drawn edit of each task, refusals and the recipes of the safety table."""
    return _measured(path, Scene.of(read_scenario(path)), presets, effort)


def measure_fresh(seed: int, number: int, presets: Presets, effort: Effort) -> Measured:
    """Measure the same on one of the ``fresh_scenarios``; its name, unique to the seed, draws its edits.

    A scenario refused by name is ``unread``; any other exception of the product or a judge counts as ``crashed``.
    """
    with TemporaryDirectory() as name:
        try:
            path = fresh_scenario(seed, number, Path(name))
        except Exception as error:  # noqa: BLE001 - a defect of ours is one failure and not the bench's end
            return Measured(crashed=f"scenario {number} of seed {seed} was not made: {error!r}")
        try:
            scene = Scene.of(read_scenario(path))
        except PlannerForgeError as error:
            return Measured(unread=f"{path.stem}: {error.text}")
        except Exception as error:  # noqa: BLE001 - see above
            return Measured(crashed=f"{path.stem}, read: {error!r}")
        try:
            return _measured(path, scene, presets, effort)
        except Exception as error:  # noqa: BLE001 - see above
            return Measured(crashed=f"{path.stem}: {error!r}")


def _measured(path: Path, scene: Scene, presets: Presets, effort: Effort) -> Measured:
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
            shifts=shifts_of(path, scene, folder, base if effort.safety else None) if effort.recipes else (),
        )


def measure_line(line: str, data: Path, effort: Effort) -> Measured:
    """Measure a request of the corpus with its ground truth as arguments."""
    row = json.loads(line)
    truth, path = row["truth"], data / row["scenario"]
    if row["expect"] != "ok":
        refusal = corpus_refusal(row)
        if refusal is None:
            return Measured(not_to_refuse=(row["id"],))
        return Measured(refused_right=((row["id"], is_refused(path, refusal)),))
    truths = truth["edits"]
    asked = EditRequest(row["task"].removeprefix("modification_"), tuple(edit_of(one) for one in truths), tuple(truths))
    scene = Scene.of(read_scenario(path))
    base = planner_run(path) if effort.planner else None
    with TemporaryDirectory() as folder:
        case = _first_possible(path, scene, [asked], Path(folder), base, effort, name=row["id"])
        return Measured((replace(case, is_first=False),))


def _first_possible(
    path: Path,
    scene: Scene,
    asked: Sequence[EditRequest],
    folder: Path,
    base: RunRecord | None,
    effort: Effort,
    *,
    name: str = "",
) -> Case:
    """Carry out and check the first request that the scenario allows; return the last refusal otherwise."""
    tries: list[Refusal] = []
    for attempt, one in enumerate(asked):
        try:
            outcome, wall_s, cpu_s = _edited(path, one, folder)
        except PlannerForgeError as error:
            tries.append(Refusal(one.task, error.text, _is_right(scene, one, error)))
            continue
        case = _checked(path, scene, one, outcome, name or path.stem, every_vehicle=effort.every_vehicle)
        ran = None if base is None else executed(folder / SCENARIO_FILE, base)
        first = attempt == 0
        return replace(case, tries=tuple(tries), edit_s=wall_s, edit_cpu_s=cpu_s, executed=ran, is_first=first)
    return Case(asked[0].task, name or path.stem, tries[-1].reason, tuple(tries))


def _is_right(scene: Scene, asked: EditRequest, error: PlannerForgeError) -> bool | None:
    """Return whether a request had to be refused, by the bench's own rules; a worker's failure is not a refusal.

    A detour counts if the fastest recorded vehicle drives it before the scenario ends.
    """
    if isinstance(error, WorkerFailure):
        return False
    if asked.task == "P" and error.reason == PLACE_TAKEN:
        return any(is_taken(scene, truth) for truth in asked.truths)
    if asked.task == "P" and error.reason == HIT_ON_ENTRY:
        return any(is_run_over(scene, truth) for truth in asked.truths)
    if asked.task != "T":
        return None
    fastest_mps = max(float(track.speeds_mps.max()) for track in scene.tracks.values())
    return any(
        refusal_is_right(
            scene.network,
            scene.tracks[truth["vehicle_id"]],
            frozenset(truth["target_lanelets"]),
            fastest_mps * (scene.last_step - scene.tracks[truth["vehicle_id"]].first_step) * scene.step_s,
        )
        for truth in asked.truths
    )


def _edited(path: Path, asked: EditRequest, folder: Path) -> tuple[ModificationOutcome, float, float]:
    """Return the outcome with its wall and processor seconds, after removing files of earlier edits."""
    for left in folder.iterdir():
        left.unlink()
    request = ModificationRequest(
        xml=path, edits=asked.edits, benchmark_id=new_id(path), output=folder, keep_simulation=True
    )
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    outcome = apply_edits(request, silent)
    return outcome, time.perf_counter() - wall_s, time.process_time() - cpu_s


def _checked(
    path: Path, scene: Scene, asked: EditRequest, outcome: ModificationOutcome, name: str, *, every_vehicle: bool
) -> Case:
    written = Written.of(path, scene, asked.truths, outcome)
    checks: dict[str, bool] = {}
    for index in range(len(asked.truths)):
        for check, passed in checks_of(written, index).items():
            checks[check] = checks.get(check, True) and passed
    if asked.task == COMPOSITE:
        checks[f"{COMPOSITE}_done"] = all(checks.values())
    return Case(
        task=asked.task,
        name=name,
        checks=checks,
        arrivals=tuple(
            arrives(written, key, frozenset(truth["target_lanelets"]))
            for index, truth in enumerate(written.truths)
            if truth["op"] == "reroute"
            for key in sorted(written.vehicles_of_edit(index))
        ),
        valid=is_valid(written),
        strictly_valid=is_strictly_valid(written),
        enter_later=len(enter_later_on_request(written)),
        untouched_identical=is_untouched_identical(written),
        touched=len(outcome.touched),
        handed_over=len(outcome.handed_over),
        collisions=len(outcome.collisions),
        unreported=unreported_collisions(written),
        handovers=handovers_of(written),
        physical=_physical(written, name, every_vehicle=every_vehicle),
        in_several_calls_equal=several_calls_equal(path, asked.edits) if len(asked.edits) > 1 else None,
    )


def _physical(written: Written, seed: str, *, every_vehicle: bool) -> tuple[Physical, ...]:
    """Return verdicts on all touched vehicles, or on one drawn from those that the edits name."""
    tracks = written.new
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
    calm = is_drivable(track, step_s, settled) if settled + 1 < len(track.positions) else None
    return Physical(
        settled=calm,
        whole=calm is not False and is_drivable(track, step_s, first, settled + 1),
        closed_form=one.feasible,
        recorded=None if old is None else is_drivable(old, step_s, first),
        handed_over=one.cause == "handed_over",
    )


def is_refused(path: Path, asked: EditRequest) -> bool:
    """Return True if a request is refused with a reason that names the fault, and writes nothing."""
    with TemporaryDirectory() as folder:
        try:
            _edited(path, asked, Path(folder))
        except PlannerForgeError as error:
            named = all(word.lower() in error.text.lower() for word in asked.must_name)
            return bool(asked.must_name) and named and not any(Path(folder).iterdir())
    return False


def _round_trip_error(scene: Scene) -> str:
    """Return an empty text if every road user comes back unchanged, otherwise the difference."""
    trip = round_trip(scene)
    good = not trip.missing and trip.position_error_m <= POSITION_M and trip.speed_error_mps <= SPEED_MPS
    where = f"{len(trip.missing)} states missing, {trip.position_error_m:.3f} m, {trip.speed_error_mps:.3f} m/s"
    return "" if good else where


def several_calls_equal(path: Path, edits: Sequence[Edit]) -> bool:
    """Return True if one call per edit, each on the previous scenario, ends with the same bytes as one call for all.

    Ids depend on the request: if the words of all calls together equal those of the one, the ids must be equal too.
    Later calls name vehicles by reported ids if they were added, or if words refer to them after an addition or a
    removal.
    """
    return anyio.run(_several_calls_equal, path, tuple(edits))


async def _several_calls_equal(path: Path, edits: tuple[Edit, ...]) -> bool:
    with TemporaryDirectory() as folder:
        workspace = Workspace(Path(folder))
        try:
            call = call_in_process(workspace)
            base = (
                await store_scenario(call, xml=path, net=None, recipe=Recipe(tool="bench"), origin="imported")
            ).artifact_id
            once = await modify_scenario(ModifyScenarioArguments(scenario_id=base, edits=list(edits)), call)
            last, steps = base, _by_ids(edits, once.edits)
            for edit in steps:
                made = await modify_scenario(ModifyScenarioArguments(scenario_id=last, edits=[edit]), call)
                last = str(made.scenario_id)
            is_same_id = steps != edits or last == once.scenario_id
            return is_same_id and _content(workspace, str(once.scenario_id)) == _content(workspace, last)
        finally:
            workspace.close()


def _by_ids(edits: tuple[Edit, ...], reports: Sequence[EditReport]) -> tuple[Edit, ...]:
    """Return the edits with ids in place of words that depend on earlier edits."""
    made, is_altered = [], False
    for edit, report in zip(edits, reports, strict=True):
        words = is_altered and not all(text.isdigit() for text in edit.vehicles)
        made.append(edit.model_copy(update={"vehicles": [str(key) for key in report.vehicles]}) if words else edit)
        is_altered = is_altered or edit.op in ("add_vehicle", "remove_vehicle", "set_ego")
    return tuple(made)


def _content(workspace: Workspace, scenario_id: str) -> bytes:
    content = workspace.file("scenario", scenario_id, "scenario.xml").read_bytes()
    return content.replace(scenario_id.encode(), b"")
