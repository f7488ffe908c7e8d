"""``plannerforge ui``: pages that show what the tools answer, to this machine alone, and run no text as a script."""

import json
import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from html import unescape
from pathlib import Path

import httpx
import pytest
from support.http_serving import PATIENCE_S, Served, served

from plannerforge.server.http.pages.application import Pages
from plannerforge.server.http.pages.content import Content, Facts
from plannerforge.server.observing.journal import JOURNAL
from plannerforge.server.settings import Settings

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("starter_ready", "warm_workers")]
PNG = b"\x89PNG\r\n"


@asynccontextmanager
async def shown(settings: Settings, folder: Path) -> AsyncIterator[tuple[httpx.AsyncClient, Served]]:
    async with (
        served(settings, folder, Pages(settings.workspace / JOURNAL)) as server,
        httpx.AsyncClient(base_url=server.address, timeout=PATIENCE_S) as browser,
    ):
        yield browser, server


def links(page: httpx.Response, pattern: str) -> list[str]:
    return re.findall(rf'(?:href|src)="({pattern})"', unescape(page.text))


async def test_catalogue_leads_to_pictures_and_scenarios_in_motion(settings: Settings, tmp_path: Path) -> None:
    async with shown(settings, tmp_path) as (browser, _):
        first = await browser.get("/", follow_redirects=True)
        trucks = await browser.get("/ui", params={"obstacles": "truck>=2, car"})
        picture = await browser.get(links(trucks, "/ui/picture/.+?")[0])
        scenario = await browser.get(links(trucks, "/ui/scenario/.+?")[0])
        player = await browser.get(links(scenario, "/ui/view/.+?")[0])
    assert first.status_code == trucks.status_code == scenario.status_code == player.status_code == 200
    assert 0 < len(links(trucks, "/ui/scenario/.+?")) < len(links(first, "/ui/scenario/.+?"))
    assert (picture.headers["content-type"], picture.content[:6]) == ("image/png", PNG)
    assert "Ego:" in scenario.text
    assert "Vehicles" in scenario.text
    assert "script-src 'sha256-" in player.text
    assert player.headers["content-security-policy"] == "frame-ancestors 'self'"


async def test_an_invalid_condition_is_reported_with_the_whole_catalogue(settings: Settings, tmp_path: Path) -> None:
    async with shown(settings, tmp_path) as (browser, _):
        whole = await browser.get("/ui")
        page = await browser.get("/ui", params={"obstacles": "trukk"})
    assert "trukk" in page.text
    assert "[unknown_name]" in page.text
    assert len(links(page, "/ui/scenario/.+?")) == len(links(whole, "/ui/scenario/.+?"))


async def test_pages_of_the_catalogue_lead_on_with_the_same_conditions(settings: Settings, tmp_path: Path) -> None:
    async with shown(settings, tmp_path) as (browser, _):
        first = await browser.get("/ui", params={"obstacles": "car"})
        (onward,) = links(first, r"/ui\?.+?")
        second = await browser.get(onward)
    ids = [set(links(page, "/ui/scenario/.+?")) for page in (first, second)]
    assert ids[0] & ids[1] == set()
    assert "obstacles=car" in onward
    assert ids[1]


async def test_batch_shows_its_board_analysis_and_comparison(settings: Settings, tmp_path: Path) -> None:
    async with shown(settings, tmp_path) as (browser, server):
        async with server.client("auto") as client:
            found = await client.call_tool("find_scenarios", {"limit": 1})
            assert found.structured_content is not None
            scenario = found.structured_content["matches"][0]["scenario_id"]
            asked = {"scenarios": [scenario], "configs": ["idm", "idm:Cautious"], "wait_s": 50}
            ran = await client.call_tool("run_planner", asked)
            assert ran.structured_content is not None
            batch, run = ran.structured_content["batch_id"], ran.structured_content["runs"][0]["run_id"]
        listed = await browser.get("/ui/batches")
        page = await browser.get(f"/ui/batch/{batch}")
        board = await browser.get(f"/ui/view/batch/{batch}")
        alone = await browser.get(f"/ui/run/{run}")
        against = await browser.get("/ui/comparison", params={"of": [batch, batch]})
        journal = await browser.get("/ui/journal")
    assert links(listed, rf"/ui/batch/{batch}")
    assert "2 runs (2 valid" in page.text
    assert "idm:Cautious compared with the baseline idm:Default" in page.text
    assert board.status_code == 200
    assert scenario in board.text
    assert links(alone, rf"/ui/view/run/{run}")
    assert batch in against.text
    assert "plannerforge-ui" in journal.text
    assert "run_planner" in journal.text


@pytest.mark.parametrize(
    "path", ["scenario/none", "picture/none.png", "view/scenario/none", "view/picture/none", "batch/batch_0"]
)
async def test_a_missing_page_has_status_404(settings: Settings, tmp_path: Path, path: str) -> None:
    async with shown(settings, tmp_path) as (browser, _):
        page = await browser.get(f"/ui/{path}")
    assert page.status_code == 404
    assert "This page cannot be shown" in page.text


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Host": "evil.example"}, 400),
        ({"Sec-Fetch-Site": "cross-site"}, 403),
        ({"Sec-Fetch-Site": "same-origin"}, 200),
    ],
)
async def test_only_this_machine_s_own_pages_are_answered(
    settings: Settings, tmp_path: Path, headers: dict[str, str], status: int
) -> None:
    async with shown(settings, tmp_path) as (browser, _):
        page = await browser.get("/ui", headers=headers)
        changed = await browser.post("/ui", headers=headers)
    assert page.status_code == status
    assert changed.status_code in (400, 405)


async def test_text_of_callers_stays_text(settings: Settings, tmp_path: Path) -> None:
    hostile = "<script>alert(1)</script>"
    async with shown(settings, tmp_path) as (browser, server):
        async with server.client("auto") as client:
            await client.call_tool("find_scenarios", {"text": hostile, "obstacles": [hostile]})
        pages = [
            await browser.get("/ui", params={"text": hostile, "obstacles": hostile}),
            await browser.get("/ui/comparison", params={"of": [hostile, hostile]}),
            await browser.get(f"/ui/run/{hostile.replace('/', '')}"),
            await browser.get("/ui/journal", params={"failed": "yes"}),
        ]
    assert [hostile[:7] in page.text for page in pages] == [False] * 4
    assert "&lt;script&gt;" in pages[3].text
    assert all("script-src" not in page.headers["content-security-policy"] for page in pages)
    assert all(page.headers["content-security-policy"].startswith("default-src 'none'") for page in pages)


def line(**changes: object) -> str:
    entry = {"time": "2026-11-24T13:00:00Z", "client": "c", "tool": "t", "arguments": {}, "duration_s": 0.1}
    return json.dumps({**entry, "result_ids": [], "error": "", **changes})


def test_journal_is_read_from_its_end_and_a_half_written_line_left_out(tmp_path: Path) -> None:
    path = tmp_path / "calls.jsonl"
    content = Content(None, path)  # type: ignore[arg-type]
    assert content.calls() == []
    path.write_text("\n".join([line(tool="old"), line(tool="bad", error="[refused]"), line(tool="new"), '{"time": "2']))
    assert [call.tool for call in content.calls()] == ["new", "bad", "old"]
    assert [call.tool for call in content.calls(failed_only=True)] == ["bad"]


def test_lists_of_the_form_are_written_with_commas() -> None:
    facts = Facts(obstacles=" truck , car>=3,", ego_speed=" 50km/h ", offset=24)
    asked = facts.arguments()
    assert asked["obstacles"] == ["truck", "car>=3"]
    assert asked["ego_speed"] == "50km/h"
    assert (asked["offset"], "text" in asked) == (24, False)
