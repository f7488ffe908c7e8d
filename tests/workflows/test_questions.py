"""Questions to the person at the client: asked where there is a choice, never needed, in both protocol eras."""

from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from mcp import Client
from mcp.types import ElicitRequestParams, ElicitResult
from support.builders import town_road
from support.server import Connect, both_eras

from plannerforge.server.settings import Settings
from plannerforge.workflows import runs

pytestmark = [pytest.mark.anyio, both_eras]
ONE = "ZAM_Builder-1_1_T-1"
SLOWER = {"op": "set_speed", "vehicles": ["one:car"], "speed": "5m/s"}
Opened = Callable[[str | None], AbstractAsyncContextManager[tuple[Client, list[str]]]]


@pytest.fixture
def opened(connect: Connect, settings: Settings, tmp_path: Path) -> Opened:
    """A client with a scenario whose person answers so, or that has nobody to ask; and what was asked."""
    town_road().cut(61).write(tmp_path / "one.xml")

    @asynccontextmanager
    async def session(answer: str | None) -> AsyncIterator[tuple[Client, list[str]]]:
        asked: list[str] = []

        async def choose(context: Any, parameters: ElicitRequestParams) -> ElicitResult:
            asked.append(parameters.message)
            if answer == "decline":
                return ElicitResult(action="decline")
            return ElicitResult(action="accept", content={"choice": answer})

        options = {} if answer is None else {"elicitation_callback": choose}
        async with connect(settings.model_copy(update={"starter": False}), **options) as client:
            assert not (await client.call_tool("import_files", {"path": "one.xml"})).is_error
            yield client, asked

    return session


async def test_the_user_chooses_one_of_several_vehicles_and_the_choice_is_reported(opened: Opened) -> None:
    async with opened("32 (car)") as (client, asked):
        edited = await client.call_tool("modify_scenario", {"scenario_id": ONE, "edits": [SLOWER]})
        named = {**SLOWER, "vehicles": ["32"]}
        again = await client.call_tool("modify_scenario", {"scenario_id": ONE, "edits": [named]})
    assert len(asked) == 1
    assert "does 'one:car' mean" in asked[0]
    assert edited.structured_content is not None
    assert again.structured_content is not None
    assert "means vehicle 32, as chosen" in str(edited.content[0].text)
    assert edited.structured_content["scenario_id"] == again.structured_content["scenario_id"]
    assert again.structured_content["reused"]


@pytest.mark.parametrize("answer", [None, "decline", "nonsense"])
async def test_an_ambiguous_vehicle_is_refused_with_all_matches_if_the_user_does_not_choose(
    opened: Opened, answer: str | None
) -> None:
    async with opened(answer) as (client, _):
        refused = await client.call_tool("modify_scenario", {"scenario_id": ONE, "edits": [SLOWER]})
    assert refused.is_error
    assert "there are 3 cars. Valid: 31 (car), 32 (car), 35 (car)" in str(refused.content[0].text)


@pytest.mark.parametrize(
    ("answer", "questions", "made"), [(None, 0, 2), ("go on", 1, 2), ("decline", 1, 2), ("do not", 1, 0)]
)
async def test_very_many_runs_need_the_user_s_consent_unless_refused(
    opened: Opened, monkeypatch: pytest.MonkeyPatch, answer: str | None, questions: int, made: int
) -> None:
    monkeypatch.setattr(runs, "MANY_RUNS", 1)
    arguments = {"scenarios": [ONE], "configs": ["idm", "idm:Sporty"], "wait_s": 50}
    async with opened(answer) as (client, asked):
        answered = await client.call_tool("run_planner", arguments)
        again = None if answered.is_error else await client.call_tool("run_planner", arguments)
    assert len(asked) == questions
    if made == 0:
        assert "declined 2 runs" in str(answered.content[0].text)
        return
    assert answered.structured_content is not None
    assert answered.structured_content["finished"] == made
    assert again is not None
    assert not again.is_error, "what is stored is not asked about again"
