"""Resource templates: scenario files, run files, pictures and reports by URI.

Runs and scenarios are not enumerated (a workspace holds thousands); tools find them and answer with these links.
"""

import json
import re
from pathlib import Path

from mcp.types import ResourceTemplate

from ..engine.workspace import ARTIFACT_KINDS, Workspace
from ..schemas.errors import NotPossible, UnknownName
from ..schemas.text import quoted

SCHEME = "plannerforge://"
MOST_BYTES = 16 * 1024**2
"""Of a resource: its file stands in one message, several times over in memory. Chosen."""


TEMPLATES: tuple[ResourceTemplate, ...] = tuple(
    ResourceTemplate(uri_template=SCHEME + path, name=name, description=description, mime_type=mime_type)
    for path, name, description, mime_type in (
        ("scenario/{id}/xml", "scenario", "CommonRoad XML of a scenario", "application/xml"),
        ("scenario/{id}/net", "sumo_net", "SUMO net of a scenario", "application/xml"),
        ("config/{id}/yaml", "configuration", "Cost weights of a planner as YAML", "application/yaml"),
        ("run/{id}/steps", "run_steps", "Trajectory and cost terms of a run", "application/json"),
        ("{kind}/{id}/record", "record", "Record and recipe of any artifact", "application/json"),
        ("picture/{name}", "picture", "A picture or animation that render made", "image/png"),
        ("report/{name}", "report", "A report as one HTML page", "text/html"),
    )
)
_FILES = {
    ("scenario", "xml"): ("scenario.xml", "application/xml"),
    ("scenario", "net"): ("scenario.net.xml", "application/xml"),
    ("config", "yaml"): ("config.yaml", "application/yaml"),
    ("run", "steps"): ("steps.json", "application/json"),
}
_MADE = {"png": "image/png", "gif": "image/gif", "html": "text/html"}


def read_resource(uri: str, workspace: Workspace) -> tuple[str | bytes, str]:
    """Content and media type behind a URI.

    Raises:
        UnknownName: nothing is there; the valid forms are named.
        NotPossible: the file has more than 16 MiB.
    """
    match = re.fullmatch(rf"{re.escape(SCHEME)}([a-z]+)/([\w.\-]+)(?:/([a-z]+))?", uri)
    if match is None:
        raise _unknown(uri)
    kind, identifier, part = match[1], match[2], match[3]
    if kind in ("picture", "report") and part is None:
        return _made_file(uri, workspace, kind, identifier)
    if kind not in ARTIFACT_KINDS:
        raise _unknown(uri)
    if part == "record":
        artifact = workspace.get(identifier, kind)  # type: ignore[arg-type]
        return json.dumps(artifact.model_dump(mode="json"), indent=1, ensure_ascii=False), "application/json"
    if (kind, part) not in _FILES:
        raise _unknown(uri)
    name, mime_type = _FILES[kind, part]
    artifact = workspace.get(identifier, kind)  # type: ignore[arg-type]
    return _content(workspace.file(artifact.kind, artifact.artifact_id, name)).decode(), mime_type


def _made_file(uri: str, workspace: Workspace, kind: str, name: str) -> tuple[str | bytes, str]:
    path = workspace.root / f"{kind}s" / name
    mime_type = _MADE.get(path.suffix.removeprefix("."))
    if mime_type is None or name.startswith(".") or path.is_symlink() or not path.is_file():
        raise _unknown(uri)
    content = _content(path)
    return (content.decode() if mime_type == "text/html" else content), mime_type


def _content(path: Path) -> bytes:
    with path.open("rb") as stream:
        content = stream.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise NotPossible(
            f"{path.name} has more than {MOST_BYTES:,} bytes, too much for one message",
            next_step="export_artifacts copies it into a folder",
        )
    return content


def _unknown(uri: str) -> UnknownName:
    return UnknownName(f"there is no resource {quoted(uri)}", valid=[template.uri_template for template in TEMPLATES])
