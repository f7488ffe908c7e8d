"""Resources by URI: what each template gives, and that nothing else can be read."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import anyio
import pytest
from mcp import MCPError
from mcp.client.subscriptions import ResourcesListChanged, ResourceUpdated
from mcp.types import INVALID_PARAMS, PromptReference, ResourceTemplate, ResourceTemplateReference

from plannerforge.engine.execution import JobStore
from plannerforge.engine.workspace.artifacts import ArtifactKind, Workspace
from plannerforge.engine.workspace.recipe import Recipe
from plannerforge.resources.templates import SCHEME, TEMPLATES, listed_resources, read_resource
from plannerforge.schemas.base import Model
from plannerforge.schemas.errors import InvalidRequest, UnknownName
from plannerforge.server.reading import page_of
from plannerforge.server.settings import Settings
from plannerforge.tools.registry import TOOLS

SCENARIO = "DEU_A-1_1_T-1"
RECIPE = Recipe(tool="test", arguments={"of": "resources"})
JOB = SimpleNamespace(job_id=f"job_{RECIPE.digest}", recipe=RECIPE)
URIS = {
    f"{SCHEME}scenario/{SCENARIO}/xml": ("<scenario/>", "application/xml"),
    f"{SCHEME}scenario/latest/xml": ("<scenario/>", "application/xml"),
    f"{SCHEME}scenario/{SCENARIO}/net": ("<net/>", "application/xml"),
    f"{SCHEME}config/cfg_1/yaml": ("jerk: 0.5", "application/yaml"),
    f"{SCHEME}run/run_1/steps": ("[]", "application/json"),
    f"{SCHEME}picture/p.png": (b"\x89PNG", "image/png"),
    f"{SCHEME}picture/p.gif": (b"GIF89a", "image/gif"),
}
COMPUTED = {
    f"{SCHEME}job/{JOB.job_id}": (JOB.job_id, "application/json"),
    f"{SCHEME}vocabulary/tags": ("roundabout", "application/json"),
    f"{SCHEME}vocabulary/edits": ("reroute", "application/json"),
    f"{SCHEME}vocabulary/behaviours": ("accel=", "application/json"),
    f"{SCHEME}vocabulary/logical_scenarios": ("crossing_cyclist", "application/json"),
    f"{SCHEME}vocabulary/pre_crash_types": ("nhtsa:26", "application/json"),
    f"{SCHEME}preset/frenetix/Comfort": ("jerk", "application/yaml"),
}
"""What is made when it is read, and a word of it."""
NOTHING = [
    "scenario/DEU_B-1_1_T-1/xml",
    "scenario/DEU_A-1_1_T-1/yaml",
    "scenario/DEU_A-1_1_T-1",
    "config/cfg_1/xml",
    "nothing/x/record",
    "job/job_1/record",
    "picture/missing.png",
    "picture/secret.txt",
    "report/r.html",
    "vocabulary/nothing",
    "vocabulary/tags/record",
    "preset/frenetix",
    "preset/frenetix/Nothing",
    "preset/nothing/Default",
    "job/job_2",
    "schema/nothing",
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
    made = {"pictures/p.png": b"\x89PNG", "pictures/p.gif": b"GIF89a"}
    for name, content in {**made, "pictures/secret.txt": b"x", "pictures/.hidden.png": b"x"}.items():
        path = opened.root / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)
    JobStore(opened.database).start("batch", JOB.recipe)
    yield opened
    opened.close()


@pytest.mark.parametrize("uri", URIS)
def test_uri_gives_its_file(workspace: Workspace, uri: str) -> None:
    assert read_resource(uri, workspace) == URIS[uri]


@pytest.mark.parametrize(("kind", "artifact_id"), [("scenario", SCENARIO), ("config", "cfg_1"), ("run", "run_1")])
def test_the_record_of_any_artifact_contains_its_recipe(workspace: Workspace, kind: str, artifact_id: str) -> None:
    content, mime_type = read_resource(f"{SCHEME}{kind}/{artifact_id}/record", workspace)
    assert mime_type == "application/json"
    record = json.loads(content)
    assert (record["artifact_id"], record["record"], record["recipe"]["tool"]) == (artifact_id, {"text": "é"}, "test")


@pytest.mark.parametrize("uri", COMPUTED)
def test_a_uri_gives_computed_content(workspace: Workspace, uri: str) -> None:
    word, mime_type = COMPUTED[uri]
    content, stated = read_resource(uri, workspace)
    assert stated == mime_type
    assert word in str(content)


@pytest.mark.parametrize("template", TEMPLATES, ids=lambda template: template.name)
def test_every_template_states_its_content_type(workspace: Workspace, template: ResourceTemplate) -> None:
    form = re.sub(r"\\{\w+\\}", "[^/]+", re.escape(template.uri_template))
    fitting = [uri for uri in (*URIS, *COMPUTED, f"{SCHEME}run/run_1/record") if re.fullmatch(form, uri)]
    assert fitting
    assert {read_resource(uri, workspace)[1] for uri in fitting} == {template.mime_type}


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
    known = [template.uri_template for template in TEMPLATES]
    by_tools = [f"{SCHEME}schema/{{tool}}", f"{SCHEME}view/{{ids}}"]
    assert [template.uri_template for template in templates] == [*known, *by_tools]
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


def test_listed_resources_can_be_read_with_the_stated_type_and_size(workspace: Workspace) -> None:
    listed = listed_resources(workspace)
    made = {f"{SCHEME}scenario/{SCENARIO}/xml", f"{SCHEME}config/cfg_1/yaml", f"{SCHEME}preset/idm/Default"}
    assert made <= {one.uri for one in listed}
    assert [one.uri for one in listed if not one.title] == []
    for resource in listed:
        content, mime_type = read_resource(resource.uri, workspace)
        size = len(content.encode() if isinstance(content, str) else content)
        told = None if "/preset/" in resource.uri else size
        assert (resource.mime_type, resource.size) == (mime_type, told), resource


def test_newest_twenty_artifacts_are_listed_with_searches_and_starters_last(workspace: Workspace) -> None:
    for number in range(30):
        workspace.put("search", f"search_{number}", recipe=Recipe(tool="test"), record=Note())
    with workspace.scratch() as folder:
        (folder / "scenario.xml").write_text("<scenario/>")
        files = {"scenario.xml": folder / "scenario.xml"}
        workspace.put("scenario", "ZAM_S-1_1_T-1", recipe=Recipe(tool="starter"), record=Note(), files=files)
    listed = [one.name for one in listed_resources(workspace) if re.search("/(record|xml|yaml)$", one.uri)]
    searches = [f"search_{number}" for number in range(29, 13, -1)]
    assert listed == ["run_1", "cfg_1", SCENARIO, "ZAM_S-1_1_T-1", *searches]
    for number in range(30):
        workspace.put("batch", f"batch_{number}", recipe=Recipe(tool="test"), record=Note())
    listed = [one.name for one in listed_resources(workspace) if one.uri.endswith("/record")]
    assert listed == [f"batch_{number}" for number in range(29, 9, -1)]


def test_pages_follow_each_other_and_no_other_cursor_is_taken() -> None:
    entries, pages, cursor = list(range(7)), [], None
    while True:
        page, cursor = page_of(entries, cursor, 3)
        pages.append(page)
        if cursor is None:
            break
    assert pages == [[0, 1, 2], [3, 4, 5], [6]]
    assert page_of([], None, 3) == ([], None)
    for wrong in ("from-7", "from--1", "3", "from-", "from-٣" * 3):
        with pytest.raises(InvalidRequest, match="is not a cursor"):
            page_of(entries, wrong, 3)


@pytest.mark.anyio
@pytest.mark.usefixtures("workspace")
async def test_client_lists_a_handful_and_is_refused_a_wrong_cursor(connect: Any) -> None:
    async with connect() as client:
        listed = await client.list_resources()
        for ask in (client.list_resources, client.list_resource_templates, client.list_tools, client.list_prompts):
            with pytest.raises(MCPError, match="is not a cursor") as caught:
                await ask(cursor="nonsense")
            assert caught.value.error.code == INVALID_PARAMS
        following = await client.list_resources(cursor=listed.next_cursor) if listed.next_cursor else None
        entries = [*listed.resources, *(following.resources if following else [])]
    uris = [resource.uri for resource in listed.resources]
    assert uris[:3] == [SCHEME + name for name in ("catalog", "maps", "planners")]
    assert len(uris) <= 50
    assert {f"{SCHEME}schema/{spec.name}" for spec in TOOLS} <= {one.uri for one in entries}
    assert [one.uri for one in entries if not one.title] == []


@pytest.mark.anyio
@pytest.mark.usefixtures("starter_ready")
async def test_a_resource_agrees_with_its_tool(connect: Any) -> None:
    calls = {"catalog": ("describe_catalog", {}), "planners": ("list_planners", {})}
    async with connect() as client:
        for name, (tool, arguments) in calls.items():
            (content,) = (await client.read_resource(SCHEME + name)).contents
            answer = await client.call_tool(tool, arguments)
            assert json.loads(content.text) == answer.structured_content
        (schema,) = (await client.read_resource(f"{SCHEME}schema/run_planner")).contents
        tool = next(tool for tool in (await client.list_tools()).tools if tool.name == "run_planner")
    assert json.loads(schema.text)["arguments"] == tool.input_schema


@pytest.mark.anyio
@pytest.mark.usefixtures("workspace")
@pytest.mark.parametrize(
    ("template", "argument", "typed", "given", "expected"),
    [
        ("scenario/{id}/xml", "id", "deu", {}, [SCENARIO]),
        ("config/{id}/yaml", "id", "", {}, ["cfg_1"]),
        ("job/{id}", "id", "job_", {}, [JOB.job_id]),
        ("{kind}/{id}/record", "kind", "sc", {}, ["scenario"]),
        ("{kind}/{id}/record", "id", "", {"kind": "run"}, ["run_1"]),
        ("{kind}/{id}/record", "id", "r", {}, ["run_1"]),
        ("picture/{name}.gif", "name", "", {}, ["p"]),
        ("picture/{name}.png", "name", "p", {}, ["p"]),
        ("vocabulary/{name}", "name", "ta", {}, ["tags"]),
        ("preset/{planner}/{name}", "planner", "fren", {}, ["frenetix"]),
        ("preset/{planner}/{name}", "name", "comf", {"planner": "frenetix"}, ["Comfort"]),
        ("schema/{tool}", "tool", "modify", {}, ["modify_scenario"]),
        ("view/{ids}", "ids", "", {}, ["run_1", SCENARIO]),
        ("view/{ids}", "ids", "run_1+DEU", {}, [f"run_1+{SCENARIO}"]),
    ],
)
async def test_arguments_of_templates_are_completed(
    connect: Any, template: str, argument: str, typed: str, given: dict[str, str], expected: list[str]
) -> None:
    async with connect() as client:
        reference = ResourceTemplateReference(uri=SCHEME + template)
        found = await client.complete(reference, {"name": argument, "value": typed}, context_arguments=given)
    assert found.completion.values == expected


@pytest.mark.anyio
@pytest.mark.usefixtures("workspace")
async def test_completion_of_a_missing_name_is_refused(connect: Any) -> None:
    async with connect() as client:
        for reference in (ResourceTemplateReference(uri=f"{SCHEME}nothing/{{id}}"), PromptReference(name="nothing")):
            with pytest.raises(MCPError) as caught:
                await client.complete(reference, {"name": "id", "value": ""})
            assert caught.value.error.code == INVALID_PARAMS


@pytest.mark.anyio
@pytest.mark.filterwarnings("ignore::mcp.shared.exceptions.MCPDeprecationWarning")
async def test_a_subscriber_is_notified_of_a_job_s_progress(connect: Any, era: str, workspace: Workspace) -> None:
    """By another server on the workspace, too: the news are those of the workspace."""
    uri, told = f"{SCHEME}job/{JOB.job_id}", anyio.Event()
    store = JobStore(workspace.database)

    async def note(message: Any) -> None:
        if getattr(getattr(message, "params", None), "uri", None) == uri:
            told.set()

    async with connect(message_handler=note) as client, anyio.create_task_group() as tasks:

        async def work() -> None:
            for step in range(1, 1_000):
                store.update(JOB.job_id, share=step / 1_000, message=f"step {step}", results=())
                await anyio.sleep(0.1)

        tasks.start_soon(work)
        with anyio.fail_after(60):
            if era == "legacy":
                await client.session.subscribe_resource(uri)
                await told.wait()
                await client.session.unsubscribe_resource(uri)
            else:
                async with client.listen(resource_subscriptions=[uri], resources_list_changed=True) as news:
                    assert await anext(aiter(news)) == ResourceUpdated(uri=uri)
                    workspace.put("search", "search_1", recipe=Recipe(tool="test"), record=Note())
                    async for event in news:
                        if event == ResourcesListChanged():
                            break
        tasks.cancel_scope.cancel()


@pytest.mark.anyio
@pytest.mark.usefixtures("workspace")
@pytest.mark.filterwarnings("ignore::mcp.shared.exceptions.MCPDeprecationWarning")
async def test_subscribing_to_a_missing_resource_has_no_effect(connect: Any, era: str) -> None:
    if era != "legacy":
        pytest.skip("subscriptions to what is not there are kept, and never told anything")
    async with connect() as client:
        with pytest.raises(MCPError, match=r"\[unknown_name\]"):
            await client.session.subscribe_resource(f"{SCHEME}job/job_missing")
