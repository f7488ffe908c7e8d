"""Services on this machine answer as the real ones do: the judge of everything that fetches maps."""

import json
import urllib.error
import urllib.parse
import urllib.request
from pathlib import Path
from typing import Any

import pytest
from lxml import etree
from support.online import HERE, drawn_town, town_servers

from benchmarks.maps.earth import STAND_INS, earth_for
from benchmarks.maps.extracts import QueryError, run_query
from benchmarks.maps.loopback import Fault, words_of

BOX = f"{HERE[0] - 0.1},{HERE[1] - 0.1},{HERE[0] + 0.1},{HERE[1] + 0.1}"


def ask(url: str, **parameters: str) -> tuple[int, str]:
    data = urllib.parse.urlencode(parameters).encode() if "data" in parameters else None
    query = "" if data else f"?{urllib.parse.urlencode(parameters)}"
    try:
        with urllib.request.urlopen(url + query, data) as response:
            return response.status, response.read().decode()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read().decode()


def keys(text: str) -> set[tuple[str, int]]:
    town = drawn_town("quadratstadt.osm")
    return {(one["type"], one["id"]) for one in run_query(text, town).elements}


def test_filters_choose_by_tag_value_pattern_and_box() -> None:
    roads = keys(f'[out:json];way["highway"]({BOX});out;')
    assert len(roads) == 10
    named = keys(f'[out:json];way["name"="Marktstraße"]({BOX});out;')
    assert named < roads
    assert keys(f'[out:json];way["name"~"^markt",i]({BOX});out;') == named
    assert keys(f'[out:json];way["highway"]["name"!~"^Markt"]({BOX});out;') == roads - named
    assert keys('[out:json];way["highway"](10,10,11,11);out;') == set()


def test_sets_members_and_unions_follow_each_other() -> None:
    text = f'[out:json];(way["name"="Marktstraße"]({BOX});)->.a;node(w.a);out skel;'
    assert {kind for kind, _ in keys(text)} == {"node"}
    assert keys(f'[out:json];way["name"="Marktstraße"]({BOX});(._;>;);out;') > keys(text)
    assert keys(f'[out:json];(way["highway"]({BOX});)->.a;.a out 3;'.replace(".a out", "(.a;);out")) != set()


def test_the_middle_of_a_way_and_a_limit_on_elements() -> None:
    town = drawn_town("quadratstadt.osm")
    (one,) = run_query(f'[out:json];way["highway"]({BOX});out tags center 1;', town).elements
    assert set(one) == {"type", "id", "center", "tags"}
    assert town.box[0] <= one["center"]["lat"] <= town.box[2]


@pytest.mark.parametrize("text", ["[out:json];way[highway;out;", "frobnicate;", '[out:json];way["a"](1,2,3);out;'])
def test_an_invalid_query_is_refused(text: str) -> None:
    with pytest.raises(QueryError):
        run_query(text, drawn_town("quadratstadt.osm"))


def test_overpass_speaks_json_xml_status_and_errors() -> None:
    with town_servers().running() as servers:
        url = servers.mirrors[0]
        status, body = ask(f"{url}/interpreter", data=f'[out:json];way["junction"]({BOX});out;')
        assert status == 200
        assert json.loads(body)["osm3s"]["timestamp_osm_base"]
        _, body = ask(f"{url}/interpreter", data=f'way["junction"]({BOX});(._;>;);out;')
        root = etree.fromstring(body.encode())
        assert root.find("meta") is not None
        assert {child.tag for child in root} == {"meta", "node", "way"}
        status, body = ask(f"{url}/interpreter", data="nonsense")
        assert status == 400
        assert "parse error" in body
        assert "slots available now" in ask(f"{url}/status")[1].split("\n")[4]
        servers.fail("one", Fault("no_slot", wait_s=30))
        assert ask(f"{url}/status")[1].split("\n")[4].startswith("Slot available after: ")
        assert "pid" in ask(f"{url}/kill_my_queries")[1]


def test_nominatim_finds_only_the_named_places() -> None:
    with town_servers().running() as servers:

        def names(words: str, **more: str) -> list[str]:
            return [one["name"] for one in json.loads(ask(f"{servers.nominatim}/search", q=words, **more)[1])]

        assert names("Ringstadt") == ["Ringstadt"]
        assert "Nordring" in names("nordring, ringstadt, germany")
        assert names("Ringstadt", countrycodes="fr") == []
        assert names("Gotham City") == []
        (one,) = json.loads(ask(f"{servers.nominatim}/search", q="Ringstadt")[1])
        (same,) = json.loads(ask(f"{servers.nominatim}/lookup", osm_ids=f"R{one['osm_id']}")[1])
        assert {**same, "place_id": 0} == {**one, "place_id": 0}


def test_words_are_compared_without_accents_and_abbreviations() -> None:
    assert words_of("N 88th St.") == words_of("North 88th Street")
    assert words_of("Korçë") == ("korce",)


def test_a_stand_in_is_at_its_place_and_has_the_requested_name(shared_data: Path, tmp_path: Path) -> None:
    lines: list[dict[str, Any]] = [
        json.loads(line)
        for line in (shared_data / "corpora" / "dev" / "generation.jsonl").read_text(encoding="utf-8").splitlines()
    ]
    real = [line for line in lines if line["expect"] == "ok" and line["map"] is None]
    assert {line["id"] for line in real} == set(STAND_INS)
    one = [line for line in lines if line["id"] == "gen-d056"]
    earth = earth_for(one, shared_data / "data" / "osm", tmp_path)
    south, west, north, east = earth.regions["gen-d056"].extract.box
    assert south < 53.571 < north
    assert west < 9.929 < east
    assert {place.names.get("ref") for place in earth.places} >= {"A 7"}
    assert not any(place.names.get("name") == "Bautzen" for place in earth.places)
