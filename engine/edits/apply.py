"""The operation behind ``modify_scenario``: edits in, a new scenario file out."""

import shutil
import tempfile
from pathlib import Path

from ...schemas.errors import NotPossible
from ...schemas.modification import ModificationOutcome, ModificationRequest
from ..commonroad import ScenarioDocument
from ..cosimulation import ROUTES_FILE, TYPES_FILE, SimulationSetup
from ..execution import ProgressReporter
from .edited_scene import SimulatedEdits
from .entries import check_entries
from .explanations import check_not_driven_past
from .operations import resolve_edits
from .report import outcome_of, reported_collisions
from .scene_cache import scene_of
from .simulation import EditRun
from .writing import write_edits

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
    document = ScenarioDocument.read(request.xml)
    report(0.3, "resolving the edits")
    base, first_id = kept.scene, document.highest_id + 1
    resolved = resolve_edits(request.edits, base, first_id, request.earlier)
    with tempfile.TemporaryDirectory() as folder:
        net = Path(folder) / NET_FILE
        net.write_text(base.sumo_net, encoding="utf-8")
        report(0.4, "simulating")
        setup = SimulationSetup(
            net, net.parent, base.step_s, base.last_step, request.seed, keeps_routes=request.keep_simulation
        )
        before = kept.ego_before(setup)
        simulated = EditRun(request, base, setup, before, first_id).simulate(resolved)
        _check(request, simulated)
        report(0.8, "writing")
        notes = write_edits(document, simulated)
        files = (None, None) if request.dry_run else _write_files(request, document, net)
        if request.keep_simulation and not request.dry_run and simulated.result.tracks:
            # What the last simulation left, which is the one whose motion was written.
            for name in (TYPES_FILE, ROUTES_FILE):
                shutil.copyfile(setup.folder / name, request.output / name)
    return outcome_of(request, simulated, None if before is None else before.danger, files, notes)


def _check(request: ModificationRequest, simulated: SimulatedEdits) -> None:
    result = simulated.result
    lost = [key for key in result.missing if key in simulated.changes.driven]
    if lost:
        raise NotPossible(
            f"vehicle {', '.join(map(str, lost))} cannot be driven: SUMO did not take, or the scenario ends",
            valid=[key for key in simulated.scene.tracks if key not in lost],
            next_step="choose another vehicle or place",
        )
    check_entries(simulated)
    for key in simulated.changes.driven:
        check_not_driven_past(simulated, key)
    hits = reported_collisions(simulated)
    if hits and request.on_conflict == "refuse":
        pairs = [f"{hit.vehicles[0]} with {hit.vehicles[1]} at {hit.time_s:.1f} s" for hit in hits]
        raise NotPossible(
            f"the edits cause collisions: {'; '.join(pairs)}",
            valid=["on_conflict=report"],
            next_step="accept them with on_conflict=report, or change the edit",
        )


def _write_files(request: ModificationRequest, document: ScenarioDocument, net: Path) -> tuple[Path, Path]:
    request.output.mkdir(parents=True, exist_ok=True)
    xml, kept_net = request.output / SCENARIO_FILE, request.output / NET_FILE
    document.write(xml, request.benchmark_id)
    kept_net.write_bytes(net.read_bytes())
    return xml, kept_net
