"""Planner configurations, created from a preset or another configuration, with ids derived from their content."""

from collections.abc import Sequence

from ...schemas.errors import Faults
from ...schemas.planning import PlannerConfiguration, PlannerSettings, WeightChange, configuration_id_of
from ...schemas.text import enumerated
from ..planners import PLANNERS, known_planner
from .settings import apply_assignments, changed_settings, known_settings, setting_values
from .tunings import tuning_of
from .weight_file import WeightFile, to_yaml

_MOST_NAMED = 3
"""Weights and settings that a configuration's name includes (chosen)."""
DEFAULT_CONFIGURATION = "frenetix:Default"
"""The default configuration: the reference's own tuning of Frenetix."""


def preset_configuration(planner: str, preset: str | None = None) -> PlannerConfiguration:
    """Return the unchanged configuration of a preset (by default the planner's first) with the default settings.

    Raises:
        UnknownName: There is no such planner or preset.
    """
    name, tuning = known_planner(planner), tuning_of(planner)
    chosen = tuning.presets[tuning.first_preset] if preset is None else tuning.preset(preset, name)
    external = dict.fromkeys(tuning.external, 0.0)
    return _configuration(name, chosen.name, dict(chosen.weights), external, PlannerSettings())


def named_configuration(text: str) -> PlannerConfiguration | None:
    """Resolve ``PLANNER:PRESET`` or ``PLANNER`` (its Default) to a configuration; None for any other text.

    Raises:
        UnknownName: The form is right, but the planner or preset is unknown.
    """
    planner, colon, preset = text.partition(":")
    if not colon and text.lower().startswith("cfg_"):
        return None
    return preset_configuration(planner, preset if colon else None)


def changed_configuration(
    base: PlannerConfiguration, preset: str | None, changes: Sequence[str], settings: Sequence[str] = ()
) -> tuple[PlannerConfiguration, tuple[str, ...]]:
    """Apply a preset's weights (if given) and then changes to a base; return the result and remarks.

    ``settings`` are assignments, too; a preset does not affect them.

    Raises:
        UnknownName: A preset, weight or setting does not exist, or belongs to another planner.
        InvalidRequest: A change is malformed, or its result is out of range.
    """
    tuning = tuning_of(base.planner)
    start = base
    faults = Faults()
    taken: list[str] = []
    with faults.collecting():
        if preset is not None:
            chosen = tuning.preset(preset, base.planner)
            if preset.strip().lower() not in (chosen.name.lower(), chosen.short_name.lower()):
                taken.append(f"{preset.strip()!r} is read as the preset {chosen.name}")
            start = base.model_copy(update={"weights": dict(chosen.weights), "preset": chosen.name})
    with faults.collecting():
        values, elsewhere = start.weights | start.external_weights, _names_elsewhere()
        changed = apply_assignments(
            values, changes, limits=tuning.limits, owner=base.planner, elsewhere=elsewhere, idle=tuning.external
        )
    with faults.collecting():
        after, setting_notes = changed_settings(base.settings, settings)
    faults.raise_all()
    weights = {name: changed.values[name] for name in tuning.weights}
    external = {name: changed.values[name] for name in tuning.external}
    made = _configuration(base.planner, start.preset, weights, external, after, base.template)
    if made.config_id != base.config_id:
        made = made.model_copy(update={"base": base.config_id, "assignments": (*changes, *settings)})
    return made, (*taken, *changed.notes, *setting_notes, *_idle_notes(base, made))


def from_file(file: WeightFile) -> PlannerConfiguration:
    """Return the configuration of a weight file, which keeps the file's comments, order and layout.

    A file in our own form needs no template: the configuration follows from its values alone.

    Raises:
        UnknownName: There is no such planner, weight or setting.
        InvalidRequest: A value is out of its range.
    """
    made, _ = changed_configuration(preset_configuration(file.planner), None, file.weights, file.settings)
    if to_yaml(made) == file.text:
        return made
    kept = _configuration(
        made.planner, made.preset, made.weights, made.external_weights, made.settings, template=file.text
    )
    return kept.model_copy(update={"base": made.base, "assignments": made.assignments})


def differences(before: PlannerConfiguration, after: PlannerConfiguration) -> tuple[WeightChange, ...]:
    """Return the weights and settings in which two configurations of a planner differ, in order."""
    old = before.weights | before.external_weights | setting_values(before.settings)
    new = after.weights | after.external_weights | setting_values(after.settings)
    return tuple(WeightChange(name=name, before=old[name], after=new[name]) for name in old if old[name] != new[name])


def _names_elsewhere() -> dict[str, str]:
    """Return, by name, the reason why a planner has no such weight, such as that other planners have it."""
    owners: dict[str, list[str]] = {}
    for other in PLANNERS:
        tuning = tuning_of(other)
        for name in dict.fromkeys((*tuning.weights, *tuning.external)):
            owners.setdefault(name, []).append(other)
    names = {
        name: f"{enumerated(planners)} {'does' if len(planners) == 1 else 'do'}" for name, planners in owners.items()
    }
    return names | dict.fromkeys(known_settings(), "it is a setting, so pass it in settings")


def _idle_notes(base: PlannerConfiguration, made: PlannerConfiguration) -> list[str]:
    """Return remarks on values that are kept but have no effect in this planner."""
    notes = []
    idle = [name for name, value in made.external_weights.items() if value > 0]
    if idle:
        notes.append(f"{', '.join(idle)}: kept, but without effect (this planner does not include the module)")
    before, after = setting_values(base.settings), setting_values(made.settings)
    unused = [name for name in tuning_of(made.planner).idle_settings if before[name] != after[name]]
    if made.settings.vehicle_stated and not base.settings.states_vehicle:
        notes.append("vehicle=2 now applies to every ego; without it the ego's class decides (a car is vehicle 2)")
    if unused:
        notes.append(f"{', '.join(unused)}: kept, but without effect in {made.planner}")
    return notes


def _configuration(
    planner: str,
    preset: str,
    weights: dict[str, float],
    external: dict[str, float],
    settings: PlannerSettings,
    template: str = "",
) -> PlannerConfiguration:
    """Return the configuration with its id; its name is ``planner:preset`` plus the differences from the preset."""
    stated = settings.model_dump(exclude_defaults=True)
    known = () if any(external.values()) else tuning_of(planner).presets.values()
    same = [entry.name for entry in known if entry.weights == weights]
    origin = same[0] if same else preset
    usual = tuning_of(planner).presets[origin].weights if origin in tuning_of(planner).presets else {}
    vehicle = {"vehicle": settings.vehicle} if stated.pop("vehicle_stated", False) else {}
    changed = (
        {key: value for key, value in (weights | external).items() if value != usual.get(key, 0.0)} | vehicle | stated
    )
    parts = [f"{key}={value:g}" for key, value in changed.items()]
    more = [f"{len(parts) - _MOST_NAMED} more"] if len(parts) > _MOST_NAMED else []
    # In square brackets, because the list would run into the sentence that contains the name.
    name = f"{planner}:{origin}" + (f" [{', '.join([*parts[:_MOST_NAMED], *more])}]" if parts else "")
    return PlannerConfiguration(
        config_id=configuration_id_of(planner, weights, external, settings, template),
        planner=planner,
        name=name,
        preset=origin,
        weights=weights,
        external_weights=external,
        settings=settings,
        template=template,
    )
