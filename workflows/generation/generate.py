"""Generate scenarios from maps: choose the maps and a site for each scenario, and run the workers."""

from ...engine.catalog import open_catalogue
from ...engine.maps import MapMatch
from ...schemas.errors import InvalidRequest, NotPossible, ServiceFailure, UnknownName, WorkerFailure, with_values
from ...schemas.generation import GenerateScenariosArguments, GenerateScenariosResult, GenerationSpec, ScenarioSummary
from ...schemas.text import counted
from ..context import WorkflowContext
from ..maps import map_of_scenario, maps_at_hand
from .coverage import cover_combinations
from .flow_tables import with_tables_read
from .making import make_scenario, with_trial_run
from .map_choice import (
    AssignedSite,
    SiteAssignment,
    assign_sites,
    check_site,
    maps_for,
    request_for,
    widen_empty,
    with_cuts,
    without_refused,
)
from .specification import read_specification

MOST_SINGLY = 50
"""The maximum number of scenarios of a call without a coverage plan, which waits for all of them."""


async def generate_scenarios(
    arguments: GenerateScenariosArguments, context: WorkflowContext
) -> GenerateScenariosResult:
    """Find the maps, generate and store each scenario, and report the requested and realised values.

    A note reports each scenario that could not be generated.

    Raises:
        InvalidRequest: no scenario could be generated; the error gives the reason for the first scenario.
    """
    open_catalogue(
        context.workspace, with_starter=context.services.with_starter
    )  # first, or a starter would be the latest
    if arguments.place and (filled := await map_of_scenario(context, arguments.place)) is not None:
        arguments = arguments.model_copy(update={"place": filled})
    if arguments.conditions:
        conditions = with_tables_read(arguments.conditions, context)
        arguments = arguments.model_copy(update={"conditions": conditions})
    spec = read_specification(arguments)
    at_hand = await maps_at_hand(context)
    choice = await with_cuts(spec, context, at_hand.entries)
    spec, messages = choice.spec, (*choice.notes, *at_hand.notes)
    if arguments.cover:
        return await cover_combinations(arguments, spec, context, choice.entries, messages)
    _check_count(spec)
    spec.check_turn()
    try:
        plan = await widen_empty(spec, context, await maps_for(spec, context, choice.entries))
    except (UnknownName, NotPossible, ServiceFailure) as refusal:
        raise choice.with_failures(await without_refused(spec, context, choice.entries, refusal)) from refusal
    sites = await assign_sites(spec, context, plan.matches)
    made, failures = await _make_all(spec, context, sites)
    context.made("scenario", *(summary.scenario_id for summary in made))
    notes = [*spec.notes, *plan.notes, *messages, *failures]
    if len(sites.planned) < spec.count:
        found = counted(len(sites.planned), "distinct site")
        notes.append(f"{counted(spec.count, 'scenario')} requested, but only {found} found")
    if notice := context.services.workers.notice:
        notes.append(notice)
    used = {summary.map_id for summary in made}
    attributions = sorted({m.entry.facts.attribution for m in plan.matches if m.entry.facts.map_id in used})
    return GenerateScenariosResult(scenarios=made, notes=notes, attribution=attributions)


async def check_generation(arguments: GenerateScenariosArguments, context: WorkflowContext) -> None:
    """Refuse a call that could make no scenario, as far as the maps at hand show: nothing is made or downloaded.

    Raises:
        InvalidRequest: as for :func:`generate_scenarios`.
    """
    if arguments.place and context.workspace.find("scenario", arguments.place) is not None:
        return
    conditions = with_tables_read(arguments.conditions, context) if arguments.conditions else arguments.conditions
    spec = read_specification(arguments.model_copy(update={"conditions": conditions}))
    if arguments.cover:
        return
    _check_count(spec)
    spec.check_turn()
    await check_site(spec, context, (await maps_at_hand(context)).entries)


def _check_count(spec: GenerationSpec) -> None:
    if spec.count > MOST_SINGLY:
        raise InvalidRequest(
            f"count {spec.count:,} is more than a call without a plan allows",
            valid=[f"1 to {MOST_SINGLY}; to 5,000 with cover"],
            next_step="use cover to say what to vary, such as ['density=low|high', 'turn=left|right|straight']",
            remedies=[with_values(count=MOST_SINGLY)],
        )


async def _make_all(
    spec: GenerationSpec, context: WorkflowContext, sites: SiteAssignment
) -> tuple[list[ScenarioSummary], list[str]]:
    """Return the scenarios that could be generated, and notes on the scenarios that could not.

    Raises:
        PlannerForgeError: no scenario could be generated.
    """
    made: list[ScenarioSummary] = []
    notes: list[str] = []
    refusals: list[NotPossible] = []
    spare = list(sites.spare)
    for index, site in enumerate(sites.planned):
        share = (index / len(sites.planned), (index + 1) / len(sites.planned))
        try:
            summary, given_up = await _make_somewhere(spec, context, site, spare, index, share)
            made.append(await with_trial_run(context, summary) if spec.trial_run else summary)
            notes += [f"another map was used: {refusal.message}" for refusal in given_up]
        except NotPossible as refusal:
            refusals.append(refusal)
            notes.append(f"scenario {index + 1} was not generated: {refusal.message}")
        except (UnknownName, WorkerFailure) as failure:
            if not made:
                raise
            notes.append(f"scenario {index + 1} and the following ones were not generated: {failure.message}")
            break
    if not made:
        raise refusals[0]
    return made, notes


async def _make_somewhere(
    spec: GenerationSpec,
    context: WorkflowContext,
    site: AssignedSite,
    spare: list[MapMatch],
    index: int,
    share: tuple[float, float],
) -> tuple[ScenarioSummary, list[NotPossible]]:
    """Return a scenario at its site, or on the first spare map where it is possible, and the earlier refusals.

    Tried spare maps are removed from the list.

    Raises:
        NotPossible: no map allows it; the error gives the reason for the assigned site.
    """
    refusals: list[NotPossible] = []
    while True:
        try:
            request = request_for(spec, site, index)
            return await make_scenario(context, request, share), refusals
        except NotPossible as refusal:
            refusals.append(refusal)
        if not spare or spec.goal.lanelet is not None:  # an id means another lanelet elsewhere
            raise refusals[0]
        site = AssignedSite(spare.pop(0))
