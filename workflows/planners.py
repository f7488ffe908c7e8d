"""List planners and their settings, create configurations, and run planners."""

from typing import get_args

from ..engine.planners import check_modes, check_world, known_planner, planner_names, refused_planners
from ..engine.tuning import (
    PlannerTuning,
    changed_configuration,
    differences,
    known_settings,
    preset_configuration,
    setting_values,
    to_yaml,
    tuning_of,
)
from ..engine.workspace import Recipe
from ..schemas.errors import Faults, InvalidRequest, PlannerFailure
from ..schemas.planning import (
    LISTED_CONFIGURATIONS,
    ConfigurationInfo,
    ConfigurePlannerArguments,
    ConfigurePlannerResult,
    ListPlannersArguments,
    ListPlannersResult,
    PlannerConfiguration,
    PlannerInfo,
    PresetInfo,
    RunPlannerArguments,
    RunPlannerResult,
    SettingInfo,
    WeightInfo,
)
from ..schemas.runs import Prediction
from ..schemas.text import shown_name
from ..schemas.worlds import PERFECT, combination_notes, world_of
from .configurations import made_configurations, resolve_configuration, store_configuration
from .context import WorkflowContext
from .runs import Cell, answer_of, run_cell, run_many
from .scenarios import choose_scenarios


async def list_planners(arguments: ListPlannersArguments, context: WorkflowContext) -> ListPlannersResult:
    """Return the planners and the current values, or the Default values of another planner."""
    configuration = resolve_configuration(arguments.config_id or "current", context)
    if arguments.planner and known_planner(arguments.planner) != configuration.planner:
        if arguments.config_id:
            raise InvalidRequest(
                f"{configuration.config_id} is a configuration of {configuration.planner}, not of {arguments.planner}",
                next_step="give either planner or config_id, not both",
            )
        configuration = resolve_configuration(arguments.planner, context)
    is_chosen = bool(arguments.planner or arguments.config_id)
    tuning = tuning_of(configuration.planner)
    made = made_configurations(context, LISTED_CONFIGURATIONS)
    return ListPlannersResult(
        planners=(
            *(_listed(name) for name in ([configuration.planner] if is_chosen else planner_names())),
            *(PlannerInfo(name="refused", summary=why, presets=()) for why in refused_planners() if not is_chosen),
        ),
        predictions=get_args(Prediction),
        config_id=configuration.config_id,
        config_name=shown_name(configuration.name),
        weights=_weights(configuration, tuning),
        presets=tuple(
            PresetInfo(
                name=preset.name,
                short_name=preset.short_name,
                intent=preset.intent,
                weights={name: value for name, value in preset.weights.items() if value},
            )
            for preset in tuning.presets.values()
        ),
        settings=_settings(configuration, tuning),
        configurations=tuple(
            ConfigurationInfo(config_id=c.config_id, name=shown_name(c.name), base=c.base) for c in made
        ),
    )


async def configure_planner(arguments: ConfigurePlannerArguments, context: WorkflowContext) -> ConfigurePlannerResult:
    """Return a new configuration from a preset and changes of weights."""
    base = resolve_configuration(arguments.base, context)
    left_out: tuple[str, ...] = ()
    if arguments.planner is not None and known_planner(arguments.planner) != base.planner:
        if "base" in arguments.model_fields_set:
            left_out = (f"base {base.config_id} is not used, because it is a configuration of {base.planner}",)
        base = resolve_configuration(arguments.planner, context)
    made, notes = changed_configuration(base, arguments.preset, arguments.weights, arguments.settings)
    known = context.workspace.find("config", made.config_id) is not None
    store_configuration(context, base)
    recipe = Recipe(
        tool="configure_planner",
        arguments={
            "base": base.config_id,
            "preset": arguments.preset,
            "weights": list(arguments.weights),
            "settings": list(arguments.settings),
        },
        parents=(base.config_id,),
    )
    stored = store_configuration(context, made, recipe).read(PlannerConfiguration)
    context.made("config", stored.config_id)
    reference = base if arguments.preset is None else preset_configuration(base.planner, arguments.preset)
    if not differences(reference, stored):  # there is nothing to report relative to itself
        reference = base
    return ConfigurePlannerResult(
        config_id=stored.config_id,
        name=shown_name(stored.name),
        planner=stored.planner,
        base=base.config_id,
        against=shown_name(reference.name),
        changes=differences(reference, stored),
        notes=(*left_out, *notes),
        yaml=to_yaml(stored),
        reused=known,
    )


async def run_planner(arguments: RunPlannerArguments, context: WorkflowContext) -> RunPlannerResult:
    """Return one run directly, or several as a job that this call waits for."""
    faults, configurations = Faults(), dict[str, PlannerConfiguration]()
    world = PERFECT
    with faults.collecting():
        world = world_of(arguments.world)
    with faults.collecting():
        check_modes(arguments.traffic, arguments.prediction, world)
    with faults.collecting():
        choice = choose_scenarios(arguments.scenarios, context)
    for text in arguments.configs:
        with faults.collecting():
            configuration = resolve_configuration(text, context)
            configurations[configuration.config_id] = configuration
            check_world(configuration.planner, world)
    faults.raise_all()
    for configuration in configurations.values():
        store_configuration(context, configuration)
    modes = (arguments.prediction, arguments.traffic, arguments.seed, world)
    notes = (*choice.notes, *combination_notes(arguments.world))
    cells = [
        Cell(chosen.scenario_id, chosen.problem_id, configuration, *modes)
        for configuration in configurations.values()
        for chosen in choice.scenarios
    ]
    if len(cells) == 1:
        result = await run_cell(context, cells[0], notify_client=True)
        made = [result.record.run_id] if result.record is not None else []
        context.made("run", *made)
        return await answer_of(context, cells, [result], batch_id=None, notes=notes)
    return await run_many(context, cells, arguments.wait_s, notes)


def _listed(name: str) -> PlannerInfo:
    """Return a planner's entry; the entry of an external planner that cannot be imported says so."""
    try:
        tuning = tuning_of(name)
    except PlannerFailure as error:
        return PlannerInfo(name=name, summary=f"cannot be used: {error.message}", presets=())
    return PlannerInfo(name=name, summary=tuning.summary, presets=tuple(tuning.presets))


def _weights(configuration: PlannerConfiguration, tuning: PlannerTuning) -> tuple[WeightInfo, ...]:
    values = configuration.weights | configuration.external_weights
    return tuple(
        WeightInfo(
            name=weight.name,
            value=values.get(weight.name, 0.0),
            meaning=weight.meaning,
            raising=weight.raising,
            acts=weight.acts,
            computed_by=weight.computed_by,
            lowest=weight.lowest,
            highest=weight.highest,
        )
        for weight in (*tuning.weights.values(), *tuning.external.values())
    )


def _settings(configuration: PlannerConfiguration, tuning: PlannerTuning) -> tuple[SettingInfo, ...]:
    """Return the settings that have an effect in the planner."""
    values = setting_values(configuration.settings)
    return tuple(
        SettingInfo(name=item.name, value=values[item.name], range=item.range_text, meaning=item.meaning)
        for item in known_settings().values()
        if item.name not in tuning.idle_settings
    )
