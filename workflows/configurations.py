"""Planner configurations: resolve words, import and store them."""

from pathlib import Path

from ..engine.planners import source_that_drives
from ..engine.tuning import DEFAULT_CONFIGURATION, from_file, named_configuration, read_weight_file, to_yaml
from ..engine.workspace import Artifact, Recipe, content_digest, write_text
from ..schemas.artifacts import ImportedItem
from ..schemas.errors import NotPossible, UnknownName, closest, misspelt_names
from ..schemas.planning import PlannerConfiguration
from ..schemas.runs import VERSION_MARK, configuration_id
from ..schemas.text import one_line, shown_name
from .context import WorkflowContext

_CURRENT = ("current", "latest")
_BY_NAME = "preset"
"""The tool that the recipe names for a preset that was stored because it was run."""
BY_SEARCH = "optimize_planner"
"""The tool that the recipe names for a candidate of a search."""
_SEARCHED = 1000
"""How many of the newest configurations are searched (chosen)."""


def resolve_configuration(text: str, context: WorkflowContext) -> PlannerConfiguration:
    """Return the configuration with an id, the one for ``PLANNER:PRESET``, or the current one.

    The current one is what the client configured or imported last, otherwise the workspace's newest (with a remark), or
    ``frenetix:Default`` if nothing is configured.

    Raises:
        UnknownName: the name is unknown.
        NotPossible: the text refers to a planner version that is no longer installed.
    """
    if text.lower() in _CURRENT:
        own = context.services.recent.last(["config"])
        made = [] if own else made_configurations(context, 1)
        if made:
            context.remark_source("config", f"{made[0].config_id} ({shown_name(made[0].name)})")
        text = own[0][1] if own else made[0].config_id if made else DEFAULT_CONFIGURATION
    stored = context.workspace.find("config", configuration_id(text))
    if stored is not None:
        configuration = stored.read(PlannerConfiguration)
        _check_version(text, configuration)
        return configuration
    preset = None if text.lower().startswith("cfg_") else _named(text)
    if preset is None:
        known = [made.config_id for made in made_configurations(context, _SEARCHED)]
        words = ("current", DEFAULT_CONFIGURATION)
        raise UnknownName(
            f"there is no configuration '{text}'",
            valid=dict.fromkeys([*misspelt_names(text, [*known, *words]), *words, *closest(text, known)]),
            next_step="choose an existing one, or call configure_planner for a new one",
        )
    return preset


def _named(text: str) -> PlannerConfiguration | None:
    """Return the configuration that a planner's name or ``PLANNER:PRESET`` gives, or None."""
    try:
        return named_configuration(text)
    except UnknownName as refusal:
        raise refusal.with_words(text, _CURRENT) from refusal.__cause__


def _check_version(text: str, configuration: PlannerConfiguration) -> None:
    """Refuse a configuration with a planner version that is no longer installed (``cfg_…@d4e5f6a``)."""
    wanted = text.partition(VERSION_MARK)[2]
    if wanted and not source_that_drives(configuration.planner).startswith(wanted):
        raise NotPossible(
            f"{shown_name(configuration.name)} was run with version {wanted} of {configuration.planner}, "
            "which is no longer installed",
            valid=[configuration.config_id],
            next_step=f"use {configuration.config_id} for the installed version",
        )


def made_configurations(context: WorkflowContext, limit: int) -> list[PlannerConfiguration]:
    """Return configurations that were configured or imported, newest first, without presets and candidates."""
    stored = context.workspace.newest(kind="config", limit=_SEARCHED)
    made = [artifact for artifact in stored if artifact.recipe.tool not in (_BY_NAME, BY_SEARCH)]
    return [artifact.read(PlannerConfiguration) for artifact in made[:limit]]


def store_configuration(
    context: WorkflowContext, configuration: PlannerConfiguration, recipe: Recipe | None = None, name: str | None = None
) -> Artifact:
    """Store a configuration with its YAML file; the same weights give the stored configuration.

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
    """Store a cost-weight file as a configuration, in the format of the Frenetix reference or of an export."""
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
