"""Generate scenarios, and add encounters to them that are critical for the default planner.

The encounter is a point of the search that ``find_failures`` makes near the scenario: an ordinary list of edits.
"""

from ..engine.tuning import DEFAULT_CONFIGURATION
from ..schemas.errors import NotPossible
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
    made = await generate_usual_scenarios(arguments.model_copy(update={"trial_run": False}), context)
    scenarios = []
    for summary in made.scenarios:
        changed = await with_encounter(context, summary, arguments.criticality, arguments.seed)
        scenarios.append(await with_trial_run(context, changed) if arguments.trial_run else changed)
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
    try:
        encounter = await most_critical(arguments, context, _ignored, failures=criticality == "critical")
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
        context,
    )
    words = f"{encounter.change}; {_fares(encounter)}; added to {summary.scenario_id}"
    notes = [*summary.notes]
    if criticality == "critical" and not encounter.has_failed:
        notes.append(
            f"{DEFAULT_CONFIGURATION} has no avoidable failure in {encounter.runs} encounters; the added one leaves it "
            "the least margin. Another seed has other traffic"
        )
    return summary.model_copy(update={"scenario_id": str(made.scenario_id), "encounter": words, "notes": notes})


def _ignored(share: float, message: str) -> None:
    """Ignore the progress of the search: the call reports that of its scenarios."""
    del share, message


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
