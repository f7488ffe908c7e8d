"""The maps in the catalogue's answer: by country with their sites, whole, by page, or those of a country or place."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import pytest
from support.catalog import facts

from plannerforge.engine.workspace import Recipe, Workspace
from plannerforge.schemas.catalog import DescribeCatalogArguments, DescribeCatalogResult
from plannerforge.schemas.errors import UnknownName
from plannerforge.schemas.generation import MAP_FACTS_VERSION, MapFacts
from plannerforge.schemas.scenarios import ScenarioRecord
from plannerforge.workflows.catalog import describe_catalog
from plannerforge.workflows.context import Services, WorkflowContext

pytestmark = pytest.mark.anyio


def map_of(place: str, country: str | None, sites: dict[str, int]) -> MapFacts:
    return MapFacts(
        map_id=f"map_{place.lower()}",
        file_name="map.osm",
        place=place,
        places=(place,),
        country=country,
        south=0.0,
        west=0.0,
        north=0.1,
        east=0.1,
        streets=(),
        refs=(),
        sites=cast("Any", sites),
        road_km=1.0,
        attribution="",
        facts_version=MAP_FACTS_VERSION,
    )


def store(call: WorkflowContext, one: MapFacts) -> None:
    with call.workspace.scratch() as folder:
        file = folder / one.file_name
        file.write_text("<osm/>")
        recipe = Recipe(tool="import_files", arguments={"of": one.place})
        call.workspace.put("map", one.map_id, recipe=recipe, record=one, files={one.file_name: file})


@pytest.fixture
def call(tmp_path: Path) -> Iterator[WorkflowContext]:
    """A workspace with a scenario in Bonn and maps of Munich, Vigo and a place of no known country."""
    workspace, unused = Workspace(tmp_path), cast("Any", None)
    call = WorkflowContext(Services(workspace, unused, unused, unused, unused, with_starter=False), unused)
    bonn = facts("DEU_Bonn-1_1_T-1")
    record = ScenarioRecord(facts=bonn, origin="imported", content="bonn")
    workspace.put("scenario", bonn.scenario_id, recipe=Recipe(tool="import_files"), record=record)
    for one in (
        map_of("Munich", "DEU", {"roundabout": 2, "urban": 5}),
        map_of("Vigo", "ESP", {}),
        map_of("Somewhere", None, {"ramp": 1}),
    ):
        store(call, one)
    yield call
    workspace.close()


async def asked(call: WorkflowContext, **arguments: Any) -> DescribeCatalogResult:
    return await describe_catalog(DescribeCatalogArguments(**{"facet": "maps"} | arguments), call)


async def test_maps_are_listed_by_country_with_their_sites(call: WorkflowContext) -> None:
    found = await asked(call)
    assert [land.country for land in found.maps] == ["DEU", "ESP", "ZAM", "?"]
    text = found.to_text()
    assert "DEU: 1 map, 7 sites\n- “Munich” (map_munich): roundabout 2, urban 5" in text
    assert "- “Vigo” (map_vigo): no sites" in text
    assert found.maps_rest == ""


@pytest.mark.parametrize("within", ["DEU", "Germany", "Munich", "München"])
async def test_only_the_maps_of_a_country_or_place_are_listed(call: WorkflowContext, within: str) -> None:
    assert [land.listed for land in (await asked(call, within=within)).maps] == [
        ("“Munich” (map_munich): roundabout 2, urban 5",)
    ]


async def test_scenarios_are_counted_in_a_country_or_place(call: WorkflowContext) -> None:
    assert [(await asked(call, facet="tags", within=word)).scenarios for word in ("Germany", "Bonn", "Vigo")] == [
        1,
        1,
        0,
    ]


async def test_scenario_places_and_map_places_are_kept_apart(call: WorkflowContext) -> None:
    places, maps = await asked(call, facet="places"), await asked(call)
    assert "Bonn" in places.to_text()
    assert "Munich" not in places.to_text()
    assert "Munich" in maps.to_text()
    assert "Bonn" not in maps.to_text()


async def test_a_shortened_list_gives_the_count_and_the_call_for_the_rest(call: WorkflowContext) -> None:
    for number in range(40):
        store(call, map_of(f"Town{number:02}", "DEU", {"urban": 1}))
    first, second = await asked(call, within="DEU"), await asked(call, within="DEU", offset=40)
    assert first.maps_rest == "Maps 1 to 40 of 41; describe_catalog facet=maps, within='DEU', offset=40 shows more."
    assert second.maps_rest == "Maps 41 to 41 of 41."
    assert [len(found.maps[0].listed) for found in (first, second)] == [40, 1]
    assert "DEU: 41 maps, 47 sites" in second.to_text()


async def test_a_place_without_scenarios_and_maps_is_refused(call: WorkflowContext) -> None:
    with pytest.raises(UnknownName) as refused:
        await asked(call, within="Vigoo")
    assert refused.value.valid[0] == "“Vigo”"


@pytest.mark.parametrize("within", ["!Atlantis", "!Vigo|Atlantis", "!XX"])
async def test_a_place_that_would_exclude_nothing_is_refused(call: WorkflowContext, within: str) -> None:
    with pytest.raises(UnknownName) as refused:
        await asked(call, within=within)
    assert refused.value.message.endswith(f"'{within.removeprefix('!').rpartition('|')[2]}'")


@pytest.mark.parametrize(
    ("within", "scenarios", "maps"),
    [
        ("!Vigo", 1, {"Munich", "Somewhere"}),
        ("!Bonn", 0, {"Munich", "Vigo", "Somewhere"}),
        ("!Munich|Vigo", 1, {"Somewhere"}),
        ("!ESP", 1, {"Munich", "Somewhere"}),
        ("!Spain|DEU", 0, {"Somewhere"}),
        ("ESP|DEU", 1, {"Munich", "Vigo"}),
        ("!FJI", 1, {"Munich", "Vigo", "Somewhere"}),
    ],
)
async def test_everything_outside_the_excluded_places_is_counted(
    call: WorkflowContext, within: str, scenarios: int, maps: set[str]
) -> None:
    found = await asked(call, within=within)
    assert found.scenarios == scenarios
    listed = {line for land in found.maps if land.country != "ZAM" for line in land.listed}
    assert {name for name in ("Munich", "Vigo", "Somewhere") if any(f"“{name}”" in line for line in listed)} == maps


async def test_a_misspelt_country_is_answered_with_the_country(call: WorkflowContext) -> None:
    with pytest.raises(UnknownName) as refused:
        await asked(call, within="Germny")
    assert refused.value.valid[0] == "Germany"
    assert refused.value.remedies[0].changes[0].values == {"within": "Germany"}
