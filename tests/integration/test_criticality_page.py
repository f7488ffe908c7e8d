"""The page on criticality tells what its calls do: each is made, and the figures below it are those of the answer."""

import json
import re
import shlex
from pathlib import Path
from typing import Any

import pytest
from mcp import Client
from support.server import Connect

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("starter_ready")]

CHECKOUT = Path(__file__).resolve().parents[2]
PAGE = (CHECKOUT / "docs" / "criticality.md").read_text(encoding="utf-8")
RECIPE = re.compile(r"^## (.+?)\n.*?```sh\n(.+?)```\n```text\n(.+?)\n```", re.DOTALL | re.MULTILINE)
SCENARIO = "ZAM_Neuland-25_1_T-1"


async def answer(client: Client, tool: str, arguments: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    result = await client.call_tool(tool, arguments)
    text = str(result.content[0].text)  # type: ignore[union-attr]
    assert not result.is_error, text
    return text, result.structured_content or {}


async def test_every_recipe_has_the_documented_result(connect: Connect) -> None:
    recipes = RECIPE.findall(PAGE)
    assert len(recipes) == PAGE.count("\n## ")
    async with connect() as client:
        for title, command, figures in recipes:
            program, verb, tool, arguments = shlex.split(command)
            assert (program, verb) == ("plannerforge", "call")
            text, found = await answer(client, tool, json.loads(arguments))
            assert figures in text.splitlines(), title
            assert found["ego_after"]["risk_score"] < found["ego_before"]["risk_score"], title


OTHER_VALUES: dict[str, tuple[dict[str, Any], int]] = {
    "harder braking": ({"op": "set_speed", "vehicles": ["lead"], "speed": "15m/s", "time_s": 2}, 0),
    "a shift alone": ({"op": "shift_time", "vehicles": ["follow"], "time_s": -1.7}, 0),
    "aggressive alone": ({"op": "set_behaviour", "vehicles": ["follow"], "preset": "aggressive"}, 4),
    "cautious drivers": ({"op": "set_behaviour", "vehicles": ["all"], "preset": "cautious"}, 0),
    "a recorded car cuts in": ({"op": "change_lane", "vehicles": ["50"], "lane": "left"}, 0),
    "a usual driver ahead": (
        {"op": "add_vehicle", "vehicle_class": "car", "at": "ego", "offset_m": 20, "speed": "26m/s"},
        0,
    ),
}
"""What the page says of values beside its recipes: the edit, and the risk score that it leads to."""


async def test_documented_values_next_to_the_recipes_are_right(connect: Connect) -> None:
    scores = {}
    async with connect() as client:
        for name, (edit, _) in OTHER_VALUES.items():
            asked = {"scenario_id": SCENARIO, "edits": [edit], "dry_run": True}
            _, found = await answer(client, "modify_scenario", asked)
            scores[name] = found["ego_after"]["risk_score"]
    assert scores == {name: score for name, (_, score) in OTHER_VALUES.items()}
