"""The operation behind ``modify_scenario``: edits in, a new scenario file out."""

import hashlib
import shutil
import tempfile
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

from ...schemas.errors import InvalidRequest, NotPossible
from ...schemas.modification import EditReport, ModificationOutcome, ModificationRequest, TouchedVehicle
from ..commonroad import ScenarioDocument, Track, read_recorded
from ..cosimulation import ROUTES_FILE, TYPES_FILE, SimulationSetup
from ..execution import ProgressReporter
from ..scene import Scene, is_own_recording
from ..vehicles import check_drivability
from .changes import Changes, EditStep, altered
from .ego_risk import Danger, EgoDrive, base_drive, danger_after, drive_after, ego_actor, left_out_notes
from .entry_checks import check_departures, check_entries, check_shifted_entries, entering_onto, slower_entries
from .explanations import check_not_driven_past, everybody_after
from .operations import resolve_edits
from .report import edit_reports, reported_collisions, touched_vehicles
from .simulation import Resimulated, resimulate_until_clear
from .writing import added_obstacle, write_ego_start, write_goal, write_replay, write_touched

# ---------- kept_scene
# Scenes that a worker keeps, because one scenario is edited again and again: reading it takes longer than an edit.

KEPT = 4


@dataclass(frozen=True)
class _KeptScene:
    """A scene, and what its ego does in it before any edit: a simulation that does not depend on the edits."""

    scene: Scene
    _drives: dict[int, EgoDrive | None] = field(default_factory=dict)

    def ego_before(self, setup: SimulationSetup) -> EgoDrive | None:
        """The ego's ordinary drive among the recorded vehicles; simulated once for a seed, and the last one is kept."""
        if setup.seed not in self._drives:
            drive = base_drive(self.scene, setup)
            self._drives.clear()
            self._drives[setup.seed] = drive
        return self._drives[setup.seed]


def scene_of(path: Path, problem_id: int | None = None) -> _KeptScene:
    """The scene of a file with its lanes and SUMO network; made once for the same content, and never changed.

    Args:
        path: the CommonRoad file.
        problem_id: the planning problem whose ego it is about; None for the first.

    Raises:
        UnknownName: the file has no such planning problem.
        UnsafeInput: the file is not readable.
    """
    try:
        content = path.read_bytes()
    except OSError:
        content = b""  # the reader says what is wrong with the file
    return _scene(path, hashlib.sha256(content).hexdigest(), problem_id)


@lru_cache(maxsize=KEPT)
def _scene(path: Path, digest: str, problem_id: int | None) -> _KeptScene:
    del digest
    read = read_recorded(path)
    return _KeptScene(Scene.of(read.loaded, read.tracks, problem_id))


# ---------- carrying_out
# Edits carried out: simulated, and once more where an added vehicle would collide as it enters.


@dataclass(frozen=True)
class _CarriedOut:
    """What edits come to once they are simulated.

    ``ego``: how an ordinary driver drives the ego after them; None without one. ``notes``: sentences on what was done
    besides.
    """

    scene: Scene
    changes: Changes
    steps: tuple[EditStep, ...]
    ego: Track | None
    result: Resimulated
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class _EditRun:
    """What the edits of a request are carried out with; ``ego_before``: the ego's drive in the base scenario."""

    request: ModificationRequest
    base: Scene
    setup: SimulationSetup
    ego_before: EgoDrive | None

    def carry_out(self, changes: Changes, steps: tuple[EditStep, ...], first_id: int) -> _CarriedOut:
        """Simulate the edits as they were resolved.

        Where an added vehicle collides as it enters although the request left its speed open, it enters slower, as long
        as fewer collide so. ``first_id``: the id that the first added vehicle gets.
        """
        usual = self._simulated(changes, steps)
        slower = slower_entries(self.request.edits, usual.scene, changes, usual.result)
        if slower is None:
            return usual
        edits, notes = slower
        try:
            other = self._simulated(*resolve_edits(edits, self.base, first_id, self.request.earlier))
        except InvalidRequest:  # an edit that goes by speeds ("fastest") may find nobody then
            other = usual
        if len(other.result.overlaps) < len(usual.result.overlaps):
            return replace(other, notes=notes)
        # The last simulation leaves its files behind; they have to be those of the motion that is written.
        return self._simulated(changes, steps)

    def _simulated(self, changes: Changes, steps: tuple[EditStep, ...]) -> _CarriedOut:
        scene = altered(self.base, changes)
        ego = drive_after(self.ego_before, self.base, scene, changes, self.setup)
        return _CarriedOut(scene, changes, steps, ego, self._result(scene, changes, ego))

    def _result(self, scene: Scene, changes: Changes, ego: Track | None) -> Resimulated:
        """Re-simulate if anything is driven; removals and goals alone leave all recordings as they are."""
        everybody = self.request.traffic == "reactive"
        if not changes.driven and not changes.replays and not everybody:
            return Resimulated({}, {}, (), ())
        seen_ego = None if ego is None else ego_actor(scene, ego)
        shown = () if seen_ego is None else (seen_ego,)
        return resimulate_until_clear(scene, changes, self.setup, shown, everybody=everybody)


# ---------- apply
# The operation behind ``modify_scenario``: edits in, a new scenario file out.

SCENARIO_FILE, NET_FILE = "scenario.xml", "scenario.net.xml"


def apply_edits(request: ModificationRequest, report: ProgressReporter) -> ModificationOutcome:
    """Carry out all edits, or none, in one re-simulation from the base scenario.

    Raises:
        InvalidRequest: an edit that cannot be meant, or that the scenario does not allow.
        NotPossible: an entry onto a taken place; collisions are left and the request refuses them.
        UnsafeInput: the file is not readable.
    """
    report(0.0, "reading the scenario")
    kept = scene_of(request.xml, request.problem_id)
    base = kept.scene
    document = ScenarioDocument.read(request.xml)
    report(0.3, "resolving the edits")
    first_id = document.highest_id + 1
    changes, steps = resolve_edits(request.edits, base, first_id, request.earlier)
    with tempfile.TemporaryDirectory() as folder:
        net = Path(folder) / NET_FILE
        net.write_text(base.sumo_net, encoding="utf-8")
        report(0.4, "simulating")
        setup = SimulationSetup(
            net, net.parent, base.step_s, base.last_step, request.seed, keeps_routes=request.keep_simulation
        )
        before = kept.ego_before(setup)
        made = _EditRun(request, base, setup, before).carry_out(changes, steps, first_id)
        scene, changes, result, ego = made.scene, made.changes, made.result, made.ego
        _check(request, scene, changes, made.steps, result)
        report(0.8, "writing")
        notes = [*_write_changes(document, scene, changes, result), *made.notes]
        notes += [*_entries_onto_ego(scene, changes, ego), *_own_recordings(scene, changes)]
        files = (None, None) if request.dry_run else _write_files(request, document, net)
        if request.keep_simulation and not request.dry_run and result.tracks:
            _keep_simulation(setup, request.output)
    after = None if ego is None else danger_after(ego, scene, changes, result)
    reports = edit_reports(request, scene, made.steps, result, everybody_after(scene, changes, result, ego))
    dangers = (None if before is None else before.danger, after)
    return _outcome(request, scene, changes, reports, result, dangers, files, notes)


def _check(
    request: ModificationRequest, scene: Scene, changes: Changes, steps: tuple[EditStep, ...], result: Resimulated
) -> None:
    lost = [key for key in result.missing if key in changes.driven]
    if lost:
        raise NotPossible(
            f"vehicle {', '.join(map(str, lost))} cannot be driven: SUMO did not take, or the scenario ends",
            valid=[key for key in scene.tracks if key not in lost],
            next_step="choose another vehicle or place",
        )
    check_departures(scene, changes, result)
    check_entries(request.edits, scene, changes, result)
    check_shifted_entries(request.edits, steps, scene, changes, result)
    for key in changes.driven:
        check_not_driven_past(scene, result.plans[key], result.tracks[key])
    hits = reported_collisions(scene, result)
    if hits and request.on_conflict == "refuse":
        pairs = [f"{hit.vehicles[0]} with {hit.vehicles[1]} at {hit.time_s:.1f} s" for hit in hits]
        raise NotPossible(
            f"the edits cause collisions: {'; '.join(pairs)}",
            valid=["on_conflict=report"],
            next_step="accept them with on_conflict=report, or change the edit",
        )


def _write_changes(document: ScenarioDocument, scene: Scene, changes: Changes, result: Resimulated) -> list[str]:
    for key in sorted(changes.removed):
        document.remove(document.obstacle(key))
    for replay in changes.replays.values():
        write_replay(document, replay, scene.step_s)
    for key, track in result.tracks.items():
        plan = result.plans[key]
        if plan.cause == "added":
            element = added_obstacle(plan, track, scene.step_s, is_2018b=document.is_2018b)
            document.add_obstacle(element)
        else:
            write_touched(document, track, scene.step_s)
    if changes.ego is not None:
        write_ego_start(document, changes.ego)
    return [] if changes.goal is None else write_goal(document, changes.goal)


def _entries_onto_ego(scene: Scene, changes: Changes, ego: Track | None) -> list[str]:
    """A place is not refused for where the ego may be later: its planner decides that."""
    found = () if ego is None else entering_onto(ego, scene, changes)
    if not found:
        return []
    return [f"vehicle {', '.join(map(str, found))} enters just where an ego that drives ordinarily is then"]


def _own_recordings(scene: Scene, changes: Changes) -> list[str]:
    """Who lies over the ego from the start whatever the edits do, so that its danger says nothing."""
    start = changes.ego or scene.ego
    left = {key: track for key, track in scene.tracks.items() if key not in changes.removed}
    own = [key for key, track in left.items() if start is not None and is_own_recording(track, start)]
    if not own:
        return []
    return [
        f"{', '.join(map(str, own))} is the ego's own recording: its danger is 0 m until remove_vehicle takes it out"
    ]


def _write_files(request: ModificationRequest, document: ScenarioDocument, net: Path) -> tuple[Path, Path]:
    request.output.mkdir(parents=True, exist_ok=True)
    xml, kept_net = request.output / SCENARIO_FILE, request.output / NET_FILE
    document.write(xml, request.benchmark_id)
    kept_net.write_bytes(net.read_bytes())
    return xml, kept_net


def _keep_simulation(setup: SimulationSetup, output: Path) -> None:
    """What the last simulation left, which is the one whose motion was written."""
    for name in (TYPES_FILE, ROUTES_FILE):
        shutil.copyfile(setup.folder / name, output / name)


def _outcome(
    request: ModificationRequest,
    scene: Scene,
    changes: Changes,
    edits: tuple[EditReport, ...],
    result: Resimulated,
    dangers: tuple[Danger | None, Danger | None],
    files: tuple[Path | None, Path | None],
    notes: list[str],
) -> ModificationOutcome:
    recorded = set(scene.tracks) - set(result.tracks) - changes.removed - set(changes.replays)
    touched, agree = _judged(request, scene, changes, result)
    return ModificationOutcome(
        xml=files[0],
        net=files[1],
        edits=edits,
        touched=touched,
        removed=tuple(sorted(changes.removed)),
        collisions=reported_collisions(scene, result),
        ego_before=None if dangers[0] is None else dangers[0].figures,
        ego_after=None if dangers[1] is None else dangers[1].figures,
        checked_by="closed_form" if agree is None else "drivability_checker",
        checkers_agree=agree,
        untouched=len(recorded),
        warnings=(*notes, *_warnings(request, scene, changes, result), *left_out_notes(*dangers)),
    )


def _judged(
    request: ModificationRequest, scene: Scene, changes: Changes, result: Resimulated
) -> tuple[tuple[TouchedVehicle, ...], int | None]:
    """The touched vehicles, and on how many of them both checks agree where both were asked for."""
    screened = touched_vehicles(scene, changes, result)
    if request.detail == "brief":
        return screened, None
    checked = touched_vehicles(scene, changes, result, check_drivability)
    return checked, sum(one.feasible == other.feasible for one, other in zip(screened, checked, strict=True))


def _warnings(request: ModificationRequest, scene: Scene, changes: Changes, result: Resimulated) -> list[str]:
    unseen = {key for key in scene.tracks if key not in scene.matches and not changes.is_added(key)}
    unseen |= {region.obstacle_id for region in scene.regions if region.match is None}
    unseen -= changes.removed
    phantoms = sorted(int(one.obstacle_id) for one in scene.loaded.scenario.phantom_obstacle)
    found = _late_entries(scene, changes, result)
    if unseen and result.plans:
        found.append(
            f"recorded off the lanelets, so that driven vehicles do not see them: {', '.join(map(str, sorted(unseen)))}"
        )
    if phantoms and result.plans:
        found.append(f"phantom obstacles, which nobody sees or hits: {', '.join(map(str, phantoms))}")
    return found + _kept_recordings(request, scene, changes, result)


def _late_entries(scene: Scene, changes: Changes, result: Resimulated) -> list[str]:
    """Who enters after time 0, for which CommonRoad's schema has no form."""
    steps = {key: plan.from_step for key, plan in result.plans.items() if plan.cause == "added"}
    steps |= {key: replay.track.first_step for key, replay in changes.replays.items()}
    late: dict[int, list[int]] = {}
    for key, step in sorted(steps.items(), key=lambda entry: (entry[1], entry[0])):
        if step > 0:
            late.setdefault(step, []).append(key)
    if not late:
        return []
    entries = [
        f"vehicle{'s' * (len(keys) > 1)} {', '.join(map(str, keys))} enter{'s' * (len(keys) == 1)} at "
        f"{step * scene.step_s:.1f} s"
        for step, keys in late.items()
    ]
    return [f"{', '.join(entries)}: CommonRoad's schema wants everybody there at time 0, its reader takes it"]


def _kept_recordings(request: ModificationRequest, scene: Scene, changes: Changes, result: Resimulated) -> list[str]:
    """Who should react to the edits and does not."""
    found = []
    if result.missing:
        found.append(
            f"vehicle {', '.join(map(str, result.missing))} keeps its recording, although it should react: SUMO did "
            "not take it, or the scenario ends"
        )
    mute = [key for key in scene.tracks if key not in {*result.plans, *changes.removed, *changes.replays}]
    if request.traffic == "reactive" and mute:
        found.append(f"cannot be driven, so that they keep their recording: {', '.join(map(str, mute))}")
    return found
