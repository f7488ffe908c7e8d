"""``make bench-serve``: its parts, the slope that it tells, and the real server with what the official suite calls."""

from pathlib import Path
from typing import Any

import pytest
from mcp import Client
from support.server import both_eras
from support.tree import CHECKOUT

from benchmarks.serve.__main__ import PARTS, broken
from benchmarks.serve.conformance import KNOWN, judged
from benchmarks.serve.conformance_server import add_fixtures
from benchmarks.serve.http_kills import lost_of
from benchmarks.serve.http_load import ReportedArtifact, settled, slope_per_h
from plannerforge.engine.workspace import Recipe, Workspace
from plannerforge.schemas.base import Model
from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings


class Note(Model):
    text: str


def test_every_part_is_there_and_chosen_by_its_keys() -> None:
    assert [part for part in PARTS.keys if PARTS.find(part) is None] == []
    assert PARTS.chosen(["http_ms"]) == ("latency",)
    assert PARTS.chosen(["conformance", "http_errors"]) == ("http_load", "conformance")


def suite_said(held: int, broken: int = 0, empty: str = "server-sse-polling") -> str:
    return f"✓ tools-list: {held} passed, {broken} failed\n✓ {empty}: 0 passed, 0 failed\n"


@pytest.mark.parametrize(
    ("changed", "failed", "told"),
    [
        ({}, 0, ""),
        ({"broken": 2}, 2, "tools-list: 2 checks do not hold"),
        ({"held": 3}, 192, "192 checks of 195 were not made"),
        ({"held": 200}, 0, ""),
        ({"empty": "a-new-one"}, 1, "a-new-one: no check was made: the reason is not known"),
    ],
)
def test_missing_checks_count_as_failed(changed: dict[str, Any], failed: int, told: str) -> None:
    said = {key: suite_said(held) for key, held in KNOWN.items()}
    said["conformance_2026"] = suite_said(**{"held": KNOWN["conformance_2026"], **changed})
    figures, words = judged(said)
    assert figures["conformance_failed"] == failed
    assert told in "\n".join(words)
    assert broken(figures) == ([f"conformance_failed is {failed}"] if failed else [])


def test_known_counts_match_the_pages() -> None:
    counts = list(map(str, KNOWN.values()))
    figures = (CHECKOUT / "benchmarks" / "FIGURES.md").read_text(encoding="utf-8")
    assert f"| {', '.join(counts)} checks pass, 0 fail |" in figures
    assert all(f"| {count} | 0 |" in (CHECKOUT / "docs" / "http.md").read_text(encoding="utf-8") for count in counts)


def test_the_slope_of_memory_leaves_out_the_warm_up() -> None:
    rising = [(float(second), 100.0 + second / 36.0) for second in range(0, 600, 2)]
    filling = [(second, 20.0 if second < 150 else 200.0) for second, _ in rising]
    assert slope_per_h(rising) == pytest.approx(100.0)
    assert slope_per_h(filling) == 0.0
    assert settled(rising)[0][0] >= 598 / 3
    assert slope_per_h(rising[:1]) is None


def test_results_reported_to_clients_and_missing_now_are_lost(tmp_path: Path) -> None:
    workspace = Workspace(tmp_path)
    recipe = Recipe(tool="configure_planner", arguments={})
    kept = workspace.put("config", "cfg_1", recipe=recipe, record=Note(text="kept"), files={})
    workspace.close()
    told = {
        ReportedArtifact("config", kept.artifact_id),
        ReportedArtifact("config", "cfg_2"),
        ReportedArtifact("batch", "cfg_1"),
    }
    assert lost_of(tmp_path, told) == ["batch cfg_1 is gone", "config cfg_2 is gone"]


@pytest.mark.anyio
@both_eras
@pytest.mark.usefixtures("warm_workers")
async def test_fixtures_of_the_suite_are_added_to_the_servers_own(settings: Settings, era: str, tmp_path: Path) -> None:
    server = create_server(settings, start_folder=tmp_path)
    add_fixtures(server)
    async with Client(server, mode=era) as client:  # type: ignore[arg-type]
        tools = {tool.name for tool in (await client.list_tools()).tools}
        said = await client.call_tool("test_simple_text", {})
        own = await client.call_tool("list_artifacts", {})
        prompts = {prompt.name for prompt in (await client.list_prompts()).prompts}
        (resource,) = (await client.read_resource("test://static-text")).contents
    assert {"test_simple_text", "run_planner"} <= tools
    assert {"test_simple_prompt", "generation"} <= prompts
    assert said.content[0].text == "This is a simple text response for testing."  # type: ignore[union-attr]
    assert own.structured_content == {"artifacts": [], "more": False}
    assert "static text resource" in resource.text  # type: ignore[union-attr]
