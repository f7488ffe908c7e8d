"""Single jobs of ``make bench-generation``: convert a whole map, carry out and judge a request, check a refusal."""

import asyncio
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from plannerforge.engine.commonroad import LoadedScenario, read_scenario, schema_errors
from plannerforge.engine.execution import silent
from plannerforge.engine.generation import generate_scenario
from plannerforge.engine.generation.site_network import convert_map
from plannerforge.engine.maps import MapEntry, MapMatch, is_net
from plannerforge.engine.network import build_road_network, read_net
from plannerforge.engine.planners import make_planner, simulate
from plannerforge.engine.vehicles import vehicle_of
from plannerforge.evals.ground_truth.generation import BenchRequest, Refusal, is_right_reason
from plannerforge.evals.scoring.common import built_in
from plannerforge.evals.scoring.made_files import (
    EXIT_WITHIN_M,
    SHOWN_BY_TAGS,
    STREET_WITHIN_M,
    MadeFiles,
    has_vehicles,
    is_at_street,
    is_in_box,
    judge_density,
    shows_type,
)
from plannerforge.evals.scoring.map_evidence import BenchMaps, MapEvidence, read_evidence
from plannerforge.schemas.errors import NotPossible, PlannerForgeError
from plannerforge.schemas.generation import GeneratedScenario, GenerateScenariosArguments, GenerationRequest
from plannerforge.schemas.runs import NO_TRAJECTORY
from plannerforge.server.arguments.checking import read_arguments
from plannerforge.workflows.generation.map_choice import (
    AssignedSite,
    SiteAssignment,
    assign_sites,
    plan_maps,
    request_for,
)
from plannerforge.workflows.generation.specification import read_specification

from ..harness import call_in_process
from .figures import DEFECT, Made, Stages, print_verdict
from .motion import measure_motion

_CHECKED_TRACKS = 3
"""Tracks checked for each scenario (chosen): a check takes half a second."""
_BEYOND_MAP_DEG, _BEYOND_BOX_DEG = 0.01, 0.0001
"""Tolerance of a map's bounds, because its roads extend beyond them; a requested box allows only rounding (10 m)."""


@dataclass
class Session:
    """The state of one process between requests: the maps, those that the generator has read, and their evidence."""

    maps: BenchMaps
    _read: set[str] = field(default_factory=set)
    _evidence: dict[str, MapEvidence] = field(default_factory=dict)

    def reads(self, map_path: Path | str) -> bool:
        """Record that the generator reads a map; return True if it is the first time."""
        first = str(map_path) not in self._read
        self._read.add(str(map_path))
        return first

    def evidence(self, map_path: str) -> MapEvidence:
        """Return the evidence of a map file, read once."""
        if map_path not in self._evidence:
            self._evidence[map_path] = read_evidence(Path(map_path))
        return self._evidence[map_path]


def convert_whole(name: str, maps: BenchMaps) -> str:
    """Convert a map without cutting; empty, or why it failed."""
    if name in maps.unread:
        return maps.unread[name]
    with tempfile.TemporaryDirectory() as folder:
        net_path = Path(folder) / "whole.net.xml"
        try:
            convert_map(maps.files[name], net_path, lefthand=maps.drives_left(name))
            network = build_road_network(read_net(net_path), step_s=0.1, elapsed_s=0.0)
        except PlannerForgeError as error:
            return error.message
    return "" if network.lanelets else "no lanelets"


def make_group(requests: Sequence[tuple[BenchRequest, int]], maps: BenchMaps) -> list[list[Made]]:
    """Make and judge the scenarios of requests for one map, each with the seed that draws the tracks to be checked."""
    session = Session(maps)
    return [make_all(request, session, seed) for request, seed in requests]


def make_all(request: BenchRequest, session: Session, seed: int) -> list[Made]:
    """Make and judge all scenarios of a request at the sites that the tool assigns; ``seed`` draws checked tracks."""
    try:
        assigned = _assigned_sites(request.arguments, session.maps.entries)
    except PlannerForgeError as error:
        made = [_failed(request, error)]
        print_verdict(made[0])
        return made
    if request.arguments.count > 1:  # the sites were counted, for which these maps were read
        for site in assigned.planned:
            session.reads(site.match.entry.path)
    spare = list(assigned.spare)
    made = [
        _make_somewhere(request, site, spare, session, index, seed + index)
        for index, site in enumerate(assigned.planned)
    ]
    for scenario in made:
        print_verdict(scenario)
    return made


def _assigned_sites(arguments: GenerateScenariosArguments, maps: Sequence[MapEntry]) -> SiteAssignment:
    spec = read_specification(arguments)
    return asyncio.run(assign_sites(spec, call_in_process(), plan_maps(spec, maps).matches))


def _failed(request: BenchRequest, error: PlannerForgeError) -> Made:
    return Made(request, fault=f"{type(error).__name__}: {error.message}")


def _make_somewhere(
    request: BenchRequest, site: AssignedSite, spare: list[MapMatch], session: Session, index: int, seed: int
) -> Made:
    """Generate a scenario as requested, otherwise on the first spare map that allows it, as the tool does."""
    try:
        asked = request_for(read_specification(request.arguments), site, index)
        return _make(request, asked, session, seed)
    except NotPossible as error:
        if not spare:
            return _failed(request, error)
        return _make_somewhere(request, AssignedSite(spare.pop(0)), spare, session, index, seed)
    except PlannerForgeError as error:
        return _failed(request, error)
    except Exception as error:  # noqa: BLE001 - a defect of ours is the failure of one scenario, not the bench's end
        return Made(request, fault=f"{DEFECT}{error!r}")


def _make(request: BenchRequest, asked: GenerationRequest, session: Session, seed: int) -> Made:
    """Generate one scenario and judge it.

    Raises:
        PlannerForgeError: it cannot be generated.
    """
    with tempfile.TemporaryDirectory() as text:
        folder, stages = Path(text), Stages(first_read=session.reads(asked.map_path))
        report = generate_scenario(asked.model_copy(update={"folder": text}), stages)
        stages(1.0)
        faults = schema_errors(folder / "scenario.xml")
        if faults:
            return Made(request, fault=f"breaks the schema: {faults[0]}", notes=report.notes)
        loaded = read_scenario(folder / "scenario.xml")
        files, evidence = MadeFiles.read(folder), session.evidence(asked.map_path)
        executable, outcome = _drive(loaded)
        return Made(
            request,
            executable=executable,
            outcome=outcome,
            road_type=_is_of_type(asked, report, files, evidence),
            vehicles=has_vehicles(files, _required_vehicles(asked)),
            place=_place_is_right(request, asked, report, files, session),
            density=judge_density(files, asked.density, report.notes),
            motion=measure_motion(loaded, _CHECKED_TRACKS, seed),
            stages=stages,
            notes=report.notes,
        )


def _is_of_type(
    asked: GenerationRequest, report: GeneratedScenario, files: MadeFiles, evidence: MapEvidence
) -> bool | None:
    """Return True if the site has the requested type, or the answer's type if any was allowed; the answer must agree.

    None if only tags determine the type and the map is a SUMO network, which has none.
    """
    stated = report.site.scenario_type
    if stated in SHOWN_BY_TAGS and is_net(Path(asked.map_path)):
        return None
    return asked.scenario_type in (stated, "any") and shows_type(files, stated, evidence)


def _required_vehicles(request: GenerationRequest) -> dict[str, tuple[int, int | None]]:
    """Return (least, most) of every required class, including the ego's class."""
    required = {demand.vehicle_class: (demand.needed, demand.most) for demand in request.vehicles}
    ego = str(request.ego)
    other = ego.removeprefix("type:")
    return required | ({other: (1, None)} if ego.startswith("type:") and other not in (*required, "car") else {})


def _drive(loaded: LoadedScenario) -> tuple[bool, str]:
    """Return whether Frenetix with its default weights finishes a trajectory, and the outcome."""
    default, planner, problem = built_in("frenetix:Default"), make_planner("frenetix"), loaded.problem()
    try:
        vehicle = vehicle_of(default.settings, loaded.ego_class(int(problem.planning_problem_id)))
    except NotPossible:  # a vehicle with a trailer
        return False, "refused"
    run = simulate(loaded.scenario, problem, default, planner, "constant_velocity", silent, vehicle=vehicle)
    return run.final.outcome not in NO_TRAJECTORY, run.final.outcome


def _place_is_right(
    request: BenchRequest, asked: GenerationRequest, report: GeneratedScenario, files: MadeFiles, session: Session
) -> bool:
    """Return True if the map is the requested one or of the same place, in the country and box, and near the street."""
    name, country = session.maps.name_of(asked.map_id), request.arguments.country
    shown, box, street = session.maps.places[name], request.arguments.bbox, request.street
    meant = name == request.map_name or request.arguments.place in shown["places"]
    there = is_in_box(files, shown["bbox"], _BEYOND_MAP_DEG) and (box is None or is_in_box(files, box, _BEYOND_BOX_DEG))
    within_m = EXIT_WITHIN_M if asked.scenario_type == "ramp" else STREET_WITHIN_M
    on_street = street is None or is_at_street(
        files, street, shown["places"], session.evidence(asked.map_path), within_m
    )
    return meant and there and on_street and country in (None, report.benchmark_id[:3])


def refused_right(refusal: Refusal, maps: Sequence[MapEntry]) -> str:
    """Return an empty text if a request is refused for the right reason, otherwise what happened."""
    try:
        given = read_arguments(GenerateScenariosArguments, refusal.given)
        arguments = GenerateScenariosArguments.model_validate(given)
        site = _assigned_sites(arguments, maps).planned[0]
        asked = request_for(read_specification(arguments), site, 0)
        with tempfile.TemporaryDirectory() as folder:
            generate_scenario(asked.model_copy(update={"folder": folder}), silent)
    except PlannerForgeError as error:
        return "" if is_right_reason(refusal, error) else error.text
    return f"was made in {asked.map_id}"
