"""Planner configurations: which one a word means, importing and storing them."""

from pathlib import Path

from ..engine.planners import source_that_drives
from ..engine.tuning import DEFAULT_CONFIGURATION, from_file, named_configuration, read_weight_file, to_yaml
from ..engine.workspace import Artifact, Recipe, content_digest, write_text
from ..schemas.artifacts import ImportedItem
from ..schemas.errors import NotPossible, UnknownName, closest
from ..schemas.planning import PlannerConfiguration
from ..schemas.runs import VERSION_MARK, configuration_id
from ..schemas.text import one_line, shown_name
from .context import WorkflowContext

_CURRENT = ("current", "latest")
_BY_NAME = "preset"
"""The tool in the recipe of a preset that was stored because it was run."""
_SEARCHED = 1000
"""How many of the newest configurations are looked through; chosen."""


def resolve_configuration(text: str, context: WorkflowContext) -> PlannerConfiguration:
    """Return the configuration of an id, of ``PLANNER:PRESET``, or the current one.

    Current is what the client configured or imported last, else the newest of the workspace, which is told;
    ``frenetix:Default`` if there is none.

    Raises:
        UnknownName: nothing of that name.
        NotPossible: it is named with a version of its planner that is not installed any more.
    """
    if text.lower() in _CURRENT:
        own = context.services.recent.last(["config"])
        made = [] if own else made_configurations(context, 1)
        if made:
            context.tell_whose("config", f"{made[0].config_id} ({shown_name(made[0].name)})")
        text = own[0][1] if own else made[0].config_id if made else DEFAULT_CONFIGURATION
    stored = context.workspace.find("config", configuration_id(text))
    if stored is not None:
        configuration = stored.read(PlannerConfiguration)
        _check_version(text, configuration)
        return configuration
    named = None if text.lower().startswith("cfg_") else named_configuration(text)
    if named is None:
        known = [made.config_id for made in made_configurations(context, _SEARCHED)]
        raise UnknownName(
            f"there is no configuration '{text}'",
            valid=[*closest(text, known), "current", DEFAULT_CONFIGURATION],
            next_step="call list_planners for configurations, or configure_planner for a new one",
        )
    return named


def _check_version(text: str, configuration: PlannerConfiguration) -> None:
    """Refuse a configuration under a version of its planner that does not drive any more (``cfg_…@d4e5f6a``)."""
    wanted = text.partition(VERSION_MARK)[2]
    if wanted and not source_that_drives(configuration.planner).startswith(wanted):
        raise NotPossible(
            f"{shown_name(configuration.name)} was run in version {wanted} of {configuration.planner}, "
            "which is another one now",
            valid=[configuration.config_id],
            next_step=f"name {configuration.config_id} for the version that is installed",
        )


def made_configurations(context: WorkflowContext, limit: int) -> list[PlannerConfiguration]:
    """Configurations that were configured or imported, newest first; presets that only were run are left out."""
    stored = context.workspace.newest(kind="config", limit=_SEARCHED)
    made = [artifact for artifact in stored if artifact.recipe.tool != _BY_NAME]
    return [artifact.read(PlannerConfiguration) for artifact in made[:limit]]


def store_configuration(
    context: WorkflowContext, configuration: PlannerConfiguration, recipe: Recipe | None = None, name: str | None = None
) -> Artifact:
    """Store a configuration with its YAML file; the same weights again are the stored ones.

    Raises:
        ResourceFailure: the disk is full.
    """
    recipe = recipe or Recipe(tool=_BY_NAME, arguments={"name": configuration.name, "id": configuration.config_id})
    with context.workspace.scratch() as folder:
        path = folder / "config.yaml"
        write_text(path, to_yaml(configuration), f"the configuration {configuration.config_id}")
        return context.workspace.put(
            "config",
            configuration.config_id,
            recipe=recipe,
            record=configuration,
            files={"config.yaml": path},
            name=name or configuration.name,
        )


async def import_configuration(context: WorkflowContext, path: Path, name: str | None) -> ImportedItem:
    """Store a cost-weight file, as the Frenetix reference has it or as exported here, as a configuration."""
    content = read_weight_file(path)
    configuration = from_file(content)
    before = context.workspace.find("config", configuration.config_id)
    arguments = {"content": content_digest(path)} | ({"name": name} if name else {})
    store_configuration(context, configuration, Recipe(tool="import_files", arguments=arguments), name)
    return ImportedItem(
        file=one_line(path.name),
        kind="config",
        artifact_id=configuration.config_id,
        summary=shown_name(configuration.name),
        reused=before is not None,
    )
