"""Planner configurations: made from a preset or another configuration, named by their content."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module

from ...schemas.planning import PlannerConfiguration, PlannerSettings, WeightChange
from ..planners import PLANNERS, known_planner
from .settings import apply_changes, changed_settings, known_settings, setting_values, stated_settings
from .weights import CostWeight, Preset, find_preset

# ---------- planner_tuning
# What can be set in a planner: its weights, presets, and the settings that act in it.


@dataclass(frozen=True)
class PlannerTuning:
    """Weights by name in their order; ``external`` ones are kept but act on nothing; presets by name.

    ``first_preset`` is what the bare name of the planner means; ``idle_settings`` do nothing in this planner.
    """

    summary: str
    weights: Mapping[str, CostWeight]
    external: Mapping[str, CostWeight]
    presets: Mapping[str, Preset]
    first_preset: str = "Default"
    idle_settings: tuple[str, ...] = ()

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        """Ranges of the weights that do not go from 0 to 1e6."""
        narrow = (weight for weight in self.weights.values() if (weight.lowest, weight.highest) != (0.0, 1e6))
        return {weight.name: (weight.lowest, weight.highest) for weight in narrow}


def tuning_of(planner: str) -> PlannerTuning:
    """What can be set in a planner.

    Raises:
        UnknownName: no such planner.
    """
    module, _, function = PLANNERS[known_planner(planner)].tuning.partition(":")
    found: PlannerTuning = getattr(import_module(module), function)()
    return found


def _names_elsewhere(planner: str) -> dict[str, str]:
    """Names that are no weights of this planner → what they are: weights of others, and settings."""
    found: dict[str, str] = {}
    for other in PLANNERS:
        tuning = tuning_of(other)
        found |= dict.fromkeys((*tuning.weights, *tuning.external), f"it is a weight of {other}, not of {planner}")
    return found | dict.fromkeys(known_settings(), "it is a setting; give it in settings")


# ---------- configurations
# Planner configurations: made from a preset or another configuration, named by their content.

DEFAULT_CONFIGURATION = "frenetix:Default"


def preset_configuration(planner: str, preset: Preset) -> PlannerConfiguration:
    """The configuration of a preset as it stands, with the default settings."""
    external = dict.fromkeys(tuning_of(planner).external, 0.0)
    return _named(planner, preset.name, dict(preset.weights), external, PlannerSettings())


def named_configuration(text: str) -> PlannerConfiguration | None:
    """The configuration that ``PLANNER:PRESET`` or ``PLANNER`` (its Default) means; None where it is no such name.

    Raises:
        UnknownName: a known form with an unknown planner or preset.
    """
    planner, colon, preset = text.partition(":")
    if not colon and text.lower().startswith("cfg_"):
        return None
    name = known_planner(planner)
    tuning = tuning_of(name)
    found = find_preset(preset, tuning.presets) if colon else tuning.presets[tuning.first_preset]
    return preset_configuration(name, found)


def changed_configuration(
    base: PlannerConfiguration, preset: str | None, changes: Sequence[str], settings: Sequence[str] = ()
) -> tuple[PlannerConfiguration, tuple[str, ...]]:
    """A base with all weights replaced by a preset's (where one is named), then changed; and remarks.

    ``settings`` are assignments as well; a preset does not touch them.

    Raises:
        UnknownName: a preset, weight or setting that does not exist or is another planner's.
        InvalidRequest: a change that is malformed or leads out of the range.
    """
    tuning = tuning_of(base.planner)
    start = base if preset is None else _replaced(base, find_preset(preset, tuning.presets))
    changed = apply_changes(
        start.weights | start.external_weights, changes, limits=tuning.limits, elsewhere=_names_elsewhere(base.planner)
    )
    weights = {name: changed.weights[name] for name in tuning.weights}
    external = {name: changed.weights[name] for name in tuning.external}
    after, setting_notes = changed_settings(base.settings, settings)
    made = _named(base.planner, start.preset, weights, external, after)
    if made.config_id != base.config_id:
        made = made.model_copy(update={"base": base.config_id, "assignments": (*changes, *settings)})
    return made, (*changed.notes, *setting_notes, *_idle_notes(base, made))


def differences(before: PlannerConfiguration, after: PlannerConfiguration) -> tuple[WeightChange, ...]:
    """The weights and settings in which two configurations of a planner differ, in their order."""
    old = before.weights | before.external_weights | setting_values(before.settings)
    new = after.weights | after.external_weights | setting_values(after.settings)
    return tuple(WeightChange(name=name, before=old[name], after=new[name]) for name in old if old[name] != new[name])


def to_yaml(configuration: PlannerConfiguration) -> str:
    """The cost-weight file in the form of the Frenetix reference, every weight in its order; planner and settings."""
    lines = [f"# {configuration.name} ({configuration.config_id})", "cost_weights:"]
    lines += [f"  {name}: {_number(value)}" for name, value in configuration.weights.items()]
    if configuration.external_weights:
        lines += [f"external_cost_weights:  # not acting in {configuration.planner}"]
        lines += [f"  {name}: {_number(value)}" for name, value in configuration.external_weights.items()]
    lines += [f"planner: {configuration.planner}", "settings:"]
    lines += [f"  {name}: {value:.12g}" for name, value in stated_settings(configuration.settings).items()]
    return "\n".join(lines) + "\n"


def _idle_notes(base: PlannerConfiguration, made: PlannerConfiguration) -> list[str]:
    """Remarks on what is kept but changes nothing in this planner."""
    notes = []
    idle = [name for name, value in made.external_weights.items() if value > 0]
    if idle:
        notes.append(f"{', '.join(idle)}: kept, but acts on nothing (the module is not part of this planner)")
    before, after = setting_values(base.settings), setting_values(made.settings)
    unused = [name for name in tuning_of(made.planner).idle_settings if before[name] != after[name]]
    if unused:
        notes.append(f"{', '.join(unused)}: kept, but acts on nothing in {made.planner}")
    return notes


def _replaced(base: PlannerConfiguration, preset: Preset) -> PlannerConfiguration:
    return base.model_copy(update={"weights": dict(preset.weights), "preset": preset.name})


def _named(
    planner: str, preset: str, weights: dict[str, float], external: dict[str, float], settings: PlannerSettings
) -> PlannerConfiguration:
    """The configuration with its id; its name is ``planner:preset`` while it equals one, else with a ``+`` part.

    Default settings are no part of the id: it stays what it was before there were settings.
    """
    stated = settings.model_dump(exclude_defaults=True)
    content = json.dumps([planner, weights, external, *([stated] if stated else [])], separators=(",", ":"))
    digest = hashlib.sha256(content.encode()).hexdigest()[:12]
    known = () if any(external.values()) else tuning_of(planner).presets.values()
    same = [entry.name for entry in known if entry.weights == weights]
    origin = same[0] if same else preset
    name = f"{planner}:{origin}" if same and not stated else f"{planner}:{origin}+{digest[:4]}"
    return PlannerConfiguration(
        config_id=f"cfg_{digest}",
        planner=planner,
        name=name,
        preset=origin,
        weights=weights,
        external_weights=external,
        settings=settings,
    )


def _number(value: float) -> str:
    return f"{value:.12g}" if value != int(value) else f"{value:.1f}"
