"""Edit a scenario."""

from dataclasses import replace
from pathlib import Path

from ..engine.catalog import open_catalogue
from ..engine.commonroad import derived_benchmark_id
from ..engine.workspace import Artifact, Recipe, versions_of
from ..schemas.errors import Change, InvalidRequest, NotPossible, Remedy
from ..schemas.generation import WEATHERS
from ..schemas.grammar import is_without_unit, parse_selector
from ..schemas.modification import (
    AMBIGUOUS_VEHICLE,
    Edit,
    ModificationOutcome,
    ModificationRequest,
    ModifyScenarioArguments,
    ModifyScenarioResult,
    TrafficAfterEdits,
)
from ..schemas.scenarios import ScenarioFacts, ScenarioRecord
from .context import Question, WorkflowContext
from .operations import APPLY_EDITS
from .scenario_storage import store_scenario
from .scenarios import one_scenario

_TOOL = "modify_scenario"
_MOST_QUESTIONS = 5
"""How many questions one call may ask (chosen). A user with more unclear selectors should look at the scenario first.
"""


async def modify_scenario(arguments: ModifyScenarioArguments, context: WorkflowContext) -> ModifyScenarioResult:
    """Edit a scenario. If a selector matches several vehicles, the user may choose one."""
    given = arguments
    context.remarks += _assumed_units(arguments)
    try:
        for _ in range(_MOST_QUESTIONS):
            try:
                return await modified_once(arguments, context)
            except NotPossible as refusal:
                chosen = await with_chosen_vehicle(refusal, arguments, context)
                if chosen is None:
                    raise
                arguments = chosen
        return await modified_once(arguments, context)
    except InvalidRequest as refusal:
        if arguments is not given:
            refusal.remedies = tuple(_with_edits(arguments, remedy) for remedy in refusal.remedies)
        raise


def _assumed_units(arguments: ModifyScenarioArguments) -> list[str]:
    """Return a sentence for each speed without a unit, which is read in m/s."""
    written = [
        (f"edits[{index}].{name}", text.strip())
        for index, edit in enumerate(arguments.edits)
        for name, text in (("speed", edit.speed), ("goal_speed", edit.goal_speed))
        if text is not None and is_without_unit(text) and float(text) != 0.0
    ]
    return [
        f"{path}={text} has no unit; it is read as {text} m/s ({3.6 * float(text):g} km/h)." for path, text in written
    ]


def _with_edits(arguments: ModifyScenarioArguments, remedy: Remedy) -> Remedy:
    """Return the remedy for the call as the client sent it, without the vehicle that the user chose."""
    if remedy.tool:
        return remedy
    chosen = Change(values={"edits": arguments.model_dump(mode="json", exclude_unset=True)["edits"]})
    return replace(remedy, changes=(chosen, *remedy.changes))


async def with_chosen_vehicle(
    refusal: NotPossible, arguments: ModifyScenarioArguments, context: WorkflowContext
) -> ModifyScenarioArguments | None:
    """Return the arguments with the id of the vehicle that the user chose, or None if there was no choice."""
    kind, _, selector = refusal.reason.partition(" ")
    fitting = [edit for edit in arguments.edits if any(_is_same_selector(text, selector) for text in edit.vehicles)]
    if kind != AMBIGUOUS_VEHICLE or not fitting:
        return None
    choices = refusal.valid[: refusal.shown_values]
    chosen = await context.ask(Question(f"Which vehicle of {arguments.scenario_id} does '{selector}' mean?", choices))
    if chosen is None:
        return None
    vehicle_id = chosen.partition(" ")[0]
    edits = [
        edit.model_copy(
            update={"vehicles": [vehicle_id if _is_same_selector(text, selector) else text for text in edit.vehicles]}
        )
        for edit in arguments.edits
    ]
    context.remarks.append(f"'{selector}' means vehicle {vehicle_id}, as chosen.")
    return arguments.model_copy(update={"edits": edits})


def _is_same_selector(text: str, selector: str) -> bool:
    """Return whether two texts differ only in their spelling."""
    try:
        return str(parse_selector(text)) == selector
    except InvalidRequest:
        return False


async def modified_once(arguments: ModifyScenarioArguments, context: WorkflowContext) -> ModifyScenarioResult:
    """Return the edited scenario. If it was edited before, all edits are applied to its base again."""
    open_catalogue(context.workspace, with_starter=context.services.with_starter)
    given, named_problem = one_scenario(arguments.scenario_id, context)
    base_id, earlier = base_and_edits(given)
    problem_id = _problem(given, named_problem)
    edits = (*earlier, *(edit.numbered_after(len(earlier)) for edit in arguments.edits))
    seed = arguments.seed if "seed" in arguments.model_fields_set or not earlier else given.recipe.seed
    traffic = _traffic(arguments, given)
    recipe = Recipe(
        tool=_TOOL,
        arguments={"base": base_id, "edits": [edit.model_dump(mode="json", exclude_defaults=True) for edit in edits]}
        | ({} if traffic == "recorded" else {"traffic": traffic})
        | ({} if problem_id is None else {"problem": problem_id}),
        parents=(base_id,),
        seed=seed,
        versions=versions_of("libsumo"),
    )
    new_id = derived_benchmark_id(base_id, recipe.digest)
    reused = context.workspace.find("scenario", new_id) is not None
    with context.workspace.scratch() as folder:
        request = ModificationRequest(
            xml=context.workspace.file("scenario", base_id, "scenario.xml"),
            edits=edits,
            benchmark_id=new_id,
            output=folder,
            problem_id=problem_id,
            earlier=len(earlier),
            given=context.workspace.file("scenario", given.artifact_id, "scenario.xml") if earlier else None,
            on_conflict=arguments.on_conflict,
            traffic=traffic,
            detail=arguments.detail,
            dry_run=arguments.dry_run,
            seed=seed,
        )
        outcome = await context.run(APPLY_EDITS, request, share=(0.0, 0.8))
        if outcome.xml is not None:
            await store_scenario(
                context,
                xml=Path(outcome.xml),
                net=outcome.net,
                recipe=recipe,
                origin="modified",
                circumstances=_circumstances(given.read(ScenarioRecord).facts, outcome),
            )
            context.made("scenario", new_id)
    return ModifyScenarioResult(
        scenario_id=None if arguments.dry_run else new_id,
        base_id=given.artifact_id,
        root_id="" if base_id == given.artifact_id else base_id,
        earlier=len(earlier),
        reused=reused and not arguments.dry_run,
        edits=outcome.edits,
        traffic=traffic,
        detail=arguments.detail,
        touched=outcome.touched,
        removed=outcome.removed,
        handed_over=outcome.handed_over,
        collisions=outcome.collisions,
        ego_before=outcome.ego_before,
        ego_after=outcome.ego_after,
        checked_by=outcome.checked_by,
        checkers_agree=outcome.checkers_agree,
        untouched=outcome.untouched,
        planners_refuse=outcome.planners_refuse,
        warnings=outcome.warnings,
    )


def _circumstances(facts: ScenarioFacts, outcome: ModificationOutcome) -> tuple[str, ...]:
    """Return the weather and time of day after the edits; new weather replaces the weather of the edited scenario."""
    if not outcome.weather:
        return facts.circumstances
    return (*(word for word in facts.circumstances if word not in WEATHERS), outcome.weather)


def _traffic(arguments: ModifyScenarioArguments, given: Artifact) -> TrafficAfterEdits:
    """Return the requested traffic, or the traffic of earlier edits."""
    if "traffic" in arguments.model_fields_set or given.recipe.tool != _TOOL:
        return arguments.traffic
    return "reactive" if given.recipe.arguments.get("traffic") == "reactive" else "recorded"


def _problem(given: Artifact, requested: int | None) -> int | None:
    """Return the planning problem that the edits refer to: all edits since the base are repeated for one ego.

    Raises:
        NotPossible: the scenario was edited for another ego before.
    """
    egos = given.read(ScenarioRecord).facts.egos
    first = egos[0].problem_id if egos else None
    wanted = None if requested == first else requested
    if given.recipe.tool != _TOOL:
        return wanted
    before = given.recipe.arguments.get("problem")
    if requested is not None and wanted != before:
        earlier = first if before is None else before
        raise NotPossible(
            f"{given.artifact_id} was edited for planning problem {earlier}, not {requested}",
            valid=[f"{given.artifact_id}#{earlier}", f"{given.recipe.arguments['base']}#{requested}"],
        )
    return before


def base_and_edits(artifact: Artifact) -> tuple[str, tuple[Edit, ...]]:
    """Return the scenario that all edits start from, and the edits so far."""
    if artifact.recipe.tool != _TOOL:
        return artifact.artifact_id, ()
    edits = artifact.recipe.arguments["edits"]
    return str(artifact.recipe.arguments["base"]), tuple(Edit.model_validate(edit) for edit in edits)
