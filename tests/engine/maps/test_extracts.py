"""Extracts of countries by tiles: what is cut out of them is what the whole file shows."""

import mmap
import random
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from functools import cache
from itertools import pairwise
from pathlib import Path

import osmium
import pytest
from lxml import etree
from osmium.osm import mutable
from support.extracts import APART_DEG, IDS_APART, SECOND_TOWN, elements, indexed, written

from plannerforge.engine.execution import silent
from plannerforge.engine.maps import OsmMap, SiteFinder, cut_map, read_map_file
from plannerforge.engine.maps.extracts import indexing, tiles
from plannerforge.engine.maps.extracts.cutting import cut_extract
from plannerforge.engine.maps.extracts.indexing import index_extract
from plannerforge.engine.maps.extracts.tiles import TileStore, box_of_tile, tile_of, tiles_in
from plannerforge.engine.maps.osm import OsmWay, ground_distance_m, read_osm
from plannerforge.engine.maps.road_classes import ALL_ROADS
from plannerforge.schemas.errors import ResourceFailure, UnsafeInput
from plannerforge.schemas.generation import (
    CutExtractRequest,
    CutOfExtract,
    IndexedExtract,
    IndexExtractRequest,
    ScenarioType,
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("country")


@pytest.fixture(scope="module")
def country(folder: Path) -> IndexedExtract:
    return indexed(written(folder / "Country.osm.pbf", elements()), folder / "index")


@pytest.fixture(scope="module")
def whole(folder: Path) -> OsmMap:
    return read_osm(written(folder / "country.osm", elements()))


def cut(
    country: IndexedExtract, folder: Path, place: str | None = None, kind: ScenarioType = "any", seed: int = 0
) -> CutOfExtract:
    request = CutExtractRequest(
        index=country.index, folder=str(folder), facts=country.facts, place=place, scenario_type=kind, seed=seed
    )
    return cut_extract(request, silent)


@cache
def store_of(index: str) -> TileStore:
    return TileStore(Path(index))


def roads_within(osm: OsmMap, site: tuple[float, float], radius_m: float, target: Path) -> list[object]:
    """What is cut out around a site, without the ids of nodes and ways that the cut makes: they follow the last one."""
    cut_map(osm, site, radius_m, ALL_ROADS, target)
    root = etree.parse(str(target)).getroot()
    known = {way.way_id for way in osm.ways}
    at = {node.get("id"): (node.get("lat"), node.get("lon"), len(node)) for node in root.iter("node")}
    ways = [
        (way.get("id") if int(way.get("id")) in known else "", [at[nd.get("ref")] for nd in way.iter("nd")])
        for way in root.iter("way")
    ]
    return sorted(map(str, ways)) + sorted(
        str([(member.get("type"), member.get("role")) for member in relation.iter("member")])
        for relation in root.iter("relation")
    )


def test_a_site_of_any_place_is_cut_as_out_of_the_whole_file(
    country: IndexedExtract, whole: OsmMap, folder: Path
) -> None:
    chance = random.Random(18)
    store = store_of(country.index)
    for node in chance.sample([whole.nodes[key] for key in sorted(whole.nodes)], 100):
        radius_m = chance.uniform(20.0, 900.0)
        spot = node.latitude + chance.uniform(-0.004, 0.004), node.longitude + chance.uniform(-0.004, 0.004)
        aside = radius_m * 1.01 / ground_distance_m(spot, (spot[0], spot[1] + 1.0))
        up = radius_m * 1.01 / ground_distance_m(spot, (spot[0] + 1.0, spot[1]))
        part = store.read((spot[0] - up, spot[1] - aside, spot[0] + up, spot[1] + aside))
        expected = roads_within(whole, spot, radius_m, folder / "b.osm")
        assert roads_within(part, spot, radius_m, folder / "a.osm") == expected, (spot, radius_m)


def test_the_sites_of_all_tiles_match_those_of_the_whole_file(country: IndexedExtract, whole: OsmMap) -> None:
    assert len({tile_of(*node.position) for node in whole.nodes.values()}) == 8
    finder = SiteFinder(whole)
    everywhere = {(kind, site.osm_id) for kind in finder.kinds() for site in finder.find(kind)}
    with sqlite3.connect(country.index) as database:
        assert set(database.execute("SELECT kind, mark FROM sites")) == everywhere
    assert country.facts.sites == finder.kinds()


def test_the_facts_of_a_country_count_its_content(country: IndexedExtract, whole: OsmMap) -> None:
    facts = country.facts
    assert facts.extract is not None
    assert facts.extract.places == 2
    assert facts.extract.tiles == 8
    assert {"Fahrhausen", SECOND_TOWN} == set(facts.places)
    length_m = sum(
        ground_distance_m(whole.nodes[one].position, whole.nodes[other].position)
        for way in whole.roads()
        for one, other in pairwise(way.node_ids)
    )
    assert facts.road_km == pytest.approx(length_m / 1000, abs=0.1)


def test_a_part_is_found_by_its_town_and_contains_no_other(country: IndexedExtract, tmp_path: Path) -> None:
    found = cut(country, tmp_path, SECOND_TOWN)
    assert found.facts is not None
    assert (found.facts.place, found.label, found.words) == (SECOND_TOWN, f"town {SECOND_TOWN}", "")
    assert found.facts.cut_of == "map_country"
    part = read_map_file(Path(found.path))
    assert min(part.nodes) > IDS_APART
    south, west, north, east = found.core
    assert all(south < node.latitude < north and west < node.longitude < east for node in part.nodes.values())


def test_the_same_words_give_the_same_bytes(country: IndexedExtract, tmp_path: Path) -> None:
    one, other = tmp_path / "one", tmp_path / "other"
    for each in (one, other):
        each.mkdir()
        cut(country, each, f"Uferstraße, {SECOND_TOWN}", "intersection")
    assert (one / "cut.osm").read_bytes() == (other / "cut.osm").read_bytes()


def test_a_street_of_two_towns_is_that_of_the_town_that_is_named(country: IndexedExtract, tmp_path: Path) -> None:
    for town, west in (("Fahrhausen", 5.2), (SECOND_TOWN, 5.2 + APART_DEG)):
        found = cut(country, tmp_path, f"Uferstr., {town}")
        assert found.words == "Uferstr."
        assert west < found.core[1] < found.core[3] < west + 0.1


def test_a_street_without_a_town_is_looked_up_by_the_seed(country: IndexedExtract, tmp_path: Path) -> None:
    west = {round(cut(country, tmp_path, "Deichweg", seed=seed).core[1], 1) for seed in range(8)}
    assert west == {5.2, 5.6}


def test_a_crossing_is_in_the_middle_of_its_part(country: IndexedExtract, whole: OsmMap, tmp_path: Path) -> None:
    named = {way.tags["name"]: way for way in of_town_ways(whole) if "name" in way.tags}
    pairs = [
        (one, other)
        for one in named
        for other in named
        if one < other and set(named[one].node_ids) & set(named[other].node_ids)
    ]
    for one, other in pairs[:3]:
        found = cut(country, tmp_path, f"{one} / {other}, Fahrhausen")
        middle = (found.core[0] + found.core[2]) / 2, (found.core[1] + found.core[3]) / 2
        met = set.intersection(
            *(
                {key for way in whole.roads() if way.tags.get("name") == name for key in way.node_ids}
                for name in (one, other)
            )
        )
        assert min(ground_distance_m(middle, whole.nodes[key].position) for key in met) < 30.0
    assert pairs


def of_town_ways(whole: OsmMap) -> list[OsmWay]:
    return [way for way in whole.roads() if way.way_id < IDS_APART]


def test_the_country_itself_is_a_site_that_the_seed_draws(country: IndexedExtract, tmp_path: Path) -> None:
    parts = [cut(country, tmp_path, "Country", "intersection", seed) for seed in range(6)]
    assert len({part.label for part in parts}) > 1
    assert all(part.words == "" and part.facts and part.facts.sites["intersection"] for part in parts)


def test_words_without_meaning_in_the_country_give_no_part(country: IndexedExtract, tmp_path: Path) -> None:
    for place in ("Atlantis", "Uferstraße, Atlantis", "Nowhere Road"):
        assert cut(country, tmp_path, place) == CutOfExtract()


def test_a_missing_or_invalid_index_is_reported(country: IndexedExtract, tmp_path: Path) -> None:
    for content in (None, b"no index at all"):
        path = tmp_path / "extract.sqlite"
        if content is not None:
            path.write_bytes(content)
        with pytest.raises(ResourceFailure, match=r"extract\.sqlite"):
            cut(country.model_copy(update={"index": str(path)}), tmp_path, SECOND_TOWN)


def test_tiles_cover_a_box_without_gaps() -> None:
    box = (54.58, 5.23, 54.61, 5.26)
    boxes = [box_of_tile(tile) for tile in tiles_in(box)]
    assert len(boxes) == 4
    assert min(each[0] for each in boxes) <= box[0]
    assert max(each[3] for each in boxes) >= box[3]


KILLED = """
import os, sys
from plannerforge.engine.maps.extracts.indexing import index_extract
from plannerforge.schemas.generation import IndexExtractRequest
def report(share, message):
    if message.startswith(sys.argv[3]):
        seen.append(message)
        if len(seen) == int(sys.argv[4]):
            os.kill(os.getpid(), 9)
seen = []
index_extract(IndexExtractRequest(path=sys.argv[1], folder=sys.argv[2], map_id="map_country"), report)
"""


@pytest.mark.parametrize(("stage", "times"), [("reading", 1), ("packing", 4), ("looking", 1)])
def test_killed_work_continues_to_the_same_index(
    stage: str, times: int, country: IndexedExtract, folder: Path, tmp_path: Path
) -> None:
    path = folder / "Country.osm.pbf"
    killed = subprocess.run([sys.executable, "-c", KILLED, str(path), str(tmp_path), stage, str(times)], check=False)
    assert killed.returncode == -9
    again = indexed(path, tmp_path)
    assert again.facts == country.facts
    assert content_of(again.index) == content_of(country.index)
    assert sorted(each.name for each in tmp_path.iterdir()) == ["extract.sqlite"]


def content_of(index: str) -> dict[str, list[object]]:
    tables = ("state", "tiles", "places", "place_names", "road_names", "sites", "sited")
    with sqlite3.connect(index) as database:
        return {table: sorted(database.execute(f"SELECT * FROM {table}")) for table in tables}


@pytest.mark.parametrize(
    ("schema", "limit"),
    [
        ("STAGING_SCHEMA", "staging.max_page_count = 3"),
        ("STAGING_SCHEMA", "staging.max_page_count = 6"),
        ("SCHEMA", "max_page_count = 12"),
        ("SCHEMA", "max_page_count = 16"),
    ],
)
def test_a_full_disk_is_reported_and_work_continues_with_room(
    schema: str, limit: str, country: IndexedExtract, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(tiles, schema, f"{getattr(tiles, schema)} PRAGMA {limit};")
        with pytest.raises(ResourceFailure, match=r"extract\.sqlite .* is full"):
            indexed(folder / "Country.osm.pbf", tmp_path)
    again = indexed(folder / "Country.osm.pbf", tmp_path)
    assert content_of(again.index) == content_of(country.index)


LITTLE_ROOM = """
import resource, sys
from plannerforge.engine.maps.extracts.indexing import index_extract
from plannerforge.schemas.errors import PlannerForgeError
from plannerforge.schemas.generation import IndexExtractRequest
resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, 1_000_000))
try:
    index_extract(IndexExtractRequest(path=sys.argv[1], folder=sys.argv[2], map_id="map_country"), lambda *_: None)
except PlannerForgeError as error:
    print(error.text)
"""


def test_a_lack_of_room_for_positions_is_not_a_fault_of_the_file(folder: Path, tmp_path: Path) -> None:
    path = folder / "Country.osm.pbf"
    told = subprocess.run(
        [sys.executable, "-c", LITTLE_ROOM, str(path), str(tmp_path)], check=True, capture_output=True, text=True
    ).stdout
    assert told.startswith("[resource_failure] the positions of the nodes of Country.osm.pbf could not be written")
    assert not (tmp_path / "positions").exists()


def without_its_beginning(index: Path) -> None:
    index.write_bytes(b"no index" * 100)


def with_pages_of_noise(index: Path) -> None:
    content = bytearray(index.read_bytes())
    content[4096:] = b"\x55" * (len(content) - 4096)
    index.write_bytes(content)


def with_other_bytes_in_the_tiles(index: Path) -> None:
    with closing(sqlite3.connect(index)) as database, database:
        for tile, body in database.execute("SELECT tile, body FROM tiles").fetchall():
            middle = len(body) // 2
            changed = body[:middle] + bytes([body[middle] ^ 255]) + body[middle + 1 :]
            database.execute("UPDATE tiles SET body = ? WHERE tile = ?", (changed, tile))


@pytest.mark.parametrize(
    "damage", [Path.unlink, without_its_beginning, with_pages_of_noise, with_other_bytes_in_the_tiles]
)
def test_a_damaged_index_is_reported_and_rebuilt(
    damage: Callable[[Path], None], country: IndexedExtract, folder: Path, tmp_path: Path
) -> None:
    held = indexed(folder / "Country.osm.pbf", tmp_path)
    damage(Path(held.index))
    with pytest.raises(ResourceFailure, match=r"extract\.sqlite") as told:
        cut(held, tmp_path, SECOND_TOWN)
    assert "add the extract again" in told.value.next_step
    again = indexed(folder / "Country.osm.pbf", tmp_path)
    assert content_of(again.index) == content_of(country.index)
    assert cut(again, tmp_path, SECOND_TOWN).facts is not None


def test_a_complete_index_is_not_rebuilt(folder: Path, tmp_path: Path) -> None:
    held = indexed(folder / "Country.osm.pbf", tmp_path)
    told: list[str] = []
    request = IndexExtractRequest(path=str(folder / "gone.osm.pbf"), folder=str(tmp_path), map_id="map_country")
    again = index_extract(request, lambda share, message: told.append(message))
    assert told == []
    assert again.facts.sites == held.facts.sites


@pytest.mark.parametrize(("content", "name"), [("Country.osm.pbf", "c.osm"), ("country.osm", "c.osm.pbf")])
def test_an_extract_under_the_name_of_another_format_is_refused(
    content: str, name: str, folder: Path, whole: OsmMap, country: IndexedExtract, tmp_path: Path
) -> None:
    path = tmp_path / name
    path.write_bytes((folder / content).read_bytes())
    with pytest.raises(UnsafeInput, match=name):
        indexed(path, tmp_path / "index") if name.endswith(".pbf") else read_map_file(path)


@pytest.mark.skipif(not Path("/proc/self/smaps").exists(), reason="the system does not list what is mapped")
def test_released_pages_stay_in_the_file(tmp_path: Path) -> None:
    path = tmp_path / "positions"
    path.write_bytes(bytes(4_000_000))
    with path.open("r+b") as file, closing(mmap.mmap(file.fileno(), 0)) as mapped:
        mapped[:] = b"\x07" * 4_000_000
        assert resident_kb(path) > 3_900
        indexing.give_pages_back(path)
        assert resident_kb(path) == 0
        assert mapped[:] == b"\x07" * 4_000_000


def resident_kb(path: Path) -> int:
    """Of a mapped file, what is in this process's memory."""
    _, _, rest = Path("/proc/self/smaps").read_text().partition(str(path))
    return int(rest.partition("Rss:")[2].split()[0])


def test_positions_are_found_again_after_their_pages_were_released(
    country: IndexedExtract, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(indexing, "REPORTED_EVERY", 7)
    again = indexed(folder / "Country.osm.pbf", tmp_path)
    assert content_of(again.index) == content_of(country.index)


def refusal(path: Path, folder: Path) -> str:
    with pytest.raises(UnsafeInput) as refused:
        indexed(path, folder)
    return refused.value.text


def test_a_file_that_is_cut_in_the_middle_is_refused_at_any_point(folder: Path, tmp_path: Path) -> None:
    content = (folder / "Country.osm.pbf").read_bytes()
    for share in (0.02, 0.3, 0.6, 0.99):
        path = tmp_path / "half.osm.pbf"
        path.write_bytes(content[: int(len(content) * share)])
        assert "half.osm.pbf cannot be read" in refusal(path, tmp_path / f"index{share}")


def test_ways_before_their_nodes_are_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "wild.osm.pbf", elements()[::-1])
    assert "wild.osm.pbf is not in order" in refusal(path, tmp_path / "index")


def test_an_id_twice_is_refused(tmp_path: Path) -> None:
    found = elements()
    path = written(tmp_path / "twice.osm.pbf", [*found[:-1], found[-1], found[-1]])
    assert "or contains it twice" in refusal(path, tmp_path / "index")


def test_a_history_is_refused(tmp_path: Path) -> None:
    with osmium.SimpleWriter(osmium.io.File(str(tmp_path / "old.osm.pbf"), "osh.pbf")) as writer:
        for element in elements():
            writer.add(element)
    assert "history" in refusal(tmp_path / "old.osm.pbf", tmp_path / "index")


def test_a_country_without_roads_is_refused(tmp_path: Path) -> None:
    nodes = [element for element in elements() if isinstance(element, mutable.Node)]
    assert "has no road" in refusal(written(tmp_path / "sea.osm.pbf", nodes), tmp_path / "index")


def test_the_largest_ids_and_nodes_that_are_missing_are_read(tmp_path: Path) -> None:
    huge = 2**62
    more = [
        mutable.Way(id=huge, nodes=[1, 2, huge + 1], tags={"highway": "residential", "name": "Far Way"}),
        mutable.Way(id=huge + 5, nodes=[huge + 1, huge + 2], tags={"highway": "residential"}),
    ]
    found = [element for element in elements() if element.id < IDS_APART]
    nodes, others = ([e for e in found if isinstance(e, mutable.Node) is wanted] for wanted in (True, False))
    ways = [element for element in others if isinstance(element, mutable.Way)]
    country = indexed(written(tmp_path / "far.osm.pbf", [*nodes, *ways, *more]), tmp_path / "index")
    part = cut(country, tmp_path, "Far Way")
    assert part.facts is not None
    read = read_map_file(Path(part.path))
    assert {way.node_ids for way in read.ways if way.way_id >= huge} == {(1, 2)}
