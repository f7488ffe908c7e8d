"""Resources by URI: files and records of artifacts, jobs, pictures, vocabularies, presets.

Only the newest artifacts are listed, because a workspace contains thousands. Tools find the others and link to them.
"""

import json
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Final

from mcp.types import Resource, ResourceTemplate

from ..engine.execution import JobStore
from ..engine.planners import PLANNERS, planner_names
from ..engine.tuning import preset_configuration, to_yaml, tuning_of
from ..engine.workspace import ARTIFACT_KINDS, Artifact, ArtifactKind, Workspace
from ..schemas.artifacts import RESOURCE_SCHEME
from ..schemas.errors import NotPossible, UnknownName
from ..schemas.modification import EDITS
from ..schemas.text import printable_parts, quoted, shown_name
from ..schemas.vocabulary import FEATURES, MEASURES, OBSTACLE_TYPES, ORIGINS, ROAD_NET_KEYS, SIGNS, TAGS

SCHEME = RESOURCE_SCHEME
MOST_BYTES = 16 * 1024**2
"""The maximum size of a resource (chosen): its file is part of one message, several times in memory."""
MOST_LISTED = 20
"""How many of the newest artifacts are listed."""
_MOST_IDS = 1_000
"""How many of the newest artifacts or jobs of a kind are offered as completions of an id (chosen)."""
_JSON, _XML, _YAML = "application/json", "application/xml", "application/yaml"
_TEMPLATES: Final = (
    ("scenario/{id}/xml", "scenario", "Scenario", "CommonRoad XML of a scenario", _XML),
    ("scenario/{id}/net", "sumo_net", "SUMO net", "SUMO net of a scenario", _XML),
    ("config/{id}/yaml", "configuration", "Configuration", "Cost weights of a planner as YAML", _YAML),
    ("run/{id}/steps", "run_steps", "Steps of a run", "Trajectory and cost terms of a run", _JSON),
    ("{kind}/{id}/record", "record", "Record", "Record and recipe of any artifact", _JSON),
    ("job/{id}", "job", "Job", "State of long work; supports subscriptions", _JSON),
    ("picture/{name}.png", "picture", "Picture", "A picture from render", "image/png"),
    ("picture/{name}.gif", "animation", "Animation", "An animation from render", "image/gif"),
    ("vocabulary/{name}", "vocabulary", "Vocabulary", "Accepted words of an argument, with their meanings", _JSON),
    ("preset/{planner}/{name}", "preset", "Preset", "Cost weights of a planner's preset as YAML", _YAML),
)
TEMPLATES: tuple[ResourceTemplate, ...] = tuple(
    ResourceTemplate(uri_template=SCHEME + path, name=name, title=title, description=description, mime_type=mime_type)
    for path, name, title, description, mime_type in _TEMPLATES
)
_FILES = {
    ("scenario", "xml"): ("scenario.xml", _XML),
    ("scenario", "net"): ("scenario.net.xml", _XML),
    ("config", "yaml"): ("config.yaml", _YAML),
    ("run", "steps"): ("steps.json", _JSON),
}
_KINDS = {"config": "Configuration", "plan": "Coverage plan"}
"""The kinds of artifacts with another name in texts."""
_MAIN_PARTS = {"scenario": "xml", "config": "yaml"}
"""The file that an artifact's link leads to, if it is not the record."""
_MADE = {"png": "image/png", "gif": "image/gif"}
_VOCABULARIES: Final[dict[str, tuple[str, Callable[[], dict[str, str]]]]] = {
    "tags": ("Tags of scenarios", lambda: TAGS),
    "features": ("Computed features of scenarios", lambda: FEATURES),
    "measures": ("Computed numbers of scenarios", lambda: MEASURES),
    "signs": ("Traffic signs", lambda: SIGNS),
    "road_net": ("Keys of road networks", lambda: ROAD_NET_KEYS),
    "obstacles": ("Types of obstacles", lambda: dict.fromkeys(OBSTACLE_TYPES, "")),
    "origins": ("Origins of scenarios", lambda: {str(name): meaning for name, meaning in ORIGINS.items()}),
    "edits": ("Edits of modify_scenario, with their arguments", lambda: _edits()),
    "logical_scenarios": ("Logical scenarios of explore_boundary", lambda: _logical_scenarios()),
    "pre_crash_types": ("NHTSA's pre-crash types, with their logical scenarios", lambda: _pre_crash_types()),
    "behaviours": ("Presets of set_behaviour, with their values", lambda: _behaviours()),
}


def read_resource(uri: str, workspace: Workspace) -> tuple[str | bytes, str]:
    """Return the content and media type behind a URI.

    Raises:
        UnknownName: there is no such resource; the error lists the valid forms.
        NotPossible: the file exceeds 16 MiB.
    """
    match = re.fullmatch(rf"{re.escape(SCHEME)}([a-z]+)/([\w.\-]+)(?:/([\w.\-]+))?", uri)
    if match is None:
        raise unknown_resource(uri)
    kind, identifier, part = match[1], match[2], match[3]
    if kind == "picture" and part is None:
        return _picture(uri, workspace, identifier)
    if kind == "job" and part is None:
        return _as_json(JobStore(workspace.database).get(identifier).model_dump(mode="json")), _JSON
    if kind == "vocabulary" and part is None and identifier in _VOCABULARIES:
        return _as_json(_VOCABULARIES[identifier][1]()), _JSON
    if kind == "preset" and part is not None:
        return to_yaml(preset_configuration(identifier, part)), _YAML
    if kind not in ARTIFACT_KINDS:
        raise unknown_resource(uri)
    if part == "record":
        artifact = workspace.get(identifier, kind)  # type: ignore[arg-type]
        return _record(artifact), _JSON
    if part is None or (kind, part) not in _FILES:
        raise unknown_resource(uri)
    name, mime_type = _FILES[kind, part]
    artifact = workspace.get(identifier, kind)  # type: ignore[arg-type]
    return _content(workspace.file(artifact.kind, artifact.artifact_id, name)).decode(), mime_type


def listed_resources(workspace: Workspace) -> list[Resource]:
    """Return the resources that a client sees without a request: vocabularies, the newest artifacts, presets."""
    words = [
        Resource(
            uri=f"{SCHEME}vocabulary/{name}",
            name=name,
            title=title,
            description="words with their meaning",
            mime_type=_JSON,
            size=len(_as_json(read()).encode()),
        )
        for name, (title, read) in _VOCABULARIES.items()
    ]
    artifacts = [artifact_link(artifact, workspace) for artifact in workspace.newest_made(MOST_LISTED)]
    return [*words, *artifacts, *(_preset_link(planner, name) for planner in PLANNERS for name in _presets([planner]))]


def _preset_link(planner: str, name: str) -> Resource:
    """Return the link to a preset without the size of its YAML, which would take longer than the whole list."""
    return Resource(
        uri=f"{SCHEME}preset/{planner}/{name}",
        name=f"{planner}:{name}",
        title=f"Preset {name} of {planner}",
        description=tuning_of(planner).presets[name].intent,
        mime_type=_YAML,
    )


def artifact_link(artifact: Artifact, workspace: Workspace) -> Resource:
    """Return the link to an artifact: its file if that says everything, otherwise its record."""
    part = _MAIN_PARTS.get(artifact.kind, "record")
    if part == "record":
        size, mime_type = len(_record(artifact).encode()), _JSON
    else:
        name, mime_type = _FILES[artifact.kind, part]
        size = workspace.file(artifact.kind, artifact.artifact_id, name).stat().st_size
    return Resource(
        uri=f"{SCHEME}{artifact.kind}/{artifact.artifact_id}/{part}",
        name=artifact.artifact_id,
        title=shown_name(artifact.name) * bool(artifact.name)
        or f"{_KINDS.get(artifact.kind, artifact.kind.capitalize())} {artifact.artifact_id}",
        description=f"{artifact.kind}, created by {artifact.recipe.tool}",
        mime_type=mime_type,
        size=size,
    )


def job_link(job_id: str) -> Resource:
    """Return the link to a job's state, which supports subscriptions."""
    return Resource(
        uri=f"{SCHEME}job/{job_id}",
        name=job_id,
        title="Job",
        description="state of long work; subscribe to it, or call get_job",
        mime_type=_JSON,
    )


def picture_link(path: Path, mime_type: str) -> Resource:
    """Return the link to a picture or animation."""
    return Resource(
        uri=f"{SCHEME}picture/{path.name}",
        name=path.name,
        title="Animation" if mime_type == "image/gif" else "Picture",
        mime_type=mime_type,
        size=path.stat().st_size,
    )


def resource_completions(
    template: str, argument: str, typed: str, given: dict[str, str], workspace: Workspace
) -> list[str]:
    """Return the values of a template's argument that complete the typed text, ignoring case, newest first.

    Args:
        given: those of the template's other arguments that are known.

    Raises:
        UnknownName: there is no such template, or it has no such argument.
    """
    if template not in {known.uri_template for known in TEMPLATES}:
        raise unknown_resource(template)
    if f"{{{argument}}}" not in template:
        raise UnknownName(f"{template} has no argument {quoted(argument)}", valid=re.findall(r"{(\w+)}", template))
    kind = template.removeprefix(SCHEME).partition("/")[0]
    values = _values(kind if kind != "{kind}" else given.get("kind", ""), argument, template, given, workspace)
    return [value for value in values if value.casefold().startswith(typed.casefold())]


def _values(kind: str, argument: str, template: str, given: dict[str, str], workspace: Workspace) -> Iterable[str]:
    """Return all values of an argument."""
    if argument == "kind":
        return ARTIFACT_KINDS
    if argument == "planner":
        return planner_names()
    if kind == "vocabulary":
        return _VOCABULARIES
    if kind == "preset":
        return _presets(_planners(given))
    if kind == "job":
        return [job.job_id for job in JobStore(workspace.database).newest(_MOST_IDS)]
    if argument == "name":
        ending = template.rpartition(".")[2]
        files = [path for path in (workspace.root / "pictures").glob(f"*.{ending}") if not path.name.startswith(".")]
        newest = sorted(files, key=lambda path: (-path.stat().st_mtime, path.name))
        return [path.stem for path in newest[:_MOST_IDS]]
    wanted: ArtifactKind | None = kind if kind in ARTIFACT_KINDS else None  # type: ignore[assignment]
    return [found.artifact_id for found in workspace.newest(kind=wanted, limit=_MOST_IDS)]


def _planners(given: dict[str, str]) -> Iterable[str]:
    planner = given.get("planner", "")
    return [planner] if planner in PLANNERS else PLANNERS


def _presets(planners: Iterable[str]) -> Iterable[str]:
    """Return the names of the presets of the given planners, each once."""
    return dict.fromkeys(preset for name in planners for preset in tuning_of(name).presets)


def _edits() -> dict[str, str]:
    return {name: ", ".join(kind.arguments) for name, kind in EDITS.items()}


def _logical_scenarios() -> dict[str, str]:
    from ..engine.exploration import catalogue  # imported here for the same reason as the behaviours

    return {
        name: f"{one.summary}; {', '.join(f'{axis.name} {axis.low:g} to {axis.high:g}' for axis in one.parameters)}"
        for name, one in catalogue().items()
    }


def _pre_crash_types() -> dict[str, str]:
    from ..engine.exploration import pre_crash_types  # imported here for the same reason

    return {f"nhtsa:{one.number}": one.in_words() for one in pre_crash_types()}


def _behaviours() -> dict[str, str]:
    from ..engine.cosimulation import presets  # imported at the first request, because the first answers do not need it

    return {name: ", ".join(f"{key}={value:g}" for key, value in one.items()) for name, one in presets().items()}


def _record(artifact: Artifact) -> str:
    return _as_json(printable_parts(artifact.model_dump(mode="json")))


def _as_json(value: Any) -> str:
    return json.dumps(value, indent=1, ensure_ascii=False)


def _picture(uri: str, workspace: Workspace, name: str) -> tuple[bytes, str]:
    path = workspace.root / "pictures" / name
    mime_type = _MADE.get(path.suffix.removeprefix("."))
    if mime_type is None or name.startswith(".") or path.is_symlink() or not path.is_file():
        raise unknown_resource(uri)
    return _content(path), mime_type


def _content(path: Path) -> bytes:
    with path.open("rb") as stream:
        content = stream.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise NotPossible(
            f"{shown_name(path.name)} has more than {MOST_BYTES:,} bytes, too many for one message",
            next_step="use export_artifacts to copy it into a folder",
        )
    return content


def unknown_resource(uri: str) -> UnknownName:
    """Return the refusal of a URI without a resource."""
    return UnknownName(f"there is no resource {quoted(uri)}", valid=[template.uri_template for template in TEMPLATES])
