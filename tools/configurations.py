"""Which configuration a word means, and storing configurations."""

from ..engine.tuning import DEFAULT_CONFIGURATION, named_configuration, to_yaml
from ..engine.workspace import Artifact, Recipe, write_text
from ..schemas.errors import UnknownName, closest
from ..schemas.planning import PlannerConfiguration
from .call import ToolCall

CURRENT = ("current", "latest")
_BY_NAME = "preset"
_SEARCHED = 1000


def resolve_configuration(text: str, call: ToolCall) -> PlannerConfiguration:
    """The configuration of an id, of ``PLANNER:PRESET``, or the current one.

    Current is the newest that was configured or imported here; ``frenetix:Default`` where there is none.

    Raises:
        UnknownName: nothing of that name.
    """
    if text.lower() in CURRENT:
        made = made_configurations(call, 1)
        return made[0] if made else _default()
    found = call.workspace.find("config", text)
    if found is not None:
        return found.read(PlannerConfiguration)
    named = None if text.lower().startswith("cfg_") else named_configuration(text)
    if named is None:
        known = [made.config_id for made in made_configurations(call, _SEARCHED)]
        raise UnknownName(
            f"there is no configuration '{text}'",
            valid=[*closest(text, known), "current", DEFAULT_CONFIGURATION],
            next_step="call list_planners for configurations, or configure_planner for a new one",
        )
    return named


def made_configurations(call: ToolCall, limit: int) -> list[PlannerConfiguration]:
    """Configurations that were configured or imported, newest first; presets that only were run are left out."""
    stored = call.workspace.newest(kind="config", limit=_SEARCHED)
    made = [artifact for artifact in stored if artifact.recipe.tool != _BY_NAME]
    return [artifact.read(PlannerConfiguration) for artifact in made[:limit]]


def store_configuration(
    call: ToolCall, configuration: PlannerConfiguration, recipe: Recipe | None = None, name: str | None = None
) -> Artifact:
    """Store a configuration with its YAML file; the same weights again are the stored ones.

    Raises:
        ResourceFailure: the disk is full.
    """
    recipe = recipe or Recipe(tool=_BY_NAME, arguments={"name": configuration.name, "id": configuration.config_id})
    with call.workspace.scratch() as folder:
        path = folder / "config.yaml"
        write_text(path, to_yaml(configuration), f"the configuration {configuration.config_id}")
        return call.workspace.put(
            "config",
            configuration.config_id,
            recipe=recipe,
            record=configuration,
            files={"config.yaml": path},
            name=name or configuration.name,
        )


def _default() -> PlannerConfiguration:
    default = named_configuration(DEFAULT_CONFIGURATION)
    if default is None:
        raise UnknownName(f"there is no configuration '{DEFAULT_CONFIGURATION}'")
    return default
