"""Scenarios at places that no map at hand shows: fetched, kept, told where from; asked which one; refused by name."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mcp import Client
from mcp.types import ElicitRequestParams, ElicitResult
from support.online import drawn_town, town_places
from support.server import Connect

from benchmarks.maps.loopback import Fault, MapServers, Mirror, settlement
from plannerforge.engine.workspace import Workspace
from plannerforge.server.assembly import create_server
from plannerforge.server.settings import ANSWERS_FOLDER, Settings
from plannerforge.server.tool_calls import answer_text

pytestmark = pytest.mark.anyio
SPRINGFIELDS = {"Illinois": (39.8, -89.6), "Missouri": (37.2, -93.3)}


@pytest.fixture(scope="module")
def servers() -> Iterator[MapServers]:
    """A town with a roundabout, and two towns of one name with signals, far away in two states."""
    ring = drawn_town("kreiselheim.osm")
    towns = [drawn_town("quadratstadt.osm", at, 1000 * number) for number, at in enumerate(SPRINGFIELDS.values(), 1)]
    named = [
        settlement(["Springfield"], "USA", town.box, importance=0.6, state=state)
        for state, town in zip(SPRINGFIELDS, towns, strict=True)
    ]
    places = [*town_places("Ringstadt", ring), *named]
    with MapServers([ring, *towns], places, (Mirror("one"), Mirror("two"))).running() as running:
        yield running


@pytest.fixture
def online(servers: MapServers, settings: Settings) -> Settings:
    servers.faults.clear()
    servers.requests.clear()
    return changed(settings, servers)


def changed(settings: Settings, servers: MapServers, **more: Any) -> Settings:
    return settings.model_copy(
        update={
            "maps_online": "online",
            "nominatim_url": servers.nominatim,
            "overpass_urls": servers.mirrors,
            "maps_delay_s": 0.0,
            "starter": False,
            **more,
        }
    )


async def generate(client: Client, **given: Any) -> tuple[str, list[str]]:
    """The text of the answer, and the ids of what was made; none where it was refused."""
    result = await client.call_tool("generate_scenarios", {"duration_s": 5, "goal": "steps:20", **given})
    assert result.is_error == (result.structured_content is None)
    made = (result.structured_content or {}).get("scenarios", [])
    return answer_text(result), [one["scenario_id"] for one in made]


def stored(settings: Settings, kind: str) -> list[Any]:
    workspace = Workspace(settings.workspace)
    try:
        return workspace.newest(kind=kind, limit=50)  # type: ignore[arg-type]
    finally:
        workspace.close()


async def test_a_place_is_fetched_cached_and_generated_again_without_a_net(
    connect: Connect, online: Settings, servers: MapServers, tmp_path: Path
) -> None:
    async with connect(online) as client:
        text, (made,) = await generate(client, place="Ringstadt", scenario_type="roundabout")
    assert f"downloaded from 127.0.0.1:{servers.port}, data of 2026-11-20T10:00:00Z" in text
    assert "© OpenStreetMap contributors, ODbL" in text
    assert made.startswith("DEU_Ringstadt")
    (fetched,) = stored(online, "map")
    assert fetched.recipe.tool == "fetch_map"
    assert fetched.recipe.arguments["service"] == f"127.0.0.1:{servers.port}"
    assert fetched.recipe.arguments["data_time"] == "2026-11-20T10:00:00Z"
    assert 'way["highway"]' in fetched.recipe.arguments["query"]
    (scenario,) = stored(online, "scenario")
    assert scenario.recipe.parents == (fetched.artifact_id,)
    other = changed(online, servers, workspace=tmp_path / "other", maps_online="cache")
    shutil.copytree(online.workspace / ANSWERS_FOLDER, other.workspace / ANSWERS_FOLDER)
    asked = len(servers.requests)
    async with connect(other) as client:
        text, again = await generate(client, place="Ringstadt", scenario_type="roundabout")
    assert again == [made]
    assert "downloaded earlier" in text
    assert len(servers.requests) == asked
    file = Path("scenarios") / made / "scenario.xml"
    assert (online.workspace / file).read_bytes() == (other.workspace / file).read_bytes()


async def test_local_maps_take_precedence_unless_the_net_is_requested(
    connect: Connect, online: Settings, servers: MapServers
) -> None:
    async with connect(online) as client:
        text, _ = await generate(client, place="Kreiselheim", scenario_type="roundabout")
        assert "downloaded" not in text
        assert servers.requests == []
        text, _ = await generate(client, place="Ringstadt", source="local")
        assert text.startswith("[unknown_name] no map contains 'Ringstadt'")
        assert servers.requests == []
        text, _ = await generate(client, place="Kreiselheim", source="online")
        assert "knows no such place" in text
        assert len(servers.requests) == 1


async def test_the_setting_decides_whether_the_net_is_queried(
    connect: Connect, online: Settings, servers: MapServers
) -> None:
    offline = changed(online, servers, maps_online="offline")
    async with connect(offline) as client:
        text, _ = await generate(client, place="Ringstadt")
        assert text.startswith("[unknown_name] no map contains 'Ringstadt'")
        text, _ = await generate(client, place="Ringstadt", source="online")
        assert "maps_online is offline" in text
    cached = changed(online, servers, maps_online="cache")
    async with connect(cached) as client:
        text, _ = await generate(client, place="Ringstadt")
        assert "maps_online is cache, so it is not asked" in text
    assert servers.requests == []


async def test_the_services_learn_the_place_and_the_roads_but_not_the_traffic(
    connect: Connect, online: Settings, servers: MapServers
) -> None:
    async with connect(online) as client:
        given = {"vehicles": ["truck=3"], "density": "medium", "duration_s": 7, "ego": "type:truck", "seed": 4711}
        _, made = await generate(client, place="Ringstadt", scenario_type="urban", **given)
        assert len(made) == 1
    asked = [request for request in servers.requests if not request.path.endswith("/status")]
    keys = {request.service: set(request.parameters) for request in asked}
    assert "Ringstadt" in asked[0].parameters["q"]
    assert {service: names for service, names in keys.items() if service != "nominatim"} == {
        service: {"data"} for service in keys if service != "nominatim"
    }
    sent = " ".join(f"{request.path} {dict(request.parameters)} {request.user_agent}" for request in asked)
    assert not [word for word in ("truck", "medium", "4711", "idm", str(online.workspace)) if word in sent]


async def test_an_impossible_request_is_refused_before_a_service_is_queried(
    connect: Connect, online: Settings, servers: MapServers
) -> None:
    async with connect(online) as client:
        for given, told in (
            ({"vehicles": ["tank=5"]}, "there is no vehicle class 'tank'"),
            ({"road_classes": ["canal"]}, "there is no road class 'canal'"),
            ({"bbox": [48.2, 16.4, 48.1, 16.3]}, "is not a box"),
            ({"place": "map_0123456789ab"}, "no map contains"),
        ):
            text, made = await generate(client, **{"place": "Ringstadt", **given})
            assert told in text
            assert made == []
    assert servers.requests == []


async def test_services_that_fail_leave_no_files_behind(
    connect: Connect, online: Settings, servers: MapServers
) -> None:
    async with connect(online) as client:
        servers.fail("one", Fault("cut", 2))
        servers.fail("two", Fault("html", 2))
        text, _ = await generate(client, place="Ringstadt", scenario_type="urban")
        assert text.startswith("[service_failure]")
        assert "broke off" in text
        assert "page instead of data" in text
        assert stored(online, "map") == []
        assert list((online.workspace / "scratch").iterdir()) == []
        text, made = await generate(client, place="Ringstadt", scenario_type="urban")
        assert len(made) == 1
        servers.fail("nominatim", Fault("403", 2))
        text, _ = await generate(client, place="Ringstadt, Bavaria", scenario_type="urban")
        assert "Nominatim cannot be used" in text


async def test_an_invented_place_is_not_a_failure_of_the_service(
    connect: Connect, online: Settings, servers: MapServers
) -> None:
    async with connect(online) as client:
        servers.fail("nominatim", Fault("403", 9))
        invented, _ = await generate(client, place="Xyldrun am Quelm")
        assert invented.startswith("[unknown_name]")
        assert "GeoNames" in invented
        real, _ = await generate(client, place="Ouagadougou")
        assert real.startswith("[service_failure]")
        assert "only local maps are available" in real
        assert "Next: call again" not in real
        street, _ = await generate(client, place="Moonlight Alley, Kreiselheim")
        assert "“Kreiselheim”" in street
        misspelled, _ = await generate(client, place="Kraiselheim")
        assert "“Kreiselheim”" in misspelled


async def test_the_user_chooses_between_two_towns_if_the_client_can_ask(
    warm_workers: None, online: Settings, era: str, tmp_path: Path
) -> None:
    asked: list[ElicitRequestParams] = []

    async def choose(context: Any, parameters: ElicitRequestParams) -> ElicitResult:
        asked.append(parameters)
        return ElicitResult(action="accept", content={"choice": "Springfield, Missouri, United States of America"})

    server = create_server(online, start_folder=tmp_path)
    async with Client(server, mode=era, elicitation_callback=choose) as client:  # type: ignore[arg-type]
        text, made = await generate(client, place="Springfield", scenario_type="signalised_intersection")
    assert len(made) == 1, text
    assert "roads of “Springfield, Missouri" in text
    (question,) = asked
    assert question.message == "Which Springfield do you mean?"


async def test_an_ambiguous_town_is_refused_with_both_if_the_user_does_not_choose(
    warm_workers: None, online: Settings, era: str, tmp_path: Path
) -> None:
    async def decline(context: Any, parameters: ElicitRequestParams) -> ElicitResult:
        return ElicitResult(action="decline")

    server = create_server(online, start_folder=tmp_path)
    for callback in (None, decline):
        async with Client(server, mode=era, elicitation_callback=callback) as client:  # type: ignore[arg-type]
            text, _ = await generate(client, place="Springfield")
        assert text.startswith("[invalid_request] several places have the name 'Springfield'")
        assert "Springfield, Illinois, United States of America" in text
        assert "place=“Springfield, Illinois, United States of America”" in text
    assert stored(online, "map") == []


async def test_a_map_with_a_similar_name_is_not_a_map_of_the_place(connect: Connect, settings: Settings) -> None:
    first, second = drawn_town("kreiselheim.osm"), drawn_town("quadratstadt.osm", (50.0, 9.0), 1000)
    places = [*town_places("Faultville 3", first), *town_places("Faultville 30", second)]
    with MapServers([first, second], places, (Mirror("one"), Mirror("two"))).running() as servers:
        async with connect(changed(settings, servers)) as client:
            _, (made,) = await generate(client, place="Faultville 3")
            for mirror in ("one", "two"):
                servers.fail(mirror, Fault("403", 9))
            text, others = await generate(client, place="Faultville 30")
            assert others == []
            assert "[service_failure]" in text
            again, (same,) = await generate(client, place="Faultville 3", seed=0)
            assert same == made, again
