"""Roads about a place: whole where it is small, about sites of the asked type where it is large, whole roads always."""

from pathlib import Path

import pytest
from support.online import HERE, drawn_town, services_of, town_places

from benchmarks.maps.extracts import Extract
from benchmarks.maps.loopback import Fault, MapServers, settlement
from plannerforge.engine.execution import silent
from plannerforge.engine.maps import fetch_maps, read_map_file
from plannerforge.engine.maps.online.fetch import area_km2, write_osm
from plannerforge.schemas.errors import NotPossible, UnknownName
from plannerforge.schemas.generation import FetchedMaps, FetchMapRequest, ScenarioType
from plannerforge.schemas.maps import Box, NamedPlace

FILES = ("kreiselheim.osm", "quadratstadt.osm", "landmoor.osm")


@pytest.fixture(scope="module")
def extracts() -> list[Extract]:
    """Towns 6 km apart: one with a roundabout, one with signals, one with rural roads."""
    return [drawn_town(file, (HERE[0] + 0.054 * number, HERE[1]), 1000 * number) for number, file in enumerate(FILES)]


@pytest.fixture(scope="module")
def region(extracts: list[Extract]) -> Box:
    south, west = min(one.box[0] for one in extracts), min(one.box[1] for one in extracts)
    return south, west, max(one.box[2] for one in extracts), max(one.box[3] for one in extracts)


def named(box: Box, **more: object) -> NamedPlace:
    middle = {"latitude": (box[0] + box[2]) / 2, "longitude": (box[1] + box[3]) / 2}
    given = {"label": "Somewhere", "name": "Somewhere", "kind": "city", "osm_id": "relation/1", "country": "DEU"}
    return NamedPlace.model_validate({**given, **middle, "box": box, **more})


def fetched(
    servers: MapServers, folder: Path, box: Box, kind: ScenarioType, *, count: int = 1, **more: object
) -> FetchedMaps:
    request = FetchMapRequest(
        services=services_of(servers, folder / "answers", most_km2=10.0),
        folder=str(folder),
        place=named(box, **more),
        scenario_type=kind,
        count=count,
    )
    return fetch_maps(request, silent)


def test_a_small_place_is_fetched_whole_with_its_name_and_country(extracts: list[Extract], tmp_path: Path) -> None:
    town = extracts[0]
    with MapServers([town], town_places("Ringstadt", town)).running() as servers:
        (only,) = fetched(servers, tmp_path, town.box, "any", name="Ringstadt").maps
        assert len(servers.asked("one", "/interpreter")) == 1
    assert (only.facts.place, only.facts.country) == ("Ringstadt", "DEU")
    assert only.facts.sites["roundabout"] == 1
    assert only.data_time == "2026-11-20T10:00:00Z"
    read = read_map_file(Path(only.path))
    assert {way.way_id for way in read.ways} == set(town.ways)
    assert {key: node.position for key, node in read.nodes.items()} == {
        key: pytest.approx((lat, lon), abs=1e-7)
        for key, (lat, lon, _) in town.nodes.items()
        if any(key in nodes for nodes, _ in town.ways.values())
    }


@pytest.mark.parametrize(("kind", "town"), [("roundabout", 0), ("signalised_intersection", 1), ("rural", 2)])
def test_of_a_large_place_the_surroundings_of_a_site_are_fetched(
    kind: ScenarioType, town: int, extracts: list[Extract], region: Box, tmp_path: Path
) -> None:
    with MapServers(extracts, ()).running() as servers:
        result = fetched(servers, tmp_path, region, kind)
    (only,) = result.maps
    assert area_km2(only.core) < 10 < area_km2(region)
    south, _, north, _ = extracts[town].box
    assert south - 0.01 <= (only.core[0] + only.core[2]) / 2 <= north + 0.01
    assert only.facts.sites[kind] > 0
    assert "too large to fetch whole" in result.notes[0]


def test_many_scenarios_have_several_maps_without_overlapping_cores(
    extracts: list[Extract], region: Box, tmp_path: Path
) -> None:
    with MapServers(extracts, ()).running() as servers:
        maps = fetched(servers, tmp_path, region, "signalised_intersection", count=2).maps
        assert len(maps) == 1  # it has three
        maps = fetched(servers, tmp_path, region, "rural", count=7).maps
    cores = [one.core for one in maps]
    assert all(
        one[0] >= other[2] or one[2] <= other[0] or one[1] >= other[3] or one[3] <= other[1]
        for number, one in enumerate(cores)
        for other in cores[:number]
    )


def test_a_road_that_only_the_map_knows_is_found_in_its_town(
    extracts: list[Extract], region: Box, tmp_path: Path
) -> None:
    with MapServers(extracts, ()).running() as servers:
        (only,) = fetched(servers, tmp_path, region, "any", roads=(("L17",),)).maps
        south, _, north, _ = extracts[2].box
        assert south <= (only.core[0] + only.core[2]) / 2 <= north
        with pytest.raises(UnknownName, match="has no such road in “Somewhere”"):
            fetched(servers, tmp_path, region, "any", roads=(("Elm Street",),))


def test_missing_sites_are_refused_with_available_ones(extracts: list[Extract], tmp_path: Path) -> None:
    with MapServers(extracts, ()).running() as servers:
        with pytest.raises(NotPossible, match="no signalised_intersection site") as caught:
            fetched(servers, tmp_path, extracts[0].box, "signalised_intersection")
        assert caught.value.reason == "no_such_site"
        assert "roundabout" in caught.value.valid
        with pytest.raises(NotPossible, match="no road for vehicles"):
            fetched(servers, tmp_path, (10.0, 10.0, 10.01, 10.01), "any")


def test_houses_are_requested_only_where_they_add_information(extracts: list[Extract], tmp_path: Path) -> None:
    with MapServers(extracts, ()).running() as servers:
        fetched(servers, tmp_path, extracts[0].box, "roundabout")
        fetched(servers, tmp_path, extracts[0].box, "urban")
        first, second = (request.parameters["data"] for request in servers.asked("one", "/interpreter"))
    assert '"building"' not in first
    assert '"building"' in second


def test_the_same_request_writes_the_same_bytes_without_a_service(extracts: list[Extract], tmp_path: Path) -> None:
    one, other = tmp_path / "one", tmp_path / "other"
    one.mkdir()
    other.mkdir()
    with MapServers(extracts, [settlement(["Ringstadt"], "DEU", extracts[0].box)]).running() as servers:
        request = FetchMapRequest(
            services=services_of(servers, tmp_path / "answers"), folder=str(one), place=named(extracts[0].box)
        )
        servers.fail("one", Fault("403"))
        first = fetch_maps(request, silent).maps[0]
    second = fetch_maps(request.model_copy(update={"folder": str(other)}), silent).maps[0]
    assert Path(first.path).read_bytes() == Path(second.path).read_bytes()
    assert (first.query, first.service, second.kept) == (second.query, second.service, True)


def test_elements_are_written_once_by_kind_and_id(tmp_path: Path) -> None:
    node = {"type": "node", "id": 2, "lat": 48.0, "lon": 11.0, "tags": {"name": 'A "b" & c'}}
    way = {"type": "way", "id": 1, "nodes": [3, 2], "tags": {"highway": "primary"}}
    rule = {"type": "relation", "id": 9, "members": [{"type": "way", "ref": 1, "role": "from"}], "tags": {}}
    elements = [rule, way, node, {"type": "node", "id": 3, "lat": 48.1, "lon": 11.0}, node]
    write_osm(elements, (47.99, 10.99, 48.11, 11.01), tmp_path / "a.osm")
    write_osm(elements[::-1], (47.99, 10.99, 48.11, 11.01), tmp_path / "b.osm")
    assert (tmp_path / "a.osm").read_bytes() == (tmp_path / "b.osm").read_bytes()
    read = read_map_file(tmp_path / "a.osm")
    assert read.nodes[2].tags["name"] == 'A "b" & c'
    assert read.ways[0].node_ids == (3, 2)
    assert read.bounds == (47.99, 10.99, 48.11, 11.01)
