"""One scenario: made in a worker and stored, or found by its recipe; and the default planner's run on it."""

from pathlib import Path
from typing import Any

from ...engine.catalog import ID_TAKEN
from ...engine.tuning import DEFAULT_CONFIGURATION
from ...engine.workspace import Recipe, content_digest, versions_of
from ...schemas.errors import NotPossible
from ...schemas.generation import GeneratedScenario, GenerationRequest, ScenarioSummary
from ...schemas.runs import NO_TRAJECTORY
from ..configurations import resolve_configuration, store_configuration
from ..context import WorkflowContext
from ..operations import GENERATE_SCENARIO
from ..runs import Cell, run_grid
from ..scenario_storage import store_scenario
from .conditions import circumstances_of
from .record import REPORT, summarise

CHECK = "planner can run"
_ADVICE = "the default planner cannot run here; another seed makes other traffic and another ego"


async def make_scenario(
    context: WorkflowContext, request: GenerationRequest, share: tuple[float, float]
) -> ScenarioSummary:
    """One scenario: the stored one where the same recipe made it before, otherwise a new one.

    Of a million scenarios some dozens would get the id of another one: such a one is made again with other digits of
    its digest in the id.

    Raises:
        NotPossible: it cannot be made, or another scenario has both of its ids.
    """
    recipe = recipe_of(request)
    stored = context.workspace.find_by_recipe("scenario", recipe)
    if stored is not None:
        kept = context.workspace.file("scenario", stored.artifact_id, REPORT)
        report = GeneratedScenario.model_validate_json(kept.read_bytes())
        return summarise(report, request, stored.artifact_id, reused=True)
    try:
        return await _made(context, request, recipe, recipe.digest[:7], share)
    except NotPossible as refusal:
        if refusal.reason != ID_TAKEN:
            raise
    return await _made(context, request, recipe, recipe.digest[5:], share)


async def _made(
    context: WorkflowContext, request: GenerationRequest, recipe: Recipe, digits: str, share: tuple[float, float]
) -> ScenarioSummary:
    number = int(digits, 16) + 1
    with context.workspace.scratch() as folder:
        numbered = request.model_copy(update={"folder": str(folder), "benchmark_number": number})
        scenario = await context.run(GENERATE_SCENARIO, numbered, share=share)
        xml, net, report_path = (folder / name for name in ("scenario.xml", "scenario.net.xml", REPORT))
        report_path.write_text(scenario.model_dump_json(), encoding="utf-8")
        artifact = await store_scenario(
            context,
            xml=xml,
            net=net,
            recipe=recipe,
            origin="generated",
            beside={REPORT: report_path},
            circumstances=circumstances_of(request.conditions),
        )
    return summarise(scenario, request, artifact.artifact_id, reused=False)


def recipe_of(request: GenerationRequest) -> Recipe:
    """The resolved request without paths; the map counts by its content."""
    arguments = request.model_dump(mode="json", exclude={"map_path", "folder", "benchmark_number", "seed"})
    arguments["map_content"] = content_digest(Path(request.map_path))
    is_built_in = Path(request.map_path).parent.name == "library"
    parents = () if is_built_in else (request.map_id,)
    versions = versions_of("eclipse-sumo", "libsumo", "numpy")
    return Recipe(tool="generate_scenarios", arguments=arguments, parents=parents, seed=request.seed, versions=versions)


def shape_of(request: GenerationRequest) -> dict[str, Any]:
    """What a request says of its scenario: not on which copy of a map, at which of its sites, and by which numbers."""
    numbers = {"map_path", "folder", "benchmark_number", "seed", "index", "site_index", "site_step"}
    others = {"most_sites", "most_rounds", "place", "country", "attribution"}
    return request.model_dump(mode="json", exclude=numbers | others)


async def with_trial_run(context: WorkflowContext, summary: ScenarioSummary) -> ScenarioSummary:
    """The summary with what the default planner made of the scenario; the run is stored as any other.

    A collision or a missed goal is a result, not a fault of the scenario. The check fails where no run was possible:
    the planner found the problem invalid or no trajectory for it, or the run was lost. The scenario is handed out all
    the same, with a note.
    """
    configuration = resolve_configuration(DEFAULT_CONFIGURATION, context)
    store_configuration(context, configuration)
    (result,) = await run_grid(context, [Cell(summary.scenario_id, None, configuration)], lambda _: None)
    if result.record is not None:
        outcome = f"{result.record.outcome} ({DEFAULT_CONFIGURATION}, {result.record.run_id}): {result.record.reason}"
    else:
        outcome = result.lost.error if result.lost is not None else "no result"
    if result.record is not None and result.record.outcome not in NO_TRAJECTORY:
        return summary.model_copy(update={"trial_run": outcome, "checks_passed": [*summary.checks_passed, CHECK]})
    failed = {"checks_failed": [*summary.checks_failed, CHECK], "notes": [*summary.notes, _ADVICE]}
    return summary.model_copy(update={"trial_run": outcome, **failed})
