"""The operation behind ``modify_scenario``: edits in, a new scenario file out.

An edit is a function ``(edit, scene, changes) -> EditStep``: it receives the scene and the changes made by the previous
edits. It neither simulates nor writes. To add an edit, write a function like this in one of the modules of
``OPERATIONS``, and add a row with its arguments to the table in the tool's schema (``EDITS``).
"""

import itertools
import shutil
import tempfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from ...schemas.errors import Faults, InvalidRequest, NotPossible, with_values
from ...schemas.modification import EDITS, Edit, EditOperation, EditReport, ModificationOutcome, ModificationRequest
from ..commonroad import ScenarioDocument, Track
from ..cosimulation import (
    ROUTES_FILE,
    TYPES_FILE,
    DrivePlan,
    SimulationSetup,
    behaviour_from,
    not_drivable,
    recorded_plan,
    usual_behaviour,
)
from ..execution import ProgressReporter, silent
from ..scene import Scene
from ..vehicles import vehicle_classes
from . import ego, moving, population, rerouting, scripted, trajectory
from .changes import Changes, EditStep
from .edited_scene import SimulatedEdits, SimulationResult
from .ego_risk import EgoRisk, drive_after, ego_risk_after, shown_ego
from .entries import check_entries, slower_entries
from .explanations import check_not_driven_past, is_red
from .given import GivenScenario
from .moving import crossing_step
from .placement import first_place
from .references import describe_matches, select, target_lanelets
from .refusals import check_arguments, of_several
from .report import outcome_of
from .scene_cache import KeptScene, scene_of
from .simulation import Simulation
from .world import TRANSFORMS, transformed, weather_of
from .writing import write_edits

SCENARIO_FILE, NET_FILE = "scenario.xml", "scenario.net.xml"
_MODULES = (rerouting, trajectory, scripted, population, moving, ego)
_FUNCTIONS: Mapping[str, str] = {"replace": "replace_vehicle"}
"""Edits with a function of another name, because many modules import a function with the edit's name."""
EditFunction = Callable[[Edit, Scene, Changes], EditStep]
OPERATIONS: Mapping[EditOperation, EditFunction] = {
    op: next(getattr(module, _FUNCTIONS.get(op, op)) for module in _MODULES if hasattr(module, _FUNCTIONS.get(op, op)))
    for op in EDITS
    if op not in TRANSFORMS
}
"""The edits by their operation: each is the function of this name in one of these modules. Those that change a whole
file are in ``world.TRANSFORMS``.
"""


def apply_edits(request: ModificationRequest, report: ProgressReporter) -> ModificationOutcome:
    """Apply all edits in one re-simulation from the base scenario, or refuse the request.

    An edit that changes the scene itself (its lights, its extent) splits the list: the edits before it are applied
    first, and the edits after it start from its result.

    Raises:
        InvalidRequest: an edit is not valid, or the scenario does not allow it.
        NotPossible: a vehicle would enter at an occupied position, or collisions remain and the request refuses them.
        UnsafeInput: the file is not readable.
    """
    if not any(edit.op in TRANSFORMS for edit in request.edits):
        given = None if request.given is None else GivenScenario.of(request)
        applied = _apply_stage(request, report, _Stage(), given)
        return applied.outcome if given is None else given.compared(applied.outcome, request, applied.simulated)
    with tempfile.TemporaryDirectory() as folder:
        return _apply_in_stages(request, report, Path(folder))


@dataclass(frozen=True)
class _Stage:
    """What earlier edits pass on to the edits of a stage.

    ``added``: the ids that each earlier edit added. ``yielding_to``: the lanelets with changed lights (SUMO drives
    recorded vehicles that would now cross them at red, so that they obey). ``first``: the index of the first new edit
    in the call.
    """

    added: tuple[tuple[int, ...], ...] = ()
    yielding_to: frozenset[int] = frozenset()
    first: int = 0


def _apply_in_stages(request: ModificationRequest, report: ProgressReporter, folder: Path) -> ModificationOutcome:
    """Apply the edits up to the next edit that changes the scene itself, then that edit, and so on."""
    xml, stage, outcomes, given = request.xml, _Stage(), list[ModificationOutcome](), GivenScenario.of(request)
    pending = list(enumerate(request.edits))
    while True:
        own = list(itertools.takewhile(lambda item: item[1].op not in TRANSFORMS, pending))
        rest = pending[len(own) :]
        begin = own[0][0] if own else len(request.edits) - len(rest)
        is_last = not rest
        part = request.model_copy(
            update={
                "xml": xml,
                "edits": tuple(edit for _, edit in own),
                "earlier": min(max(request.earlier - begin, 0), len(own)),
                "output": request.output if is_last else folder / str(len(outcomes)),
                "dry_run": request.dry_run and is_last,
                "keep_simulation": request.keep_simulation and is_last,
            }
        )
        if own or stage.yielding_to or is_last:
            stage = replace(stage, first=max(begin - request.earlier, 0))
            applied = _apply_stage(part, silent if not is_last else report, stage, given, reports_ego=is_last)
            outcomes.append(applied.outcome)
            xml, stage = applied.outcome.xml or xml, _Stage((*stage.added, *applied.added))
        if is_last:
            return given.compared(_joined_outcome(request, outcomes), request, applied.simulated)
        index, edit = rest[0]
        number = index - request.earlier
        where = f"edit {number} ({edit.op})" if len(request.edits) - request.earlier > 1 else ""
        changed = folder / f"changed{index}.xml"
        faults = Faults()
        with faults.collecting(where, ("edits", number)):
            check_arguments(edit)
            what = _transformed(edit, xml, request, changed)
        faults.raise_all()
        outcomes.append(_transform_outcome(index - request.earlier, edit, what))
        given = given if number < 0 else given.after(edit, changed, request)
        lights = frozenset(_lanelets_of_lights(edit, changed)) if edit.op == "set_light" else frozenset[int]()
        xml, stage, pending = changed, _Stage((*stage.added, ()), lights), rest[1:]


def _transformed(edit: Edit, xml: Path, request: ModificationRequest, output: Path) -> str:
    """Apply an edit of the scene to a file, and return what was done."""
    kept = scene_of(xml, request.problem_id)
    with tempfile.TemporaryDirectory() as name:
        net = Path(name) / NET_FILE
        net.write_text(kept.scene.sumo_net, encoding="utf-8")
        setup = SimulationSetup(net, net.parent, kept.scene.step_s, kept.scene.last_step, request.seed)
        return transformed(edit, xml, kept.scene, partial(ego_of_base, kept, setup), output)


def _lanelets_of_lights(edit: Edit, xml: Path) -> tuple[int, ...]:
    scene = scene_of(xml).scene
    return tuple(target_lanelets(edit.to, scene, Changes(next_id=0, driven={})))


def _transform_outcome(index: int, edit: Edit, what: str) -> ModificationOutcome:
    """Return the outcome of an edit of the scene itself."""
    report = EditReport(index=index, op=edit.op, letter=EDITS[edit.op].letter, done=True, what=what)
    return ModificationOutcome(xml=None, net=None, edits=(report,) if index >= 0 else ())


def _joined_outcome(request: ModificationRequest, outcomes: list[ModificationOutcome]) -> ModificationOutcome:
    """Return the outcome of all stages: the last stage's files and figures, and what each stage did."""
    last = outcomes[-1]
    reports = [report for outcome in outcomes for report in outcome.edits]
    touched = {vehicle.vehicle_id: vehicle for outcome in outcomes for vehicle in outcome.touched}
    now = {vehicle.vehicle_id for vehicle in last.touched}
    return last.model_copy(
        update={
            "edits": tuple(report.model_copy(update={"index": place}) for place, report in enumerate(reports)),
            "touched": tuple(vehicle for _, vehicle in sorted(touched.items())),
            "removed": tuple(sorted({key for outcome in outcomes for key in outcome.removed})),
            "collisions": tuple(hit for outcome in outcomes for hit in outcome.collisions),
            "untouched": max(last.untouched - len(touched.keys() - now), 0),
            "warnings": tuple(dict.fromkeys(text for outcome in outcomes for text in outcome.warnings)),
            "weather": next((word for edit in reversed(request.edits) if (word := weather_of(edit))), ""),
            "xml": None if request.dry_run else last.xml,
            "net": None if request.dry_run else last.net,
        }
    )


@dataclass(frozen=True)
class _Applied:
    """The outcome of a stage, its edits after their simulation, and the ids that each edit added."""

    outcome: ModificationOutcome
    simulated: SimulatedEdits

    @property
    def added(self) -> tuple[tuple[int, ...], ...]:
        return tuple(step.added for step in self.simulated.steps)


def _apply_stage(
    request: ModificationRequest,
    report: ProgressReporter,
    stage: _Stage,
    given: GivenScenario | None,
    *,
    reports_ego: bool = True,
) -> _Applied:
    """Apply edits in one re-simulation.

    ``given``: the scenario to compare the ego's risk with; None for the base. ``reports_ego``: whether the outcome
    contains the ego's risk.
    """
    report(0.0, "reading the scenario")
    kept = scene_of(request.xml, request.problem_id)
    document = ScenarioDocument.read(request.xml)
    report(0.3, "resolving the edits")
    base, first_id = kept.scene, document.highest_id + 1
    with tempfile.TemporaryDirectory() as folder:
        net = Path(folder) / NET_FILE
        net.write_text(base.sumo_net, encoding="utf-8")
        setup = SimulationSetup(
            net, net.parent, base.step_s, base.last_step, request.seed, keeps_routes=request.keep_simulation
        )
        start = Changes(
            next_id=first_id,
            driven=_obeying(base, stage.yielding_to),
            added_by_edit=stage.added,
            ego_drive=partial(ego_of_base, kept, setup),
        )
        resolved = resolved_edits(request.edits, base, start, request.earlier, stage.first)
        report(0.4, "simulating")
        simulated = simulated_edits(request, kept, setup, start, resolved)
        risks: tuple[EgoRisk | None, EgoRisk | None] = (None, None)
        if reports_ego:
            before = kept.ego_before(setup) if given is None else given.before
            risks = None if before is None else before.danger, _risk_after(request, simulated, given)
        report(0.8, "writing")
        notes = write_edits(document, simulated)
        files = (None, None) if request.dry_run else _write_files(request, document, net)
        if request.keep_simulation and not request.dry_run and simulated.result.tracks:
            # The files of the last simulation, which produced the written motion.
            for name in (TYPES_FILE, ROUTES_FILE):
                shutil.copyfile(setup.folder / name, request.output / name)
    return _Applied(outcome_of(request, simulated, risks, files, notes), simulated)


def _risk_after(request: ModificationRequest, simulated: SimulatedEdits, given: GivenScenario | None) -> EgoRisk | None:
    """Return the ego's risk after the edits; None if there is no ego."""
    if given is not None:
        return given.risk_after(request, simulated)
    return None if simulated.ego is None else ego_risk_after(simulated.ego, simulated)


def _obeying(scene: Scene, lanelets: frozenset[int]) -> dict[int, DrivePlan]:
    """Return plans that make recorded vehicles obey if they would cross the end of a lanelet at red."""
    plans = {}
    for key, track in scene.tracks.items():
        for lanelet in lanelets.intersection(scene.matches[key].sequence) if key in scene.matches else ():
            step = crossing_step(scene, track, lanelet)
            if step is not None and is_red(scene, lanelet, step) and not not_drivable(scene, key):
                plans[key] = recorded_plan(scene, key, "handed_over", track.first_step)
    return dict(sorted(plans.items()))


@dataclass(frozen=True)
class ResolvedEdits:
    """Edits, what each of them did, the changes after the last edit, and the base scene with these changes."""

    edits: tuple[Edit, ...]
    steps: tuple[EditStep, ...]
    changes: Changes
    scene: Scene


def ego_of_base(kept: KeptScene, setup: SimulationSetup) -> Track | None:
    """Return the ego's motion under an ordinary driver in the base scenario; None if there is no ego."""
    drive = kept.ego_before(setup)
    return None if drive is None else drive.track


def resolved_edits(
    edits: tuple[Edit, ...], base: Scene, start: Changes, earlier: int = 0, first: int = 0
) -> ResolvedEdits:
    """Apply edits in order; if one is refused, all are refused. Every edit sees the scene after the previous edits.

    ``start``: the changes before the first edit. ``earlier``: how many edits come from earlier calls; in errors, the
    numbering of the other edits starts at ``first``.

    Raises:
        InvalidRequest: edits that are not valid or that the scenario does not allow; all of them are reported together.
    """
    changes, scene, steps, faults = start, base, list[EditStep](), Faults()
    for index, edit in enumerate(edits):
        if faults and edit.names_added:  # its vehicles may be those that a refused edit should add
            continue
        step = None
        number = index - earlier + first
        where = f"edit {number} ({edit.op})" if first or len(edits) - earlier > 1 else ""
        place = ("edits", number)
        with faults.collecting(where, place):
            check_arguments(edit)
            step = _performed(edit, scene, changes)
        if step is None:
            with faults.collecting(where, place):
                _other_faults(edit, scene, changes).raise_all()
            changes = replace(changes, added_by_edit=(*changes.added_by_edit, ()))
            continue
        matches = describe_matches(edit.vehicles, step.vehicles, scene, changes)
        changes = replace(step.changes, added_by_edit=(*changes.added_by_edit, step.added))
        scene = _scene_after(base, changes)
        steps.append(replace(step, changes=changes, meant=matches))
    faults.raise_all()
    ego.check_goal(scene, changes)
    return ResolvedEdits(edits, tuple(steps), changes, scene)


def _performed(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Return the result of an edit; a refusal says which of its vehicles the edit does not suit.

    Raises:
        InvalidRequest: the edit is not valid, or the scenario does not allow it.
    """
    apply = OPERATIONS[edit.op]
    try:
        return apply(edit, scene, changes)
    except InvalidRequest as refusal:
        raise of_several(refusal, edit, scene, changes, apply) from refusal


def _other_faults(edit: Edit, scene: Scene, changes: Changes) -> Faults:
    """Return further faults of a refused edit: each of its arguments is checked separately.

    An argument that is valid but cannot be applied is not a fault here: the edit itself reports it.
    """
    looks: list[Callable[[], object]] = [
        *(partial(select, [text.strip().removeprefix("!")], scene, changes) for text in edit.vehicles),
        *(partial(target_lanelets, [text], scene, changes) for text in edit.to),
        *(partial(behaviour_from, usual_behaviour(vehicle_classes()["car"]), None, [text]) for text in edit.params),
    ]
    if edit.preset is not None:
        looks.append(partial(behaviour_from, usual_behaviour(vehicle_classes()["car"]), edit.preset, ()))
    if edit.at is not None:
        looks.append(partial(first_place, edit, scene, changes, vehicle_classes()["car"].length_m))
    faults = Faults()
    for look in looks:
        with faults.collecting(), suppress(NotPossible):
            look()
    return faults


def _scene_after(base: Scene, changes: Changes) -> Scene:
    """Return the base scene with time-shifted recordings, added pedestrians and the ego's new start.

    It contains vehicles that SUMO will drive as recorded. Edits and the simulation use this scene.
    """
    if not changes.replays and changes.ego is None:
        return base
    tracks = base.tracks | {key: replay.track for key, replay in changes.replays.items()}
    matches = {key: match for key, match in base.matches.items() if key not in changes.replays}
    matches |= {key: replay.match for key, replay in changes.replays.items() if replay.match is not None}
    return replace(
        base, tracks=dict(sorted(tracks.items())), matches=dict(sorted(matches.items())), ego=changes.ego or base.ego
    )


@dataclass(frozen=True)
class _Run:
    """Data that all simulations of a request share.

    ``start``: the changes before the first edit. ``reports_ego``: whether the ego's drive is needed even if no
    simulated vehicle could see the ego.
    """

    request: ModificationRequest
    kept: KeptScene
    setup: SimulationSetup
    start: Changes
    reports_ego: bool = True

    @property
    def base(self) -> Scene:
        """The scene before the edits."""
        return self.kept.scene

    def simulate(self, resolved: ResolvedEdits) -> SimulatedEdits:
        """Simulate the resolved edits.

        If an added vehicle without a given speed collides on entry, it enters more slowly, provided that this leaves
        fewer collisions.
        """
        usual = self._simulate_once(resolved)
        slower = slower_entries(usual)
        if slower is None:
            return usual
        edits, notes = slower
        try:
            other = self._simulate_once(resolved_edits(edits, self.base, self.start, self.request.earlier))
        except InvalidRequest:  # an edit that selects by speed ("fastest") may match no vehicle then
            other = usual
        if len(other.result.overlaps) < len(usual.result.overlaps):
            return replace(other, notes=notes)
        # The last simulation leaves its files behind; they must be those of the written motion.
        return self._simulate_once(resolved)

    def _simulate_once(self, resolved: ResolvedEdits) -> SimulatedEdits:
        scene, changes = resolved.scene, resolved.changes
        all_react = self.request.traffic == "reactive"
        if not (self.reports_ego or changes.driven or all_react):
            result = Simulation(scene, changes, self.setup).until_clear((), all_react=False)
            if not result.plans:  # no vehicle is simulated, so it does not matter where the ego is
                return SimulatedEdits(scene, changes, result, None, resolved.edits, resolved.steps)
        drive = drive_after(self.kept.ego_before(self.setup), self.base, scene, changes, self.setup)
        if changes.driven or changes.replays or all_react:
            result = Simulation(scene, changes, self.setup).until_clear(shown_ego(scene, drive), all_react=all_react)
        else:  # edits that only remove vehicles or set goals leave all recordings unchanged
            result = SimulationResult({}, {}, (), ())
        return SimulatedEdits(scene, changes, result, drive, resolved.edits, resolved.steps)


def simulated_edits(
    request: ModificationRequest,
    kept: KeptScene,
    setup: SimulationSetup,
    start: Changes,
    resolved: ResolvedEdits,
    *,
    reports_ego: bool = True,
) -> SimulatedEdits:
    """Return resolved edits after their simulation and all checks.

    Args:
        request: what to do about collisions, and whether all vehicles react.
        kept: the base scene.
        setup: the simulation.
        start: the changes before the first edit.
        resolved: the edits.
        reports_ego: whether the ego's drive is needed even if no simulated vehicle could see the ego.

    Raises:
        NotPossible: a vehicle cannot be driven or would enter at an occupied position, or collisions remain and the
            request refuses them.
    """
    simulated = _Run(request, kept, setup, start, reports_ego).simulate(resolved)
    _check(request, simulated)
    return simulated


def _check(request: ModificationRequest, simulated: SimulatedEdits) -> None:
    result = simulated.result
    lost = [key for key in result.missing if key in simulated.changes.driven]
    if lost:
        raise NotPossible(
            f"vehicle {', '.join(map(str, lost))} cannot be driven: SUMO did not insert it, or the scenario ends",
            valid=[key for key in simulated.scene.tracks if key not in lost],
            next_step="choose another vehicle or place",
        )
    check_entries(simulated)
    for key in simulated.changes.driven:
        check_not_driven_past(simulated, key)
    hits = simulated.collisions
    if hits and request.on_conflict == "refuse":
        pairs = [f"{hit.vehicles[0]} with {hit.vehicles[1]} at {hit.time_s:.1f} s" for hit in hits]
        raise NotPossible(
            f"the edits cause collisions: {'; '.join(pairs)}",
            valid=["on_conflict=report"],
            next_step="accept them with on_conflict=report, or change the edit",
            remedies=[with_values(on_conflict="report")],
        )


def _write_files(request: ModificationRequest, document: ScenarioDocument, net: Path) -> tuple[Path, Path]:
    request.output.mkdir(parents=True, exist_ok=True)
    xml, kept_net = request.output / SCENARIO_FILE, request.output / NET_FILE
    document.write(xml, request.benchmark_id)
    kept_net.write_bytes(net.read_bytes())
    return xml, kept_net
