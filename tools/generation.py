"""The tool that makes scenarios from maps."""

from pathlib import Path

from plannerforge.engine.maps.index import MapMatch
from plannerforge.engine.workspace.recipe import Recipe, versions_of
from plannerforge.schemas.generation import (
    GeneratedScenario,
    GenerateScenariosArguments,
    GenerateScenariosResult,
    GenerationRequest,
    ScenarioSummary,
    SiteCount,
)
from plannerforge.tools.call import ToolCall
from plannerforge.tools.generation_answer import summarise
from plannerforge.tools.generation_plan import plan_maps, request_for
from plannerforge.tools.maps import maps_at_hand
from plannerforge.tools.storing import content_digest, store_scenario
from plannerforge.tools.trial_run import with_trial_run

GENERATE_TIMEOUT_S = 180.0
REPORT = "generation.json"
"""What came out of the generation, kept with the scenario for when it is asked for again."""


async def generate_scenarios(arguments: GenerateScenariosArguments, call: ToolCall) -> GenerateScenariosResult:
    """Find the map, make each scenario in a worker, store it, and say what was asked beside what came out."""
    at_hand = await maps_at_hand(call)
    plan = plan_maps(arguments, at_hand.entries)
    orders = await _orders(arguments, call, plan.matches)
    made: list[ScenarioSummary] = []
    for index, (match, site_index) in enumerate(orders):
        share = (index / len(orders), (index + 1) / len(orders))
        summary = await _make(call, request_for(arguments, match, site_index, index), share)
        made.append(await with_trial_run(call, summary) if arguments.trial_run else summary)
    notes = [*plan.notes, *at_hand.notes]
    if len(orders) < arguments.count:
        notes.append(f"only {len(orders)} different site(s) fit; {arguments.count} were asked for")
    used = {summary.map_id for summary in made}
    attributions = sorted({m.entry.facts.attribution for m in plan.matches if m.entry.facts.map_id in used})
    return GenerateScenariosResult(scenarios=made, notes=notes, attribution=attributions)


async def _orders(
    arguments: GenerateScenariosArguments, call: ToolCall, matches: tuple[MapMatch, ...]
) -> list[tuple[MapMatch, int]]:
    """The map and the number of the site for every scenario: maps in turn, no site twice."""
    if arguments.count == 1:
        return [(matches[0], 0)]
    sites = [await _site_count(arguments, call, match) for match in matches]
    turns = [(site_index, place) for place, count in enumerate(sites) for site_index in range(count)]
    return [(matches[place], site_index) for site_index, place in sorted(turns)[: arguments.count]]


async def _site_count(arguments: GenerateScenariosArguments, call: ToolCall, match: MapMatch) -> int:
    request = request_for(arguments, match, 0, 0)
    entry_point = "plannerforge.engine.scenarios.site_choice:count_sites"
    return (await call.run(entry_point, request, SiteCount, timeout_s=GENERATE_TIMEOUT_S, share=(0.0, 0.0))).count


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
        scenario = await call.run(
            "plannerforge.engine.scenarios.generate:generate",
            request.model_copy(update={"folder": str(folder), "benchmark_number": number}),
            GeneratedScenario,
            timeout_s=GENERATE_TIMEOUT_S,
            share=share,
        )
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
    parents = () if _is_built_in(request) else (request.map_id,)
    versions = versions_of("eclipse-sumo", "libsumo", "numpy")
    return Recipe(tool="generate_scenarios", arguments=arguments, parents=parents, seed=request.seed, versions=versions)


def _is_built_in(request: GenerationRequest) -> bool:
    return Path(request.map_path).parent.name == "library"
