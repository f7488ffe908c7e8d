"""Planner configurations: made from a preset or another configuration, named by their content."""

import hashlib
import json
from collections.abc import Sequence

from plannerforge.engine.planners.registry import known_planner
from plannerforge.engine.tuning.changes import apply_changes
from plannerforge.engine.tuning.presets import Preset, find_preset, presets
from plannerforge.engine.tuning.weights import cost_weights, external_weights
from plannerforge.schemas.planning import PlannerConfiguration, WeightChange

DEFAULT_CONFIGURATION = "frenetix:Default"


def preset_configuration(planner: str, preset: Preset) -> PlannerConfiguration:
    """The configuration of a preset as it stands."""
    return _named(planner, preset.name, dict(preset.weights), dict.fromkeys(external_weights(), 0.0))


def named_configuration(text: str) -> PlannerConfiguration | None:
    """The configuration that ``PLANNER:PRESET`` or ``PLANNER`` (its Default) means; None where it is no such name.

    Raises:
        UnknownName: a known form with an unknown planner or preset.
    """
    planner, colon, preset = text.partition(":")
    if not colon and text.lower().startswith("cfg_"):
        return None
    name = known_planner(planner)
    return preset_configuration(name, find_preset(preset) if colon else presets()["Default"])


def changed_configuration(
    base: PlannerConfiguration, preset: str | None, changes: Sequence[str]
) -> tuple[PlannerConfiguration, tuple[str, ...]]:
    """A base with all weights replaced by a preset's (where one is named), then changed; and remarks.

    Raises:
        UnknownName: a preset or weight that does not exist.
        InvalidRequest: a change that is malformed or leads to a negative or infinite weight.
    """
    start = base if preset is None else _replaced(base, find_preset(preset))
    changed = apply_changes(start.weights | start.external_weights, changes)
    weights = {name: changed.weights[name] for name in cost_weights()}
    external = {name: changed.weights[name] for name in external_weights()}
    idle = [name for name, value in external.items() if value > 0]
    notes = list(changed.notes)
    if idle:
        notes.append(f"{', '.join(idle)}: kept, but acts on nothing (the module is not part of this planner)")
    made = _named(base.planner, start.preset, weights, external)
    if made.config_id != base.config_id:
        made = made.model_copy(update={"base": base.config_id, "assignments": tuple(changes)})
    return made, tuple(notes)


def differences(before: PlannerConfiguration, after: PlannerConfiguration) -> tuple[WeightChange, ...]:
    """The weights in which two configurations differ, in the order of the weights."""
    old, new = before.weights | before.external_weights, after.weights | after.external_weights
    return tuple(WeightChange(name=name, before=old[name], after=new[name]) for name in old if old[name] != new[name])


def to_yaml(configuration: PlannerConfiguration) -> str:
    """The cost-weight file in the form of the Frenetix reference, every weight in its order."""
    lines = [f"# {configuration.name} ({configuration.config_id}), planner {configuration.planner}", "cost_weights:"]
    lines += [f"  {name}: {_number(value)}" for name, value in configuration.weights.items()]
    lines += [f"external_cost_weights:  # not acting in {configuration.planner}"]
    lines += [f"  {name}: {_number(value)}" for name, value in configuration.external_weights.items()]
    return "\n".join(lines) + "\n"


def _replaced(base: PlannerConfiguration, preset: Preset) -> PlannerConfiguration:
    return base.model_copy(update={"weights": dict(preset.weights), "preset": preset.name})


def _named(planner: str, preset: str, weights: dict[str, float], external: dict[str, float]) -> PlannerConfiguration:
    """The configuration with its id; its name is ``planner:preset`` while it equals one, else with a ``+`` part."""
    content = json.dumps([planner, weights, external], separators=(",", ":"))
    digest = hashlib.sha256(content.encode()).hexdigest()[:12]
    same = [entry.name for entry in presets().values() if entry.weights == weights and not any(external.values())]
    origin = same[0] if same else preset
    name = f"{planner}:{origin}" if same else f"{planner}:{origin}+{digest[:4]}"
    return PlannerConfiguration(
        config_id=f"cfg_{digest}", planner=planner, name=name, preset=origin, weights=weights, external_weights=external
    )


def _number(value: float) -> str:
    return f"{value:.12g}" if value != int(value) else f"{value:.1f}"
