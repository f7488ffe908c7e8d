"""The tool that makes scenarios from maps."""

from pathlib import Path

from plannerforge.engine.maps.index import Box, MapMatch, find_maps
from plannerforge.engine.maps.road_classes import resolve_road_classes
from plannerforge.engine.workspace.recipe import Recipe, versions_of
from plannerforge.schemas.errors import InvalidRequest
from plannerforge.schemas.generation import (
    GeneratedScenario,
    GenerateScenariosArguments,
    GenerateScenariosResult,
    GenerationRequest,
    ScenarioSummary,
    VehicleDemand,
)
from plannerforge.schemas.grammar import parse_comparison
from plannerforge.tools.call import ToolCall
from plannerforge.tools.generation_answer import summarise
from plannerforge.tools.maps import maps_at_hand
from plannerforge.tools.storing import content_digest, store_scenario

GENERATE_TIMEOUT_S = 180.0
MOST_VEHICLES = 300
"""A site of a few hundred metres holds fewer; more would only make the caller wait for the refusal."""
REPORT = "generation.json"
"""What came out of the generation, kept with the scenario for when it is asked for again."""


async def generate_scenarios(arguments: GenerateScenariosArguments, call: ToolCall) -> GenerateScenariosResult:
    """Find the map, make each scenario in a worker, store it, and say what was asked beside what came out."""
    box = _box(arguments.bbox)
    matches = find_maps(
        await maps_at_hand(call),
        place=arguments.place,
        country=arguments.country,
        bbox=box,
        scenario_type=arguments.scenario_type,
    )
    holding = [m for m in matches if arguments.scenario_type in ("any", *m.entry.facts.sites)] or matches[:1]
    made: list[ScenarioSummary] = []
    for index in range(arguments.count):
        match = holding[(arguments.seed + index) % len(holding)]
        share = (index / arguments.count, (index + 1) / arguments.count)
        made.append(await _make(call, _request(arguments, match, box, index // len(holding), index), share))
    unnamed = sorted({word for match in holding for word in match.unnamed})
    notes = [f"the map does not name {word!r}; its street was found" for word in unnamed]
    used = {summary.map_id for summary in made}
    attributions = sorted({m.entry.facts.attribution for m in holding if m.entry.facts.map_id in used})
    return GenerateScenariosResult(scenarios=made, notes=notes, attribution=attributions)


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


def _request(
    arguments: GenerateScenariosArguments, match: MapMatch, box: Box | None, site_index: int, index: int
) -> GenerationRequest:
    facts = match.entry.facts
    return GenerationRequest(
        map_path=str(match.entry.path),
        map_id=facts.map_id,
        place=facts.place,
        country=facts.country or arguments.country,
        attribution=facts.attribution,
        scenario_type=arguments.scenario_type,
        streets=match.streets,
        bbox=box,
        road_classes=() if arguments.road_classes is None else resolve_road_classes(arguments.road_classes),
        density=arguments.density,
        vehicles=_vehicle_demands(arguments.vehicles),
        duration_s=arguments.duration_s,
        ego=arguments.ego,
        goal=arguments.goal,
        seed=arguments.seed,
        index=index,
        site_index=site_index,
        folder="",
    )


def _recipe(request: GenerationRequest) -> Recipe:
    """The resolved request without paths; the map counts by its content."""
    arguments = request.model_dump(mode="json", exclude={"map_path", "folder", "benchmark_number", "seed"})
    arguments["map_content"] = content_digest(Path(request.map_path))
    parents = () if _is_built_in(request) else (request.map_id,)
    versions = versions_of("eclipse-sumo", "libsumo", "numpy")
    return Recipe(tool="generate_scenarios", arguments=arguments, parents=parents, seed=request.seed, versions=versions)


def _is_built_in(request: GenerationRequest) -> bool:
    return Path(request.map_path).parent.name == "library"


def _vehicle_demands(texts: list[str]) -> tuple[VehicleDemand, ...]:
    demands = tuple(_vehicle_demand(text) for text in texts)
    asked = sum(demand.least for demand in demands)
    if asked > MOST_VEHICLES:
        raise InvalidRequest(
            f"vehicles ask for {asked:,} vehicles on one site",
            valid=[f"at most {MOST_VEHICLES} in all classes together"],
        )
    return demands


def _vehicle_demand(text: str) -> VehicleDemand:
    """``truck`` and ``truck=2`` are least numbers, ``car=4..4`` bounds on both sides, ``bicycle=0`` none at all."""
    wish = parse_comparison(text, whole=True)
    low, high = wish.interval.low, wish.interval.high
    if wish.negated:
        return VehicleDemand(vehicle_class=wish.name, least=0, most=0)
    least = 0 if low is None else round(low)
    at_least = wish.interval.exact and least > 0
    most = None if high is None or at_least else round(high)
    if wish.value is not None or wish.scope is not None or least < 0 or (most is not None and most < least):
        raise InvalidRequest(f"vehicles {text!r} cannot be meant", valid=["truck", "truck=2", "car=4..4", "bicycle=0"])
    return VehicleDemand(vehicle_class=wish.name, least=least, most=most)


def _box(bbox: list[float] | None) -> Box | None:
    if bbox is None:
        return None
    if len(bbox) != 4:
        raise InvalidRequest(f"bbox has {len(bbox)} numbers", valid=["[south, west, north, east] in degrees"])
    south, west, north, east = bbox
    if not (-90 <= south < north <= 90 and -180 <= west < east <= 180):
        raise InvalidRequest(f"bbox {bbox} is no box", valid=["[south, west, north, east] in degrees, south < north"])
    return south, west, north, east
