"""Generate one scenario in a worker, or find it by its recipe; describe it, and run the default planner on it."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ...engine.catalog import ID_TAKEN
from ...engine.tuning import DEFAULT_CONFIGURATION
from ...engine.vehicles import PEDESTRIAN, ego_class, refused_by_planners
from ...engine.workspace import Recipe, content_digest, versions_of
from ...schemas.errors import NotPossible
from ...schemas.generation import (
    NATURAL_SHARES,
    SHARES_SOURCE,
    USUAL_EGO,
    USUAL_GOAL,
    DensityFacts,
    GeneratedEgo,
    GeneratedScenario,
    GenerationRequest,
    ScenarioSummary,
)
from ...schemas.runs import NO_TRAJECTORY, ending
from ...schemas.text import cited_all, counted
from ..configurations import resolve_configuration, store_configuration
from ..context import WorkflowContext
from ..operations import GENERATE_SCENARIO
from ..runs import Cell, run_grid
from ..scenario_storage import store_scenario
from .record import REPORT, verdicts
from .specification import circumstances_of

CHECK = "planner can run"
_SHOWN_STREETS = 4
"""How many streets of a site an answer lists (chosen)."""
_ADVICE = "the default planner cannot run here; another seed gives other traffic and another ego"


async def make_scenario(
    context: WorkflowContext, request: GenerationRequest, share: tuple[float, float]
) -> ScenarioSummary:
    """Return one scenario: the stored scenario with the same recipe, otherwise a new one.

    Among a million scenarios, a few dozen get an id that another scenario has. These scenarios are generated again,
    with other digits of their digests in the ids.

    Raises:
        NotPossible: it cannot be generated, or another scenario has both of its ids.
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
            extra_files={REPORT: report_path},
            circumstances=circumstances_of(request.conditions),
        )
    return summarise(scenario, request, artifact.artifact_id, reused=False)


def summarise(
    scenario: GeneratedScenario, request: GenerationRequest, scenario_id: str, *, reused: bool
) -> ScenarioSummary:
    """Return the request and the result of one scenario."""
    site, ego = scenario.site, scenario.ego
    streets = cited_all(site.streets[:_SHOWN_STREETS], " / ") or "unnamed roads"
    passed, failed = verdicts(scenario.checks)
    aim = "" if request.goal.text == USUAL_GOAL else f" (goal={request.goal})"
    return ScenarioSummary(
        scenario_id=scenario_id,
        reused=reused,
        map_id=request.map_id,
        place=request.place,
        site=f"{site.scenario_type} at {streets}" + _other_type_note(site.scenario_type, request.scenario_type),
        latitude=site.latitude,
        longitude=site.longitude,
        osm_id=site.osm_id,
        vehicles_asked=scenario.vehicles_asked,
        vehicles_realised=scenario.vehicles_realised,
        classes_asked=scenario.classes_asked,
        classes_realised=scenario.classes_realised,
        density=_density(scenario.density),
        recorded_s=scenario.recorded_s,
        ego=_ego_words(ego, request),
        goal=(
            f"{ego.goal_distance_m:.0f} m along the recorded drive on lanelet {ego.goal_lanelet}, from "
            f"{ego.goal_time_s[0]:g} to {ego.goal_time_s[1]:g} s{aim}"
        ),
        ego_speed_mps=ego.speed_mps,
        goal_lanelet=ego.goal_lanelet,
        goal_distance_m=ego.goal_distance_m,
        goal_time_s=ego.goal_time_s,
        feasible_share=scenario.checks.feasible_share,
        checks_passed=passed,
        checks_failed=failed,
        planners_refuse=refused_by_planners(ego.vehicle_class),
        others=scenario.others,
        absences=scenario.absences,
        notes=[*_shares(scenario, request), *scenario.notes],
    )


def _ego_words(ego: GeneratedEgo, request: GenerationRequest) -> str:
    """Return text on the vehicles that the ego was chosen from, its speed and, if not a car, its size and limits."""
    count = ego.cars_to_choose_from
    chosen = "" if request.ego.text == USUAL_EGO else f" (ego={request.ego})"
    one_of = (
        f"the only {ego.vehicle_class}" if count == 1 else f"chosen from {counted(count, ego.vehicle_class)}{chosen}"
    )
    speed = "0" if ego.speed_mps < 0.05 else f"{ego.speed_mps:.1f}"
    if ego.vehicle_class == "car":
        return f"Ego: {one_of}, starts at {speed} m/s"
    known = ego_class(ego.vehicle_class)
    return f"Ego: {known.in_words}, {one_of}, starts at {speed} m/s, limits: {known.source}"


def _shares(scenario: GeneratedScenario, request: GenerationRequest) -> Iterator[str]:
    """Yield the share of each requested class without a number, and the source of the statistics."""
    for demand in request.vehicles:
        name, share = demand.vehicle_class, demand.share
        if share is None or (name == PEDESTRIAN.name and not share):  # the density sets the number of pedestrians
            continue
        if share == NATURAL_SHARES.get(name):
            yield f"{name}: {100 * share:g}% of all vehicles, as in the EU ({SHARES_SOURCE}), but at least one"
        elif share == 0:
            yield f"at least 1 {name}, because its share of traffic is unknown; {name}=30% sets the share"
        else:
            realised = scenario.classes_realised.get(name, 0) / max(scenario.vehicles_realised, 1)
            yield f"{name}: {share:.0%} of all vehicles requested, {realised:.0%} realised"


def _other_type_note(realised: str, requested: str) -> str:
    """Return the requested type of site, if the realised type differs."""
    return "" if requested in ("any", realised) else f" (instead of the requested {requested})"


def _density(density: DensityFacts) -> str:
    return (
        f"{density.at_start_per_lane_km:g} vehicles per lane-km at the start, "
        f"{density.at_end_per_lane_km:g} at the end "
        f"(requested: {density.target_per_lane_km:g}, {density.at_time or density.wish})"
    )


_RECORDED = (
    *("map_id", "place", "country", "attribution", "scenario_type", "streets", "bbox", "road_classes", "density"),
    *("vehicles", "duration_s", "ego", "goal", "index", "site_index", "site_step", "most_sites", "most_rounds"),
    *("conditions", "others", "longest_s", "longer_streets"),
)
"""The fields of a request in a recipe, in the order that recipes have always used."""


def recipe_of(request: GenerationRequest) -> Recipe:
    """Return the request without paths as a recipe, which identifies the map by its content."""
    dumped = request.model_dump(mode="json")
    arguments = {name: dumped[name] for name in _RECORDED if name in dumped}
    arguments["map_content"] = content_digest(Path(request.map_path))
    is_built_in = Path(request.map_path).parent.name == "library"
    parents = () if is_built_in else (request.map_id,)
    versions = versions_of("eclipse-sumo", "libsumo", "numpy")
    return Recipe(tool="generate_scenarios", arguments=arguments, parents=parents, seed=request.seed, versions=versions)


def shape_of(request: GenerationRequest) -> dict[str, Any]:
    """Return what a request says about its scenario, without the copy of the map, the site and the numbering."""
    numbers = {"map_path", "folder", "benchmark_number", "seed", "index", "site_index", "site_step"}
    others = {"most_sites", "most_rounds", "place", "country", "attribution"}
    return request.model_dump(mode="json", exclude=numbers | others)


async def with_trial_run(context: WorkflowContext, summary: ScenarioSummary) -> ScenarioSummary:
    """Return the summary with the default planner's outcome; the run is stored like any other.

    A collision or a missed goal is a result, not a fault of the scenario. The check fails if a run was impossible: the
    planner found the problem invalid or found no trajectory, or the run was lost. The scenario is still returned, with
    a note.
    """
    configuration = resolve_configuration(DEFAULT_CONFIGURATION, context)
    store_configuration(context, configuration)
    (result,) = await run_grid(context, [Cell(summary.scenario_id, None, configuration)], lambda _: None)
    if result.record is not None:
        record = result.record
        outcome = f"{record.run_id} ({DEFAULT_CONFIGURATION}): {ending(record.outcome, record.reason)}"
    else:
        outcome = result.lost.error if result.lost is not None else "no result"
    if result.record is not None and result.record.outcome not in NO_TRAJECTORY:
        return summary.model_copy(update={"trial_run": outcome, "checks_passed": [*summary.checks_passed, CHECK]})
    failed = {"checks_failed": [*summary.checks_failed, CHECK], "notes": [*summary.notes, _ADVICE]}
    return summary.model_copy(update={"trial_run": outcome, **failed})
