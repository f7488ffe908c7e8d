"""The tool that makes scenarios from maps."""

from pathlib import Path

from ...engine.catalog import open_catalogue
from ...engine.maps import MapMatch
from ...engine.tuning import DEFAULT_CONFIGURATION
from ...engine.workspace import Recipe, content_digest, versions_of
from ...schemas.errors import NotPossible, UnknownName, WorkerFailure
from ...schemas.generation import (
    GeneratedScenario,
    GenerateScenariosArguments,
    GenerateScenariosResult,
    GenerationRequest,
    ScenarioSummary,
)
from ...schemas.runs import NO_TRAJECTORY
from ..call import ToolCall
from ..configurations import resolve_configuration, store_configuration
from ..maps import maps_at_hand
from ..operations import GENERATE_SCENARIO
from ..runs import Cell, run_grid
from ..scenario_storage import store_scenario
from .record import REPORT, summarise
from .requests import AssignedSite, SiteAssignment, assign_sites, plan_maps, request_for

CHECK = "planner can run"
_ADVICE = "the default planner cannot run here; another seed makes other traffic and another ego"


async def generate_scenarios(arguments: GenerateScenariosArguments, call: ToolCall) -> GenerateScenariosResult:
    """Find the maps, make each scenario in a worker, store it, and say what was asked beside what came out.

    What could not be made is a note beside what was made.

    Raises:
        InvalidRequest: nothing could be made; the reason of the first scenario.
    """
    open_catalogue(call.workspace, with_starter=call.services.with_starter)  # first, or a starter would be the latest
    at_hand = await maps_at_hand(call)
    plan = plan_maps(arguments, at_hand.entries)
    sites = await assign_sites(arguments, call, plan.matches)
    made, failures = await _make_all(arguments, call, sites)
    call.made("scenario", *(summary.scenario_id for summary in made))
    notes = [*plan.notes, *at_hand.notes, *failures]
    if len(sites.planned) < arguments.count:
        notes.append(f"only {len(sites.planned)} different site(s) fit; {arguments.count} were asked for")
    used = {summary.map_id for summary in made}
    attributions = sorted({m.entry.facts.attribution for m in plan.matches if m.entry.facts.map_id in used})
    return GenerateScenariosResult(scenarios=made, notes=notes, attribution=attributions)


async def _make_all(
    arguments: GenerateScenariosArguments, call: ToolCall, sites: SiteAssignment
) -> tuple[list[ScenarioSummary], list[str]]:
    """The scenarios that could be made, and notes on those that could not.

    Raises:
        PlannerForgeError: nothing could be made.
    """
    made: list[ScenarioSummary] = []
    notes: list[str] = []
    refusals: list[NotPossible] = []
    spare = list(sites.spare)
    for index, site in enumerate(sites.planned):
        share = (index / len(sites.planned), (index + 1) / len(sites.planned))
        try:
            summary, given_up = await _make_somewhere(arguments, call, site, spare, index, share)
            made.append(await with_trial_run(call, summary) if arguments.trial_run else summary)
            notes += [f"another map was taken: {refusal.message}" for refusal in given_up]
        except NotPossible as refusal:
            refusals.append(refusal)
            notes.append(f"scenario {index + 1} was not made: {refusal.message}")
        except (UnknownName, WorkerFailure) as failure:
            if not made:
                raise
            notes.append(f"scenario {index + 1} and those after it were not made: {failure.message}")
            break
    if not made:
        raise refusals[0]
    return made, notes


async def _make_somewhere(
    arguments: GenerateScenariosArguments,
    call: ToolCall,
    site: AssignedSite,
    spare: list[MapMatch],
    index: int,
    share: tuple[float, float],
) -> tuple[ScenarioSummary, list[NotPossible]]:
    """A scenario at its site, otherwise on the first spare map where it can be made; and the refusals on the way.

    Spare maps that were tried are taken off the list.

    Raises:
        NotPossible: it can be made on none; the reason of the assigned site.
    """
    refusals: list[NotPossible] = []
    while True:
        try:
            request = request_for(arguments, site, index)
            return await _make(call, request, share), refusals
        except NotPossible as refusal:
            refusals.append(refusal)
        if not spare or arguments.goal.startswith("lanelet:"):  # an id means another lanelet elsewhere
            raise refusals[0]
        site = AssignedSite(spare.pop(0))


async def _make(call: ToolCall, request: GenerationRequest, share: tuple[float, float]) -> ScenarioSummary:
    """One scenario: the stored one where the same recipe made it before, otherwise a new one."""
    recipe = _recipe(request)
    number = int(recipe.digest[:7], 16) + 1
    stored = call.workspace.find_by_recipe("scenario", recipe)
    if stored is not None:
        kept = call.workspace.file("scenario", stored.artifact_id, REPORT)
        report = GeneratedScenario.model_validate_json(kept.read_bytes())
        return summarise(report, request, stored.artifact_id, reused=True)
    with call.workspace.scratch() as folder:
        numbered = request.model_copy(update={"folder": str(folder), "benchmark_number": number})
        scenario = await call.run(GENERATE_SCENARIO, numbered, share=share)
        xml, net, report_path = (folder / name for name in ("scenario.xml", "scenario.net.xml", REPORT))
        report_path.write_text(scenario.model_dump_json(), encoding="utf-8")
        artifact = await store_scenario(
            call, xml=xml, net=net, recipe=recipe, origin="generated", beside={REPORT: report_path}
        )
    return summarise(scenario, request, artifact.artifact_id, reused=False)


def _recipe(request: GenerationRequest) -> Recipe:
    """The resolved request without paths; the map counts by its content."""
    arguments = request.model_dump(mode="json", exclude={"map_path", "folder", "benchmark_number", "seed"})
    arguments["map_content"] = content_digest(Path(request.map_path))
    is_built_in = Path(request.map_path).parent.name == "library"
    parents = () if is_built_in else (request.map_id,)
    versions = versions_of("eclipse-sumo", "libsumo", "numpy")
    return Recipe(tool="generate_scenarios", arguments=arguments, parents=parents, seed=request.seed, versions=versions)


async def with_trial_run(call: ToolCall, summary: ScenarioSummary) -> ScenarioSummary:
    """The summary with what the default planner made of the scenario; the run is stored as any other.

    A collision or a missed goal is a result, not a fault of the scenario. The check fails where no run was possible:
    the planner found the problem invalid or no trajectory for it, or the run was lost. The scenario is handed out all
    the same, with a note.
    """
    configuration = resolve_configuration(DEFAULT_CONFIGURATION, call)
    store_configuration(call, configuration)
    (result,) = await run_grid(call, [Cell(summary.scenario_id, None, configuration)], lambda _: None)
    if result.record is not None:
        outcome = f"{result.record.outcome} ({DEFAULT_CONFIGURATION}, {result.record.run_id}): {result.record.reason}"
    else:
        outcome = result.lost.error if result.lost is not None else "no result"
    if result.record is not None and result.record.outcome not in NO_TRAJECTORY:
        return summary.model_copy(update={"trial_run": outcome, "checks_passed": [*summary.checks_passed, CHECK]})
    failed = {"checks_failed": [*summary.checks_failed, CHECK], "notes": [*summary.notes, _ADVICE]}
    return summary.model_copy(update={"trial_run": outcome, **failed})
