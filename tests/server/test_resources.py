"""Resources by URI: what each template gives, and that nothing else can be read."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mcp import MCPError
from mcp.types import INVALID_PARAMS

from plannerforge.engine.workspace.artifacts import ArtifactKind, Workspace
from plannerforge.engine.workspace.recipe import Recipe
from plannerforge.resources.templates import SCHEME, TEMPLATES, read_resource
from plannerforge.schemas.base import Model
from plannerforge.schemas.errors import UnknownName
from plannerforge.server.settings import Settings

SCENARIO = "DEU_A-1_1_T-1"
URIS = {
    f"{SCHEME}scenario/{SCENARIO}/xml": ("<scenario/>", "application/xml"),
    f"{SCHEME}scenario/latest/xml": ("<scenario/>", "application/xml"),
    f"{SCHEME}scenario/{SCENARIO}/net": ("<net/>", "application/xml"),
    f"{SCHEME}config/cfg_1/yaml": ("jerk: 0.5", "application/yaml"),
    f"{SCHEME}run/run_1/steps": ("[]", "application/json"),
    f"{SCHEME}picture/p.png": (b"\x89PNG", "image/png"),
    f"{SCHEME}picture/p.gif": (b"GIF89a", "image/gif"),
    f"{SCHEME}report/r.html": ("<html/>", "text/html"),
}
NOTHING = [
    "scenario/DEU_B-1_1_T-1/xml",
    "scenario/DEU_A-1_1_T-1/yaml",
    "scenario/DEU_A-1_1_T-1",
    "config/cfg_1/xml",
    "nothing/x/record",
    "job/job_1/record",
    "picture/missing.png",
    "picture/secret.txt",
    "picture/.hidden.png",
    "scenario/../../etc/passwd",
    "scenario/../record",
    "scenario/%2e%2e/record",
    "scenario/DEU_A-1_1_T-1/../../workspace.sqlite",
    "picture/../workspace.sqlite",
    "picture/%2e%2e%2fworkspace.sqlite",
    "picture/..%5cworkspace.sqlite",
    "picture/p.png/",
    "picture/p.png%00.html",
    "scenario/DEU_A-1_1_T-1/xml?x=1",
    "",
]


class Note(Model):
    text: str = "é"


@pytest.fixture
def workspace(settings: Settings) -> Iterator[Workspace]:
    opened = Workspace(settings.workspace)
    stored: dict[tuple[ArtifactKind, str], dict[str, str]] = {
        ("scenario", SCENARIO): {"scenario.xml": "<scenario/>", "scenario.net.xml": "<net/>"},
        ("config", "cfg_1"): {"config.yaml": "jerk: 0.5"},
        ("run", "run_1"): {"steps.json": "[]"},
    }
    for (kind, artifact_id), files in stored.items():
        with opened.scratch() as folder:
            for name, content in files.items():
                (folder / name).write_text(content)
            paths = {name: folder / name for name in files}
            opened.put(kind, artifact_id, recipe=Recipe(tool="test"), record=Note(), files=paths)
    made = {"pictures/p.png": b"\x89PNG", "pictures/p.gif": b"GIF89a", "reports/r.html": b"<html/>"}
    for name, content in {**made, "pictures/secret.txt": b"x", "pictures/.hidden.png": b"x"}.items():
        path = opened.root / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)
    yield opened
    opened.close()


@pytest.mark.parametrize("uri", URIS)
def test_uri_gives_its_file(workspace: Workspace, uri: str) -> None:
    assert read_resource(uri, workspace) == URIS[uri]


@pytest.mark.parametrize(("kind", "artifact_id"), [("scenario", SCENARIO), ("config", "cfg_1"), ("run", "run_1")])
def test_record_of_any_artifact_holds_its_recipe(workspace: Workspace, kind: str, artifact_id: str) -> None:
    content, mime_type = read_resource(f"{SCHEME}{kind}/{artifact_id}/record", workspace)
    assert mime_type == "application/json"
    record = json.loads(content)
    assert (record["artifact_id"], record["record"], record["recipe"]["tool"]) == (artifact_id, {"text": "é"}, "test")


def test_every_template_is_tried_here() -> None:
    tried = {(uri.removeprefix(SCHEME).split("/")[0], uri.rpartition("/")[2]) for uri in URIS}
    for template in TEMPLATES:
        kind, _, rest = template.uri_template.removeprefix(SCHEME).partition("/")
        part = rest.rpartition("/")[2]
        assert part == "record" or any(kind == k and (part in (p, "{name}")) for k, p in tried), template


@pytest.mark.parametrize("uri", [*(SCHEME + rest for rest in NOTHING), "file:///etc/passwd", "scenario/x/xml", ""])
def test_anything_else_is_refused_without_touching_a_file(workspace: Workspace, uri: str) -> None:
    with pytest.raises(UnknownName) as caught:
        read_resource(uri, workspace)
    assert caught.value.valid or caught.value.next_step


def test_link_out_of_the_folder_of_pictures_is_refused(workspace: Workspace, tmp_path: Path) -> None:
    (tmp_path / "outside.png").write_bytes(b"x")
    (workspace.root / "pictures" / "link.png").symlink_to(tmp_path / "outside.png")
    with pytest.raises(UnknownName):
        read_resource(f"{SCHEME}picture/link.png", workspace)


@pytest.mark.anyio
@pytest.mark.usefixtures("probe_tools", "workspace")
async def test_client_lists_templates_and_reads_text_and_pictures(connect: Any) -> None:
    async with connect() as client:
        templates = (await client.list_resource_templates()).resource_templates
        (text,) = (await client.read_resource(f"{SCHEME}scenario/{SCENARIO}/xml")).contents
        (picture,) = (await client.read_resource(f"{SCHEME}picture/p.png")).contents
    assert [template.uri_template for template in templates] == [template.uri_template for template in TEMPLATES]
    assert (text.text, text.mime_type) == ("<scenario/>", "application/xml")
    assert (picture.blob, picture.mime_type) == ("iVBORw==", "image/png")


@pytest.mark.anyio
@pytest.mark.usefixtures("probe_tools", "workspace")
@pytest.mark.parametrize("rest", ["scenario/DEU_B-1_1_T-1/xml", "picture/../workspace.sqlite", "../../etc/passwd"])
async def test_client_is_refused_with_invalid_params(connect: Any, rest: str) -> None:
    async with connect() as client:
        with pytest.raises(MCPError, match=r"\[unknown_name\]") as caught:
            await client.read_resource(SCHEME + rest)
    assert caught.value.error.code == INVALID_PARAMS
