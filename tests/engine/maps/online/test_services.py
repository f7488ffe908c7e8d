"""Requests to map services: what goes wrong is told by name, the next service is asked, no other host ever."""

import inspect
import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from support.online import services_of, town_servers

from benchmarks.maps.loopback import Fault, FaultKind, Mirror
from plannerforge.engine.execution import silent
from plannerforge.engine.maps.online import services
from plannerforge.engine.maps.online.answers import AnswerCache, KeptAnswer
from plannerforge.engine.maps.online.messages import read_findings
from plannerforge.engine.maps.online.services import ServiceClient
from plannerforge.schemas.errors import NotPossible, ServiceFailure

ROADS = '[out:json][timeout:5];(way["highway"](47.9,10.9,48.1,11.1););out tags center 100;'
NOWHERE = '[out:json][timeout:5];(way["highway"](1.0,1.0,1.1,1.1););out tags center 100;'


@pytest.mark.parametrize(
    ("kind", "told"),
    [
        ("429", "asks to wait (429): “Error Error : rate_limited"),
        ("504", "is too busy (504)"),
        ("403", "refuses (403)"),
        ("cut", "broke off in the middle of its answer"),
        ("html", "answered with a page instead of data: “OSM3S Response Error : runtime error"),
        ("garbage", "other than the requested JSON"),
        ("remark", "gave up: “runtime error: Query timed out"),
        ("redirect", "redirects to “127.0.0.2:9”, which is not followed"),
        ("no_slot", "has no slot free for"),
    ],
)
def test_the_next_service_answers_and_the_trouble_is_reported(kind: FaultKind, told: str, tmp_path: Path) -> None:
    with town_servers().running() as servers:
        servers.fail("one", Fault(kind, 2, wait_s=60 if kind == "no_slot" else 0))
        answered = ServiceClient(services_of(servers, tmp_path), silent).query(ROADS)
        assert len(answered.answer["elements"]) == 7
        assert len(answered.troubles) == 1
        assert told in answered.troubles[0]
        servers.fail("one", Fault(kind, 2, wait_s=60 if kind == "no_slot" else 0))
        servers.fail("two", Fault("504", 2, wait_s=0))
        with pytest.raises(ServiceFailure, match="Overpass cannot be used") as caught:
            ServiceClient(services_of(servers, tmp_path / "other"), silent).query(ROADS)
        assert told in caught.value.message
        assert "too busy" in caught.value.message
        assert list((tmp_path / "other").glob("*.json.gz")) == []


NODE = '{"type": "node", "id": 1, "lat": 48.0, "lon": 11.0}'


@pytest.mark.parametrize(
    "elements",
    [
        '"none"',
        "[null]",
        "[5]",
        '[{"type": "way", "id": 5, "tags": {"highway": "residential"}, "nodes": ["a"]}]',
        '[{"type": "node", "id": 1e400, "lat": 48.0, "lon": 11.0}]',
        '[{"type": "node", "id": 1, "lat": NaN, "lon": Infinity}]',
        '[{"type": "node", "id": 1, "lat": 91, "lon": 11.0}]',
        '[{"type": "node", "id": -99999999999999999999999, "lat": 48.0, "lon": 11.0}]',
        '[{"type": "way", "id": 5, "tags": 5}]',
        '[{"type": "way", "id": 5, "tags": {"highway": null}}]',
        '[{"type": "way", "id": 5, "tags": {"name": "%s"}}]' % ("B" * 100_000),
        '[{"type": "relation", "id": 1, "members": [{"type": "way"}]}]',
        '[{"type": "planet", "id": 1}]',
        '[{"tags": {}}]',
        f'[{NODE}], "osm3s": 3',
        f'[{NODE}], "osm3s": {{"timestamp_osm_base": "{"x" * 300}"}}',
        "[" * 200_000,
        "9" * 5_000,
    ],
)
def test_an_answer_in_another_form_is_not_cached_and_the_next_service_is_queried(elements: str, tmp_path: Path) -> None:
    forged = Fault("forged", 2, body=f'{{"elements": {elements}}}'.encode())
    with town_servers().running() as servers:
        servers.fail("one", forged)
        client = ServiceClient(services_of(servers, tmp_path), silent)
        answered = client.query(ROADS)
        assert len(answered.answer["elements"]) == 7
        assert len(answered.troubles) == 1
        assert len(answered.troubles[0]) < 300
        assert client.query(ROADS) == replace(answered, kept=True, troubles=())


@pytest.mark.parametrize(
    "changed",
    [
        {"lat": "nan"},
        {"boundingbox": ["nan", "inf", "1e308", "-1e308"]},
        {"boundingbox": [1, 2]},
        {"display_name": {"a": 1}},
        {"address": ["town"]},
        {"importance": 1e999},
        {"geojson": 3},
        {"namedetails": {"name": None}},
    ],
)
def test_a_finding_in_another_form_is_an_error_of_the_service_that_is_not_kept(
    changed: dict[str, Any], tmp_path: Path
) -> None:
    finding = {"lat": "48.0", "lon": "11.0", "boundingbox": ["47.9", "48.1", "10.9", "11.1"], "display_name": "A"}
    assert read_findings([finding])[0]["lat"] == 48.0
    with town_servers().running() as servers:
        servers.fail("nominatim", Fault("forged", 2, body=json.dumps([finding | changed]).encode()))
        with pytest.raises(ServiceFailure):
            ServiceClient(services_of(servers, tmp_path), silent).search({"q": "A"})
    assert list(tmp_path.glob("*.json.gz")) == []


def test_a_cached_answer_in_another_form_is_removed_and_the_service_is_queried(tmp_path: Path) -> None:
    with town_servers().running() as servers:
        here = services_of(servers, tmp_path)
        AnswerCache(tmp_path, 10, 10.0).keep(KeptAnswer(f"overpass {ROADS}", "one", time.time(), {"elements": [None]}))
        answered = ServiceClient(here, silent).query(ROADS)
        assert (answered.kept, len(answered.answer["elements"])) == (False, 7)


def test_a_service_is_queried_again_when_it_allows_it(tmp_path: Path) -> None:
    with town_servers().running() as servers:
        servers.fail("one", Fault("429", 1, wait_s=1))
        answered = ServiceClient(services_of(servers, tmp_path), silent).query(ROADS)
        first, second = servers.asked("one", "/interpreter")
        assert second.at - first.at >= 1.0
        assert answered.troubles == ()
        assert servers.asked("two") == []


def test_a_service_that_wants_an_hour_is_left_for_the_next(tmp_path: Path) -> None:
    with town_servers().running() as servers:
        servers.fail("one", Fault("429", 1, wait_s=3600))
        answered = ServiceClient(services_of(servers, tmp_path), silent).query(ROADS)
        assert len(servers.asked("one", "/interpreter")) == 1
        assert "429" in answered.troubles[0]


@pytest.mark.parametrize("kind", ["slow", "drip"])
def test_a_service_that_needs_too_long_is_abandoned(kind: FaultKind, tmp_path: Path) -> None:
    with town_servers().running() as servers:
        servers.fail("one", Fault(kind))
        answered = ServiceClient(services_of(servers, tmp_path, timeout_s=1.0), silent).query(ROADS)
        assert answered.answer["elements"]
        assert "in time" in answered.troubles[0] or "too slowly" in answered.troubles[0]


def test_an_answer_that_is_too_long_is_not_read_and_not_requested_elsewhere(tmp_path: Path) -> None:
    with town_servers().running() as servers:
        servers.fail("one", Fault("huge"))
        with pytest.raises(NotPossible, match="60 MB"):
            ServiceClient(services_of(servers, tmp_path), silent).query(ROADS)
        assert servers.asked("two") == []


def test_an_empty_answer_counts_if_a_second_service_confirms_it(tmp_path: Path) -> None:
    with town_servers(mirrors=(Mirror("one"), Mirror("two"), Mirror("three"))).running() as servers:
        answered = ServiceClient(services_of(servers, tmp_path), silent).query(NOWHERE)
        assert answered.answer["elements"] == []
        assert len(servers.asked("two", "/interpreter")) == 1
        assert servers.asked("three") == []
        servers.fail("one", Fault("empty"))
        answered = ServiceClient(services_of(servers, tmp_path), silent).query(ROADS)
        assert len(answered.answer["elements"]) == 7
        assert "has nothing there" in answered.troubles[0]


def test_an_empty_answer_is_kept_for_an_hour_and_offline_for_ever(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with town_servers().running() as servers:
        here = services_of(servers, tmp_path)
        assert ServiceClient(here, silent).query(NOWHERE).answer["elements"] == []
        again = ServiceClient(here, silent).query(NOWHERE)
        assert (again.kept, again.answer["elements"]) == (True, [])
        now = time.time()
        monkeypatch.setattr(time, "time", lambda: now + 3_700.0)
        assert not ServiceClient(here, silent).query(NOWHERE).kept
        offline = here.model_copy(update={"mode": "cache"})
        monkeypatch.setattr(time, "time", lambda: now + 1e9)
        assert ServiceClient(offline, silent).query(NOWHERE).kept


def test_one_service_s_answer_stays_if_another_differs(tmp_path: Path) -> None:
    mirrors = (Mirror("one"), Mirror("two", data_time="2019-01-01T00:00:00Z", lacks=("name", "Nordring")))
    with town_servers(mirrors=mirrors).running() as servers:
        servers.fail("one", Fault("403"))
        first = ServiceClient(services_of(servers, tmp_path), silent).query(ROADS)
        second = ServiceClient(services_of(servers, tmp_path), silent).query(ROADS)
        assert first.answer["osm3s"]["timestamp_osm_base"] == "2019-01-01T00:00:00Z"
        assert (second.answer, second.kept) == (first.answer, True)


def test_a_kept_answer_needs_no_service_and_no_permission(tmp_path: Path) -> None:
    with town_servers().running() as servers:
        asked = ServiceClient(services_of(servers, tmp_path), silent).query(ROADS)
        here = services_of(servers, tmp_path)
    for mode in ("online", "cache"):
        kept = ServiceClient(here.model_copy(update={"mode": mode}), silent).query(ROADS)
        assert (kept.answer, kept.kept, kept.service) == (asked.answer, True, asked.service)
    with pytest.raises(NotPossible, match="maps_online is cache, so it is not asked"):
        ServiceClient(here.model_copy(update={"mode": "cache"}), silent).query(NOWHERE)


def test_an_old_answer_is_used_if_no_service_is_available(tmp_path: Path) -> None:
    with town_servers().running() as servers:
        ServiceClient(services_of(servers, tmp_path), silent).query(ROADS)
        here = services_of(servers, tmp_path, cache_days=1e-9)
    answered = ServiceClient(here, silent).query(ROADS)
    assert answered.kept
    assert "old cached answer" in answered.troubles[-1]


def test_without_a_net_the_refusal_is_immediate(tmp_path: Path) -> None:
    with town_servers().running() as servers:
        here = services_of(servers, tmp_path)
    began = time.monotonic()
    with pytest.raises(ServiceFailure, match="cannot be reached"):
        ServiceClient(here, silent).query(ROADS)
    assert time.monotonic() - began < 2 * len(here.overpass_urls) * services.CONNECT_S + 2 * services.FIRST_PAUSE_S


def test_requests_name_the_program_and_keep_their_distance(tmp_path: Path) -> None:
    with town_servers().running() as servers:
        client = ServiceClient(services_of(servers, tmp_path, delay_s=0.6), silent)
        client.query(ROADS)
        client.query(ROADS.replace("100;", "50;"))
        first, second = servers.asked("one", "/interpreter")
        assert {request.user_agent for request in servers.requests} == {"PlannerForge tests"}
        assert second.at - first.at >= 0.5


def test_osmnx_is_left_as_it_was(tmp_path: Path) -> None:
    import socket

    from osmnx import settings

    before = {name: getattr(settings, name) for name in dir(settings) if not name.startswith("_")}
    lookup = socket.getaddrinfo
    with town_servers().running() as servers:
        ServiceClient(services_of(servers, tmp_path), silent).query(ROADS)
    assert {name: getattr(settings, name) for name in before} == before
    assert socket.getaddrinfo is lookup


def test_osmnx_has_the_functions_that_are_called() -> None:
    from osmnx import _nominatim, _overpass

    pause = inspect.signature(_overpass._get_overpass_pause).parameters
    assert {"base_endpoint", "default_pause"} <= set(pause)
    assert list(inspect.signature(_overpass._overpass_request).parameters) == ["data"]
    assert next(iter(inspect.signature(_nominatim._nominatim_request).parameters)) == "params"
