"""Many scenarios to a plan: all combinations that can be, what cannot be with its reason, and what goes on."""

import json
import sqlite3
import threading
import time
from collections.abc import Callable
from itertools import combinations, product
from pathlib import Path
from typing import Any

import anyio
import pytest
from mcp import Client
from support.server import Connect, StdioServer

from plannerforge.engine.traffic import vehicles_per_lane_km
from plannerforge.server.settings import Settings

COVER = ["scenario_type=intersection|ramp", "duration_s=7|8", "turn=left|merge"]
WISH: dict[str, Any] = {"cover": COVER, "density": "low"}


@pytest.fixture
def bare(settings: Settings) -> Settings:
    return settings.model_copy(update={"starter": False})


async def told(client: Client, tool: str, **arguments: Any) -> tuple[str, dict[str, Any]]:
    result = await client.call_tool(tool, arguments)
    text = str(result.content[0].text)  # type: ignore[union-attr]
    assert not result.is_error, text
    return text, result.structured_content or {}


async def ended(client: Client, **arguments: Any) -> tuple[str, dict[str, Any]]:
    """The answer of a plan whose job has ended."""
    while True:
        text, answer = await told(client, "generate_scenarios", **arguments)
        if answer["state"] != "running":
            return text, answer


def pairs_asked(workspace: Path) -> set[tuple[str, str]]:
    """The pairs of what the stored scenarios were asked for, read from the database."""
    with sqlite3.connect(workspace / "workspace.sqlite") as connection:
        rows = connection.execute("SELECT recipe FROM artifacts WHERE kind = 'scenario'").fetchall()
    asked = [json.loads(row[0])["arguments"] for row in rows]
    return {pair for one in asked for pair in combinations((one["scenario_type"], one["duration_s"], one["goal"]), 2)}


@pytest.mark.anyio
async def test_a_plan_makes_every_pair_that_can_be_and_names_the_others(connect: Connect, bare: Settings) -> None:
    async with connect(bare) as client:
        text, answer = await ended(client, **WISH)
        plan = answer["plan"]
        types, durations, turns = ("intersection", "ramp"), (7, 8), ("through:left", "through:merge")
        impossible = {("ramp", "through:left"), ("intersection", "through:merge")}
        pairs = {*product(types, durations), *product(types, turns), *product(durations, turns)} - impossible
        assert pairs_asked(bare.workspace) == pairs
        assert (plan["allowed"], plan["covered"], plan["left_total"]) == (len(pairs), len(pairs), 0)
        assert {one["combination"] for one in plan["cannot"]} == {
            "scenario_type=ramp + turn=left",
            "scenario_type=intersection + turn=merge",
        }
        assert "100.0% of the 2-way combinations" in text
        assert "cannot make that turn at ramp sites" in text
        assert len(text.splitlines()) <= 12
        made = plan["made"]

        again = (await ended(client, **WISH))[1]["plan"]
        assert again == plan
        text, listed = await told(client, "list_artifacts", parent=plan["plan_id"], limit=50)
        assert {one["kind"] for one in listed["artifacts"]} == {"scenario"}
        assert len(listed["artifacts"]) == made
        more = (await ended(client, **WISH, count=made + 1))[1]["plan"]
        assert (more["plan_id"], more["made"], more["asked"]) == (plan["plan_id"], made + 1, made + 1)
        assert len((await told(client, "list_artifacts", parent=plan["plan_id"], limit=50))[1]["artifacts"]) == made + 1
        found = (await told(client, "find_scenarios", within=plan["plan_id"], limit=50))[1]
        assert found["total"] == made + 1


@pytest.mark.anyio
async def test_scenarios_in_the_workspace_are_counted_and_not_generated_again(connect: Connect, bare: Settings) -> None:
    async with connect(bare) as client:
        shared = {"place": "Fahrhausen", "duration_s": 8}
        wish = {"scenario_type": "intersection", "density": "low", "goal": "through:straight"}
        await told(client, "generate_scenarios", **shared, **wish, seed=5)
        await told(client, "generate_scenarios", place="Fahrhausen", scenario_type="urban", duration_s=6, density="low")
        cover = ["scenario_type=intersection", "density=low", "turn=straight|right"]
        plan = (await ended(client, **shared, cover=cover))[1]["plan"]
        assert (plan["covered"], plan["allowed"], plan["made"]) == (5, 5, 1)


@pytest.mark.anyio
async def test_scenarios_of_a_plan_have_the_density_of_the_hour(connect: Connect, bare: Settings) -> None:
    async with connect(bare) as client:
        shared = {"place": "Fahrhausen", "scenario_type": "intersection", "seed": 5, "conditions": ["time=rush_hour"]}
        cover = {"cover": ["turn=straight"], "count": 1}
        plan = (await ended(client, **shared, **cover))[1]["plan"]
        (made,) = (await told(client, "list_artifacts", parent=plan["plan_id"]))[1]["artifacts"]
        facts = (await told(client, "describe_scenario", scenario_id=made["artifact_id"], detail="recipe"))[1]
        assert facts["generation"]["density"]["target_per_lane_km"] == vehicles_per_lane_km(17)
        stated = (await ended(client, **shared, **cover, density="low"))[1]["plan"]
        assert stated["plan_id"] != plan["plan_id"]


@pytest.mark.anyio
async def test_a_class_without_roads_is_reported_as_impossible_after_three_tries(
    connect: Connect, bare: Settings
) -> None:
    async with connect(bare) as client:
        cover = ["scenario_type=ramp|rural", "vehicles=bicycle|cars"]
        _, answer = await ended(client, place="Neuland", duration_s=6, goal="steps:20", cover=cover)
        plan = answer["plan"]
        assert [one["combination"] for one in plan["cannot"]] == ["scenario_type=ramp + vehicles=bicycle"]
        assert "open to the vehicle class 'bicycle'; 3 tries" in plan["cannot"][0]["reason"]
        assert (plan["refused"], plan["covered"], plan["allowed"]) == (3, 3, 3)
        again = (await ended(client, place="Neuland", duration_s=6, goal="steps:20", cover=cover))[1]["plan"]
        assert again["refused"] == 3


@pytest.mark.anyio
@pytest.mark.parametrize(
    ("wish", "said"),
    [
        ({"count": 51}, "to 5,000 with cover"),
        ({"cover": ["colour=red|blue"]}, "scenario_type"),
        ({"cover": ["density=low|dense"]}, "medium"),
        ({"cover": ["density=low", "density=high"]}, "contains density twice"),
        ({"cover": ["vehicles=truck|bicicle"]}, "bicycle"),
        ({"cover": ["place=Musterstadt|Atlantis"]}, "Musterstadt"),
        ({"cover": ["density=low|high", "strength=3"]}, "strength=1"),
        ({"cover": ["strength=2"]}, "scenario_type"),
        ({"cover": ["turn=left|right"], "goal": "steps:50"}, "through"),
        ({"cover": ["density"], "trial_run": True}, "run_planner"),
        ({"cover": ["scenario_type=highway"], "place": "Landmoor"}, "rural"),
        ({"cover": ["density=low|high", "vehicles=truck|truck=301"]}, "at most 300"),
        ({"cover": ["duration_s=12|999"]}, "takes a number from 5 to 120, not 999"),
    ],
)
async def test_an_invalid_plan_is_refused_with_the_valid_values(
    connect: Connect, bare: Settings, wish: dict[str, Any], said: str
) -> None:
    async with connect(bare) as client:
        refused = await client.call_tool("generate_scenarios", wish)
        assert refused.is_error
        assert said in str(refused.content[0].text)  # type: ignore[union-attr]


@pytest.mark.anyio
async def test_a_plan_whose_combinations_are_all_impossible_says_so_the_same_way_each_time(
    connect: Connect, bare: Settings
) -> None:
    async with connect(bare) as client:
        cover = ["vehicles=bicycle", "density=low"]
        wish = {"place": "Neuland", "scenario_type": "ramp", "duration_s": 6, "goal": "steps:20", "cover": cover}
        for _ in range(2):
            text, answer = await ended(client, **wish, count=3)
            plan = answer["plan"]
            assert (plan["made"], plan["allowed"], plan["cannot_total"]) == (0, 0, 1)
            assert answer["notes"] == []
            assert "%" not in text.splitlines()[0]
            assert "run_planner" not in text
        _, job = await told(client, "get_job", job_id="latest")
        assert "run_planner" not in job["next_step"]


@pytest.mark.anyio
async def test_a_plan_without_sites_names_the_impossible_levels_and_the_types_that_remain(
    connect: Connect, bare: Settings
) -> None:
    async with connect(bare) as client:
        wish = {"scenario_type": "rural", "cover": ["density=low|high", "turn=left|right"]}
        refused = await client.call_tool("generate_scenarios", wish)
        text = str(refused.content[0].text)  # type: ignore[union-attr]
        assert refused.is_error
        assert text.count("[not_possible]") == text.count("Next:") == 1
        assert "turn=left" in text
        assert "turn=right" in text
        assert "scenario_type=intersection" in text
        assert "scenario_type=rural" not in text


def rows_ended(folder: Path) -> int:
    path = folder / "workspace" / "workspace.sqlite"
    if not path.is_file():
        return 0
    with sqlite3.connect(path) as connection:
        try:
            found = connection.execute(
                "SELECT count(*) FROM plan_rows WHERE state NOT IN ('waiting', 'held')"
            ).fetchone()
        except sqlite3.OperationalError:
            return 0
    return int(found[0])


def killed_when(folder: Path, wish: dict[str, Any], is_time: Callable[[int], bool]) -> None:
    """Ask a server of its own for a plan, and kill it without notice once so many rows have ended."""
    server = StdioServer(folder, ("--workers", "1"))

    def ask() -> None:
        try:
            server.call("generate_scenarios", **wish)
        except (AssertionError, OSError):  # it was killed meanwhile
            return

    asking = threading.Thread(target=ask)
    asking.start()
    while not is_time(rows_ended(folder)) and server.process.poll() is None:
        time.sleep(0.05)
    server.process.kill()
    asking.join()
    server.kill()


def carried_to_the_end(folder: Path, wish: dict[str, Any]) -> dict[str, Any]:
    server = StdioServer(folder, ("--workers", "2"))
    try:
        while True:
            answer: dict[str, Any] = server.call("generate_scenarios", **wish)
            if answer["state"] != "running":
                return answer
    finally:
        server.kill()


def stored(folder: Path) -> dict[str, bytes]:
    return {path.parent.name: path.read_bytes() for path in (folder / "workspace" / "scenarios").glob("*/scenario.xml")}


def test_a_plan_ends_unchanged_although_its_server_is_killed_twice(
    connect: Connect, bare: Settings, tmp_path: Path
) -> None:
    wish = {
        "cover": ["scenario_type=rural|ramp", "vehicles=bicycle|cars"],
        "place": "Neuland",
        "duration_s": 5,
        "goal": "steps:20",
        "count": 5,
    }
    disturbed, quiet = tmp_path / "disturbed", bare.workspace.parent
    disturbed.mkdir()
    killed_when(disturbed, wish, lambda count: count >= 1)
    first = rows_ended(disturbed)
    assert first < 7
    killed_when(disturbed, wish, lambda count: count > first)
    there = stored(disturbed)
    plan = carried_to_the_end(disturbed, wish)["plan"]

    async def at_once() -> dict[str, Any]:
        async with connect(bare) as client:
            return (await ended(client, **wish))[1]

    expected = anyio.run(at_once)["plan"]
    assert {**plan, "reused": 0} == {**expected, "reused": 0}
    assert (plan["made"], plan["waiting"]) == (5, 0)
    assert stored(disturbed) == stored(quiet)
    assert len(stored(quiet)) == 5
    assert there.items() <= stored(disturbed).items()
