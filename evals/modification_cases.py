"""One worker's share of the modification bench: everything that is measured on one file or one corpus line."""

import json
import time
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
from plannerforge.evals.modification_checks import (
    Written,
    checks_of,
    is_untouched_identical,
    is_valid,
    unreported_collisions,
)
from plannerforge.evals.modification_requests import Asked, drawn_requests, edit_of, refusals
from plannerforge.evals.modification_safety import Shift, executed, new_id, planner_run, shifts_of
from plannerforge.schemas.errors import PlannerForgeError
from plannerforge.schemas.modification import ModificationOutcome, ModificationRequest, TouchedVehicle
from plannerforge.schemas.runs import RunRecord

POSITION_M, SPEED_MPS = 0.01, 0.01
SETTLED_S = 1.0
CHECKED_VEHICLES = 1


@dataclass(frozen=True)
class Physical:
    """The drivability checker's verdicts on a touched vehicle.

    ``settled``: from its hand-over + 1 s on (an added one: from its start); ``recorded``: on its old recording.
    """

    settled: bool
    whole: bool
    closed_form: bool
    recorded: bool | None


@dataclass(frozen=True)
class Case:
    """What came of one request; ``refused`` holds the reason where nothing was made.

    ``is_first``: the scenario was not edited before, so that its file was read for this.
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
    jump_m: float = 0.0
    speed_step_mps: float = 0.0
    physical: tuple[Physical, ...] = ()
    edit_s: float = 0.0
    edit_cpu_s: float = 0.0
    is_first: bool = False
    executed: bool | None = None
    in_several_calls_equal: bool | None = None


@dataclass(frozen=True)
class Measured:
    """All of one job: cases, refusals that were right and asked for, round trip, shifts of danger."""

    cases: tuple[Case, ...] = ()
    refused_right: tuple[tuple[str, bool], ...] = ()
    round_trip_error: str | None = None
    shifts: tuple[Shift, ...] = ()


def measure_file(path: Path, *, run_planner: bool, check_drivable: bool) -> Measured:
    """Round trip, one drawn edit of each task, refusals and the recipes of the safety table.

    The planner and the drivability checker take longer than all the rest, so that they may be left out.
    """
    scene = Scene.of(read_scenario(path))
    base = planner_run(path) if run_planner else None
    with TemporaryDirectory() as name:
        folder = Path(name)
        cases = [
            _first_possible(path, scene, asked, folder, base, check_drivable=check_drivable)
            for asked in drawn_requests(scene, path.stem)
            if asked
        ]
        cases[:1] = [replace(case, is_first=True) for case in cases[:1]]
        refused = tuple((f"{path.stem}: {one.must_name}", _is_refused(path, scene, one)) for one in refusals(scene))
        return Measured(tuple(cases), refused, _round_trip_error(scene), shifts_of(path, scene, folder, base))


def measure_line(line: str, data: Path) -> Measured:
    """A request of the corpus with its ground truth as arguments."""
    row = json.loads(line)
    truth, path = row["truth"], data / row["scenario"]
    truths = truth["edits"] if row["expect"] == "ok" else truth.get("requested", [])
    if not truths or any("infeasible" in one for one in truths):
        return Measured()
    asked = Asked(row["task"].removeprefix("modification_"), tuple(edit_of(one) for one in truths), tuple(truths))
    scene = Scene.of(read_scenario(path))
    with TemporaryDirectory() as folder:
        if row["expect"] != "ok":
            return Measured(refused_right=((row["id"], _is_refused(path, scene, asked)),))
        return Measured((_first_possible(path, scene, [asked], Path(folder), name=row["id"]),))


def _first_possible(
    path: Path,
    scene: Scene,
    asked: Sequence[Asked],
    folder: Path,
    base: RunRecord | None = None,
    *,
    check_drivable: bool = True,
    name: str = "",
) -> Case:
    """The first request that the scenario allows, carried out and checked; the last refusal where none is."""
    reason = ""
    for one in asked:
        try:
            outcome, wall_s, cpu_s = _edited(path, one, folder)
        except PlannerForgeError as error:
            reason = error.text
            continue
        case = _checked(path, scene, one, outcome, name or path.stem, check_drivable=check_drivable)
        ran = None if base is None else executed(folder / SCENARIO_FILE, base)
        return replace(case, edit_s=wall_s, edit_cpu_s=cpu_s, executed=ran)
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
    path: Path, scene: Scene, asked: Asked, outcome: ModificationOutcome, name: str, *, check_drivable: bool
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
        jump_m=max((one.handover_jump_m or 0.0 for one in outcome.touched), default=0.0),
        speed_step_mps=max((one.handover_speed_step_mps or 0.0 for one in outcome.touched), default=0.0),
        physical=_physical(written) if check_drivable else (),
        in_several_calls_equal=_in_several_calls(path, asked, written.xml) if len(asked.edits) > 1 else None,
    )


def _physical(written: Written) -> tuple[Physical, ...]:
    tracks = written.tracks()
    there = [one for one in written.outcome.touched if one.vehicle_id in tracks]
    chosen = sorted(there, key=lambda one: (one.cause == "handed_over", one.vehicle_id))[:CHECKED_VEHICLES]
    return tuple(_verdicts(written, one, tracks[one.vehicle_id]) for one in chosen)


def _verdicts(written: Written, one: TouchedVehicle, track: Track) -> Physical:
    step_s = written.scene.step_s
    first = round(one.from_time_s / step_s) - track.first_step
    settled = first + (0 if one.cause == "added" else round(SETTLED_S / step_s))
    old = written.scene.tracks.get(one.vehicle_id)
    calm = check_drivability(_motion(track, settled, len(track.positions)), step_s).feasible
    return Physical(
        settled=calm,
        whole=calm and check_drivability(_motion(track, first, settled + 1), step_s).feasible,
        closed_form=one.feasible,
        recorded=None if old is None else check_drivability(_motion(old, first, len(old.positions)), step_s).feasible,
    )


def _motion(track: Track, begin: int, end: int) -> Motion:
    speeds = track.speeds_mps[begin:end]
    return Motion(track.positions[begin:end], track.headings_rad[begin:end], speeds, speeds * 0.0)


def _in_several_calls(path: Path, asked: Asked, xml: Path) -> bool:
    """Whether the last of several calls, one for each edit, writes the same bytes."""
    with TemporaryDirectory() as folder:
        outcome, _, _ = _edited(path, asked, Path(folder), earlier=len(asked.edits) - 1)
        return outcome.xml is not None and outcome.xml.read_bytes() == xml.read_bytes()


def _is_refused(path: Path, scene: Scene, asked: Asked) -> bool:
    """Whether a request is refused with a reason that names what is wrong, and writes nothing."""
    del scene
    with TemporaryDirectory() as folder:
        try:
            _edited(path, asked, Path(folder))
        except PlannerForgeError as error:
            return asked.must_name.lower() in error.text.lower() and not any(Path(folder).iterdir())
    return False


def _round_trip_error(scene: Scene) -> str:
    """Empty if everybody comes back as put in."""
    found = round_trip(scene)
    good = not found.missing and found.position_error_m <= POSITION_M and found.speed_error_mps <= SPEED_MPS
    where = f"{len(found.missing)} states missing, {found.position_error_m:.3f} m, {found.speed_error_mps:.3f} m/s"
    return "" if good else where
