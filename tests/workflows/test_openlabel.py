"""A scenario's tags leave as OpenLABEL, which an independent checker accepts, and come back as CommonRoad's tags."""

import json
from pathlib import Path
from typing import Any

import pytest
from mcp import Client
from openlabel_checker import check_file
from support.builders import town_road

from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("warm_workers")]
TOWN = "ZAM_Builder-1_1_T-1"
ASAM = "https://openlabel.asam.net/V1-0-0/ontologies/openlabel_ontology_scenario_tags.ttl"


def tagged(folder: Path, *types: str, file: str = f"{TOWN}.xml", **data: Any) -> Path:
    """A file of tags as another program writes it."""
    tags = {str(number): {"type": name, "ontology_uid": "0"} for number, name in enumerate(types)}
    for name, value in data.items():
        tags[str(len(tags))] = {"type": name, "ontology_uid": "0", "tag_data": value}
    metadata = {"schema_version": "1.0.0", "tagged_file": file}
    path = folder / "other.json"
    path.write_text(
        json.dumps({"openlabel": {"metadata": metadata, "ontologies": {"0": {"uri": ASAM}}, "tags": tags}}),
        encoding="utf-8",
    )
    return path


class Server:
    """A server on a folder, and what it answers."""

    def __init__(self, client: Client) -> None:
        self._client = client

    async def ask(self, tool: str, **arguments: Any) -> Any:
        result = await self._client.call_tool(tool, arguments)
        return result.content[0].text if result.is_error else result.structured_content  # type: ignore[union-attr]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "files"
    made.mkdir()
    return made


def server(settings: Settings, folder: Path) -> Client:
    return Client(create_server(settings.model_copy(update={"starter": False}), start_folder=folder))


async def test_exported_tags_are_valid_and_say_what_is_in_the_scenario(settings: Settings, folder: Path) -> None:
    town_road().write(folder / "town.xml")
    async with server(settings, folder) as client:
        ask = Server(client).ask
        await ask("import_files", path=str(folder / "town.xml"))
        exported = await ask("export_artifacts", ids=[TOWN], formats=["openlabel"], folder=str(folder / "out"))
    path = Path(exported["files"][0]["path"])
    assert path.name == f"{TOWN}.openlabel.json"
    assert not [issue for outcome in check_file(str(path)).outcomes for issue in outcome.issues]
    root = json.loads(path.read_text(encoding="utf-8"))["openlabel"]
    assert root["metadata"]["tagged_file"] == f"{TOWN}.xml"
    types = [tag["type"] for tag in root["tags"].values()]
    assert len(types) == len(set(types))
    assert "SubjectVehicleSpeed" in types
    for uid, ontology in root["ontologies"].items():
        own = {tag["type"] for tag in root["tags"].values() if tag["ontology_uid"] == uid}
        assert own - {"scenarioName"} <= set(ontology["boundary_list"])


async def test_tags_of_another_program_become_those_of_a_stored_scenario(settings: Settings, folder: Path) -> None:
    town_road().write(folder / "town.xml")
    tagged(
        folder,
        "RoundaboutMini",
        "MotionTurnLeft",
        "ToucanCrossing",
        LaneSpecificationLaneCount={"vec": [{"type": "values", "val": ["2", "3"]}]},
    )
    async with server(settings, folder) as client:
        ask = Server(client).ask
        await ask("import_files", path=str(folder / "town.xml"))
        item = (await ask("import_files", path=str(folder / "other.json")))["items"][0]
        assert item["kind"] == "scenario"
        assert item["artifact_id"] != TOWN
        assert "ToucanCrossing" in item["summary"]
        found = await ask("find_scenarios", tags=["roundabout", "turn_left", "multi_lane"])
        assert [match["scenario_id"] for match in found["matches"]] == [item["artifact_id"]]
        assert (await ask("import_files", path=str(folder / "other.json")))["items"][0]["reused"]


async def test_exported_files_are_imported_again_as_they_were(settings: Settings, folder: Path) -> None:
    town_road().write(folder / "town.xml")
    tagged(folder, "JunctionIntersection", "RoadTypeSlip", file="town.xml")
    async with server(settings, folder) as client:
        ask = Server(client).ask
        first = (await ask("import_files", path=str(folder / "other.json")))["items"][0]["artifact_id"]
        await ask("export_artifacts", ids=[first], formats=["xml", "openlabel"], folder=str(folder / "out"))
        again = await ask("import_files", path=str(folder / "out"))
    assert {item["artifact_id"] for item in again["items"]} == {first}
    assert (again["added"], again["refused"]) == (0, 0)


@pytest.mark.parametrize(
    "text", ["{", "[]", '{"openlabel": {}}', '{"openlabel": {"tags": {"0": {"type": "X"}}}}', "[" * 9999]
)
async def test_files_without_tags_are_refused(settings: Settings, folder: Path, text: str) -> None:
    (folder / "other.json").write_text(text, encoding="utf-8")
    async with server(settings, folder) as client:
        assert "OpenLABEL" in await Server(client).ask("import_files", path=str(folder / "other.json"))


async def test_tags_of_an_unknown_scenario_are_refused(settings: Settings, folder: Path) -> None:
    tagged(folder, "JunctionIntersection", file="../elsewhere/none.xml")
    async with server(settings, folder) as client:
        assert "there is no scenario" in await Server(client).ask("import_files", path=str(folder / "other.json"))
