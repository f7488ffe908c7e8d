"""A refusal carries the call that mends it, in its text and for programs; that call exists, differs and is harmless."""

import json
import logging
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
from mcp import Client
from support.builders import town_road

from plannerforge.schemas.errors import InvalidRequest, NotPossible, UnexpectedFailure, with_values
from plannerforge.schemas.modification import ModifyScenarioResult
from plannerforge.server.arguments import proposals
from plannerforge.server.arguments.checking import read_arguments
from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings
from plannerforge.tools.registry import TOOLS, ToolSpec
from plannerforge.workflows import modification

pytestmark = pytest.mark.anyio
KEY = "plannerforge/next_call"
SCENARIO = "ZAM_Builder-1_1_T-1"
SLOWER = {"op": "set_speed", "vehicles": ["31"], "speed": "5m/s"}


@pytest.fixture
async def client(warm_workers: None, settings: Settings, tmp_path: Path) -> AsyncIterator[Client]:
    (tmp_path / "roots").mkdir()
    town_road().cut(41).write(tmp_path / "roots" / "town.xml")
    own = settings.model_copy(update={"starter": False, "roots": (tmp_path / "roots",)})
    async with Client(create_server(own, start_folder=tmp_path / "roots")) as opened:
        assert not (await opened.call_tool("import_files", {"path": "town.xml"})).is_error
        yield opened


async def refused(client: Client, tool: str, arguments: dict[str, Any]) -> tuple[str, dict[str, Any] | None]:
    result = await client.call_tool(tool, arguments)
    assert result.is_error, result
    call = (result.meta or {}).get(KEY)
    assert call is None or call != {"tool": tool, "arguments": arguments}
    return str(result.content[0].text), call  # type: ignore[union-attr]


async def test_the_call_in_the_metadata_is_the_one_in_the_text_and_is_answered(client: Client) -> None:
    text, call = await refused(client, "find_scenarios", {"road_net": ["stopp"]})
    assert call == {"tool": "find_scenarios", "arguments": {"road_net": ["stop"]}}
    assert f"Next: call again with {json.dumps(call['arguments'])}" in text
    assert not (await client.call_tool(call["tool"], call["arguments"])).is_error


@pytest.mark.parametrize(
    ("tool", "arguments"),
    [
        ("describe_scenario", {"scenario_id": "unlike"}),
        ("describe_scenario", {"scenario_id": "unlike", "detail": "vehicles"}),
        ("modify_scenario", {"scenario_id": "unlike", "edits": [SLOWER]}),
        ("modify_scenario", {"scenario_id": "unlike#1", "edits": []}),
    ],
)
async def test_an_unknown_scenario_leads_to_a_list_of_existing_ones(
    client: Client, tool: str, arguments: dict[str, Any]
) -> None:
    _, call = await refused(client, tool, arguments)
    assert call == {"tool": "list_artifacts", "arguments": {"kind": "scenario"}}


async def test_an_existing_scenario_is_kept_in_the_call(client: Client) -> None:
    _, call = await refused(client, "modify_scenario", {"scenario_id": SCENARIO, "edits": []})
    assert call == {"tool": "describe_scenario", "arguments": {"scenario_id": SCENARIO, "detail": "vehicles"}}


@pytest.mark.parametrize("arguments", [{}, {"job_id": "latest", "force": True}, {"jbo_id": "latest"}])
async def test_a_cancellation_is_never_proposed(client: Client, arguments: dict[str, Any]) -> None:
    _, call = await refused(client, "cancel_job", arguments)
    assert call == {"tool": "list_artifacts", "arguments": {"kind": "job"}}


@pytest.mark.parametrize(
    ("tool", "arguments", "expected"),
    [
        ("import_files", {"path": "twn.xml"}, {"path": "town.xml"}),
        ("generate_scenarios", {"vehicles": ["tank=2", "bus=1"]}, {"vehicles": ["bus=1"]}),
        ("generate_scenarios", {"vehicles": ["trukc=2"]}, {"vehicles": ["truck=2"]}),
        (
            "export_artifacts",
            {"ids": [SCENARIO], "folder": "/etc"},
            {"ids": [SCENARIO], "folder": "plannerforge-export"},
        ),
    ],
)
async def test_useless_calls_are_not_proposed(
    client: Client, tool: str, arguments: dict[str, Any], expected: dict[str, Any] | None
) -> None:
    _, call = await refused(client, tool, arguments)
    assert call == (None if expected is None else {"tool": tool, "arguments": expected})


def weather(params: str) -> dict[str, Any]:
    return {"scenario_id": SCENARIO, "edits": [{"op": "set_weather", "params": [params]}]}


@pytest.mark.parametrize(
    ("tool", "arguments", "mended"),
    [
        ("modify_scenario", weather("weather=rainn"), weather("weather=rain")),
        ("modify_scenario", weather("friction=7"), weather("friction=1")),
        ("generate_scenarios", {"conditions": ["weather=rainn"]}, {"conditions": ["weather=rain"]}),
        ("list_artifacts", {"offset": 99, "limit": 1}, {"offset": 0, "limit": 1}),
        ("describe_catalog", {"facet": "maps", "offset": 99}, {"facet": "maps", "offset": 0}),
        ("describe_catalog", {"facet": "tags", "offset": 99}, {"facet": "tags"}),
        ("find_scenarios", {"offset": 9}, {"offset": 0}),
    ],
)
async def test_a_wrong_word_or_number_leads_to_the_nearest_valid_one(
    client: Client, tool: str, arguments: dict[str, Any], mended: dict[str, Any]
) -> None:
    _, call = await refused(client, tool, arguments)
    assert call == {"tool": tool, "arguments": mended}


@pytest.mark.parametrize(
    ("tool", "arguments"),
    [
        ("modify_scenario", weather("weather=zzz")),
        ("modify_scenario", weather("friction=nan")),
        ("modify_scenario", {"scenario_id": SCENARIO, "edits": [SLOWER | {"speed": "nan"}]}),
        (
            "modify_scenario",
            {"scenario_id": SCENARIO, "edits": [{"op": "set_behaviour", "vehicles": ["31"], "preset": "wild"}]},
        ),
        ("generate_scenarios", {"conditions": ["weather=zzz"]}),
    ],
)
async def test_no_other_list_is_proposed_if_the_refusal_names_all_valid_values(
    client: Client, tool: str, arguments: dict[str, Any]
) -> None:
    text, call = await refused(client, tool, arguments)
    assert call is None
    assert "Valid: " in text


async def test_names_outside_the_roots_are_not_listed(client: Client, tmp_path: Path) -> None:
    (tmp_path / "rootz").mkdir()
    (tmp_path / "roots").rename(tmp_path / "moved")
    text, _ = await refused(client, "import_files", {"path": "."})
    assert "rootz" not in text
    assert "moved" not in text


async def test_a_folder_that_cannot_be_listed_names_no_files(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: Path) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "iterdir", refuse)
    text, call = await refused(client, "import_files", {"path": "twn.xml"})
    assert text.startswith("[invalid_request] 'twn.xml' does not exist")
    assert call == {"tool": "describe_catalog", "arguments": {}}


async def test_a_defect_while_a_proposal_is_tried_is_logged_and_the_refusal_returned(
    client: Client, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    tried = []

    async def edit(arguments: Any, _call: Any) -> Any:
        if not arguments.dry_run:
            raise InvalidRequest("too fast", remedies=[with_values(seed=seed) for seed in (1, 2)])
        tried.append(arguments.seed)
        raise UnexpectedFailure("an edit", "the details")

    monkeypatch.setattr(modification, "modified_once", edit)
    with caplog.at_level(logging.ERROR):
        text, _ = await refused(client, "modify_scenario", {"scenario_id": SCENARIO, "edits": [SLOWER]})
    assert text.startswith("[invalid_request] too fast")
    assert tried == [1, 2]
    assert caplog.text.count("the details") == len(tried)


async def test_proposals_that_take_too_long_are_not_made(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    async def edit(arguments: Any, call: Any) -> Any:
        if not arguments.dry_run:
            raise InvalidRequest("too fast", remedies=[with_values(seed=1)])
        pytest.fail("the time was over before")

    monkeypatch.setattr(modification, "modified_once", edit)
    monkeypatch.setattr(proposals, "TRYING_S", 0.0)
    text, call = await refused(client, "modify_scenario", {"scenario_id": SCENARIO, "edits": [SLOWER]})
    assert text.startswith("[invalid_request] too fast")
    assert call is not None
    assert call["tool"] == "describe_scenario"


async def test_a_corrected_name_is_proposed_even_if_there_is_no_time_to_try_it(
    client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(proposals, "TRYING_S", 0.0)
    edit = {"op": "set_behaviour", "vehicles": ["31"], "params": ["siggma=0.5"]}
    _, call = await refused(client, "modify_scenario", {"scenario_id": SCENARIO, "edits": [edit]})
    assert call is not None
    assert call["arguments"]["edits"][0]["params"] == ["sigma=0.5"]


async def test_a_chosen_vehicle_is_in_the_proposed_call(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    async def chosen(_refusal: Any, arguments: Any, _call: Any) -> Any:
        edits = [edit.model_copy(update={"vehicles": ["32"]}) for edit in arguments.edits]
        return None if arguments.edits[0].vehicles == ["32"] else arguments.model_copy(update={"edits": edits})

    async def edit(arguments: Any, _call: Any) -> Any:
        if arguments.dry_run:
            assert arguments.edits[0].vehicles == ["32"]
            return ModifyScenarioResult.model_construct(scenario_id=None, base_id=SCENARIO)
        raise NotPossible("too fast", remedies=[with_values(speed="4m/s").at(("edits", 0))])

    monkeypatch.setattr(modification, "modified_once", edit)
    monkeypatch.setattr(modification, "with_chosen_vehicle", chosen)
    unclear = {"op": "set_speed", "vehicles": ["one:car"], "speed": "5m/s"}
    _, call = await refused(client, "modify_scenario", {"scenario_id": SCENARIO, "edits": [unclear]})
    assert call is not None
    assert call["arguments"]["edits"] == [{"op": "set_speed", "vehicles": ["32"], "speed": "4m/s"}]


async def test_a_proposal_that_is_refused_for_another_reason_is_mended_once_more(client: Client) -> None:
    edit = {"op": "rerroute", "vehicles": ["31"], "turn": "straight", "speed": "5m/s"}
    _, call = await refused(client, "modify_scenario", {"scenario_id": SCENARIO, "edits": [edit]})
    assert call is not None
    assert call["tool"] == "modify_scenario"
    (mended,) = call["arguments"]["edits"]
    assert mended["op"] == "reroute"
    assert "speed" not in mended
    assert not (await client.call_tool(call["tool"], call["arguments"] | {"dry_run": True})).is_error


async def test_a_file_outside_the_roots_is_proposed_inside_them(client: Client, tmp_path: Path) -> None:
    _, call = await refused(client, "import_files", {"path": "/rotos/town.xml"})
    assert call == {"tool": "import_files", "arguments": {"path": str(tmp_path / "roots" / "town.xml")}}


async def test_a_trial_does_not_move_latest(client: Client) -> None:
    before = await client.call_tool("describe_scenario", {"scenario_id": "latest"})
    await refused(client, "describe_scenario", {"scenario_id": SCENARIO, "detail": "lanelts"})
    after = await client.call_tool("describe_scenario", {"scenario_id": "latest"})
    assert before.structured_content == after.structured_content


@pytest.mark.parametrize(
    ("tool", "arguments", "expected"),
    [
        ("find_scenarios", {"ego_speed": "fast", "tags": ["urban"]}, {"tags": ["urban"]}),
        ("find_scenarios", {"obstacles": ["car=many"]}, {"obstacles": ["car"]}),
        ("find_scenarios", {"within": "search_0123456789ab", "tags": ["urban"]}, {"tags": ["urban"]}),
        ("configure_planner", {"weights": ["jerk:0.5"]}, {"weights": ["jerk=0.5"]}),
        ("generate_scenarios", {"vehicles": ["car=-3"]}, {"vehicles": ["car=3"]}),
        ("generate_scenarios", {"cover": ["density=low|extreme"]}, {"cover": ["density=low"]}),
    ],
)
async def test_computable_values_are_corrected(
    client: Client, tool: str, arguments: dict[str, Any], expected: dict[str, Any]
) -> None:
    _, call = await refused(client, tool, arguments)
    assert call == {"tool": tool, "arguments": expected}


@pytest.mark.parametrize(
    ("arguments", "proposed"),
    [
        (
            {"place": "Musterstadt", "scenario_type": "roundabout", "vehicles": ["unicorn=1"]},
            {"place": "Musterstadt", "scenario_type": "signalised_intersection"},
        ),
        ({"place": "Musterstadt", "count": 100_000}, {"place": "Musterstadt", "count": 50}),
        ({"place": "Musterstat", "scenario_type": "roundabaout"}, None),
    ],
    ids=["type", "count", "place_without_the_type"],
)
async def test_a_call_that_generates_is_proposed_only_if_the_maps_allow_it(
    client: Client, arguments: dict[str, Any], proposed: dict[str, Any] | None
) -> None:
    _, call = await refused(client, "generate_scenarios", arguments)
    if proposed is not None:
        assert call == {"tool": "generate_scenarios", "arguments": proposed}
    else:
        assert call is None or call["arguments"].get("scenario_type") != "roundabout"


@pytest.mark.parametrize("spec", TOOLS, ids=[spec.name for spec in TOOLS])
def test_every_required_argument_has_an_example_or_a_usual_value_that_is_valid(spec: ToolSpec) -> None:
    shown = {**spec.arguments_type.examples, **spec.arguments_type.usual_values}
    required = {name for name, field in spec.arguments_type.model_fields.items() if field.is_required()}
    assert required <= shown.keys()
    assert read_arguments(spec.arguments_type, {name: shown[name] for name in required})
