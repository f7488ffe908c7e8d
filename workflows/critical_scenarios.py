"""Generate scenarios, and add encounters to them that are critical for the default planner.

The encounter is a point of the search that ``find_failures`` makes near the scenario: an ordinary list of edits.
"""

from ..engine.tuning import DEFAULT_CONFIGURATION
from ..schemas.errors import NotPossible, WorkerTimeout
from ..schemas.failures import FindFailuresArguments, careful_drivers_in_words
from ..schemas.generation import Criticality, GenerateScenariosArguments, GenerateScenariosResult, ScenarioSummary
from ..schemas.modification import ModifyScenarioArguments
from .context import WorkflowContext
from .failures import Encounter, most_critical
from .generation.generate import generate_scenarios as generate_usual_scenarios
from .generation.making import with_trial_run
from .modification import modified_once

RUNS = {"raised": 24, "critical": 60}
"""The budget of each search in runs (chosen: half a minute at most)."""
_TOO_SLOW = (
    "Fewer vehicles or a shorter duration_s make the search faster; find_failures with scenario_id '{}' searches as a "
    "job, which keeps what it has evaluated"
)
_GENERATING = 0.3
"""The share of the progress that the generation of the scenarios gets; the searches take longer (chosen)."""
_SEARCHING = 0.9
"""The share of a scenario's search in the progress that remains (chosen); its edit and its run get the rest."""
_ALREADY = "base_failed_avoidably"


async def generate_scenarios(
    arguments: GenerateScenariosArguments, context: WorkflowContext
) -> GenerateScenariosResult:
    """Generate scenarios of the requested criticality.

    Raises:
        InvalidRequest: no scenario could be generated; the error gives the reason for the first scenario.
    """
    if arguments.criticality == "usual" or arguments.cover:
        return await generate_usual_scenarios(arguments, context)
    usual = arguments.model_copy(update={"trial_run": False})
    made = await generate_usual_scenarios(usual, context.within(0.0, _GENERATING))
    scenarios, share = list[ScenarioSummary](), (1.0 - _GENERATING) / len(made.scenarios)
    for number, summary in enumerate(made.scenarios):
        begin = _GENERATING + number * share
        part = context.within(begin, begin + share)
        changed = await with_encounter(part, summary, arguments.criticality, arguments.seed)
        scenarios.append(await with_trial_run(part, changed) if arguments.trial_run else changed)
    context.made("scenario", *(summary.scenario_id for summary in scenarios))
    return made.model_copy(update={"scenarios": scenarios})


async def with_encounter(
    context: WorkflowContext, summary: ScenarioSummary, criticality: Criticality, seed: int
) -> ScenarioSummary:
    """Return the summary of the scenario with the most critical encounter that the search finds.

    If a scenario with the requested criticality is not possible, the scenario stays as it is, with the reason in the
    notes. A scenario in which the planner fails although a careful driver would not is critical already.
    """
    arguments = FindFailuresArguments(
        scenario_id=summary.scenario_id,
        config=DEFAULT_CONFIGURATION,
        runs=RUNS[criticality],
        until_first=criticality == "critical",
        seed=seed,
    )

    async def report(share: float, message: str) -> None:
        await context.progress(_SEARCHING * share, f"search near {summary.scenario_id}: {message}")

    try:
        encounter = await most_critical(arguments, context, report, failures=criticality == "critical")
    except WorkerTimeout as late:
        return _unchanged(summary, f"{late.message}. {_TOO_SLOW.format(summary.scenario_id)}")
    except NotPossible as refusal:
        if refusal.reason == _ALREADY:
            return summary.model_copy(update={"encounter": f"not changed, since {refusal.message}"})
        return _unchanged(summary, refusal.message)
    if encounter is None:
        return _unchanged(summary, f"no encounter near it is critical for {DEFAULT_CONFIGURATION}")
    made = await modified_once(
        ModifyScenarioArguments(
            scenario_id=summary.scenario_id, edits=list(encounter.edits), on_conflict="refuse", seed=seed
        ),
        context.within(_SEARCHING, 1.0),
    )
    words = f"{encounter.change}; {_fares(encounter)}; added to {summary.scenario_id}"
    notes = [*summary.notes]
    if criticality == "critical" and not encounter.has_failed:
        notes.append(
            f"{DEFAULT_CONFIGURATION} has no avoidable failure in {encounter.runs} encounters; the added one leaves it "
            "the least margin. Another seed has other traffic"
        )
    return summary.model_copy(update={"scenario_id": str(made.scenario_id), "encounter": words, "notes": notes})


def _unchanged(summary: ScenarioSummary, reason: str) -> ScenarioSummary:
    return summary.model_copy(update={"notes": [*summary.notes, f"no encounter was added: {reason}"]})


def _fares(encounter: Encounter) -> str:
    """Return how the planner fares in an encounter, in words."""
    found = encounter.evaluation
    if not encounter.has_failed:
        gap = "" if found.least_gap_m is None else f" by {found.least_gap_m:.1f} m"
        return f"{DEFAULT_CONFIGURATION} avoids a collision{gap}"
    drivers = careful_drivers_in_words(found.avoided_by)
    return f"{DEFAULT_CONFIGURATION} {found.reason}; {drivers} would not fail"
