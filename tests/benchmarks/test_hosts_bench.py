"""Clients of others: the scripted model's protocols, the story, and the judge of what the server wrote down."""

import ast
import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import ollama
import pytest
from mcp.types import ImageContent, ResourceLink, TextContent
from openai.types.chat import ChatCompletion, ChatCompletionChunk
from openai.types.responses import Response as OpenAIResponse
from openai.types.responses import ResponseStreamEvent
from pydantic import TypeAdapter
from support.server import Connect
from support.tree import CHECKOUT

from benchmarks.harness import LeftOut
from benchmarks.serve.hosts import running, wire
from benchmarks.serve.hosts.environments import Environments, quiet_variables
from benchmarks.serve.hosts.model import NAME, ScriptedModel, scripted_model
from benchmarks.serve.hosts.records import MARK, HostRecord, StoryRun, figures_of, table_of, write_page
from benchmarks.serve.hosts.roster import HOSTS, Host, chosen_hosts
from benchmarks.serve.hosts.story import (
    CLOSING,
    JournalledCall,
    ShownResult,
    StoredWork,
    faults_of,
    next_move,
    stored_work,
    summary_of,
)
from plannerforge.server.settings import Settings

BASE, EDITED = "ZAM_Town-1_1_T-1", "ZAM_Town-1_1_T-124230991"
RUNS = ("run_1704fabbb05b", "run_99f1aaba88d3")
ANSWERS = {
    "find_scenarios": f"2 of 2 scenarios match.\n- {BASE}: 15 cars\n- ZAM_Town-2_1_T-1: 2 cars",
    "describe_scenario": f"{BASE} (starter): 12 s\n- 23 bus: 9 m ahead\n- 24 car: 17 m ahead, same lane",
    "modify_scenario": f"{EDITED} (from {BASE}): 1 edit done.",
    "run_planner": "batch_dcf63b4baeb9: 2 of 2 runs finished.",
    "compare_results": "Safety-Conservative against Default: same outcome\n- more",
    "render": "picture: from above",
}
"""What a server answers that refuses nothing."""
TOOLS = [*ANSWERS, "get_job"]
PNG = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNkYPhfDwAChwGA60e6kgAAAABJRU5ErkJggg=="


def answer_to(tool: str, arguments: dict[str, Any]) -> str:
    """What the made-up server answers; wrong edits are refused."""
    if tool == "modify_scenario" and (arguments["scenario_id"] != BASE or arguments["edits"][0]["vehicles"] != ["24"]):
        return "[unknown_name] there is no such thing. Valid: others"
    return ANSWERS[tool]


def told_story(answers: Callable[[str, dict[str, Any]], str] = answer_to) -> tuple[list[ShownResult], str]:
    """All that a model is shown on the way, and its last message."""
    shown: list[ShownResult] = []
    while (move := next_move(shown)).tool:
        shown.append(ShownResult(move.tool, answers(move.tool, dict(move.arguments))))
    return shown, move.text


def test_the_story_takes_its_ids_from_answers() -> None:
    shown, last = told_story()
    assert [result.tool for result in shown] == [
        *("find_scenarios", "describe_scenario"),
        *["modify_scenario"] * 3,
        *("run_planner", "compare_results", "render"),
    ]
    assert last == f"{CLOSING}. Safety-Conservative against Default: same outcome"
    assert next_move(shown[:4]).arguments == {
        "scenario_id": BASE,
        "edits": [{"op": "set_behaviour", "vehicles": ["24"], "preset": "aggressive"}],
    }
    assert next_move(shown[:5]).arguments["scenarios"] == [EDITED]
    assert next_move(shown[:6]).arguments == {"results": ["batch_dcf63b4baeb9"]}


def test_the_story_reads_structured_answers_as_well() -> None:
    structures = {
        "find_scenarios": json.dumps({"matches": [{"scenario_id": BASE}]}),
        "describe_scenario": json.dumps(json.dumps({"vehicles": [{"vehicle_id": 24, "vehicle_class": "car"}]})),
        "modify_scenario": json.dumps({"scenario_id": EDITED, "base_id": BASE}),
        "run_planner": json.dumps({"batch_id": "batch_dcf63b4baeb9"}),
    }
    shown, last = told_story(lambda tool, arguments: structures.get(tool, ANSWERS[tool]))
    assert len(shown) == 8
    assert last.startswith(CLOSING)


def test_runs_that_become_a_job_are_waited_for() -> None:
    shown, _ = told_story()
    begun = [*shown[:5], ShownResult("run_planner", "job_dcf63b4baeb9: running, 0 of 2")]
    assert next_move(begun).arguments == {"job_id": "job_dcf63b4baeb9", "wait_s": 50}
    waited = [*begun, ShownResult("get_job", "job_dcf63b4baeb9 (batch): done.\nFinished: batch_dcf63b4baeb9")]
    assert next_move(waited).tool == "compare_results"
    assert next_move(waited).arguments == {"results": ["batch_dcf63b4baeb9"]}


def test_a_model_that_was_shown_no_id_says_so_and_ends() -> None:
    _, last = told_story(lambda tool, arguments: "nothing")
    assert last == "The answers that I was shown hold no id of a scenario: I cannot go on."


def test_a_client_s_display_is_distinguished_from_the_model_s_input() -> None:
    shown, _ = told_story()
    plain = summary_of(shown)
    assert (plain.answers, plain.pictures, plain.links, plain.refusals) == ("text", "not shown", False, True)
    whole = [
        replace(result, text=f'{result.text} {{"base_id": ""}} plannerforge://scenario/{EDITED}/xml')
        if result.tool == "modify_scenario"
        else replace(result, pictures=1)
        for result in shown
    ]
    all_of_it = summary_of(whole)
    assert (all_of_it.answers, all_of_it.pictures, all_of_it.links) == ("both", "shown", True)
    assert summary_of([ShownResult("render", f"data: {PNG}")]).pictures == "as text"
    assert summary_of([]).answers == "nothing"


# The protocols: a client of each, as small as can be, goes through the whole story


def chat_request(calls: list[tuple[str, dict[str, Any], str]]) -> dict[str, Any]:
    messages: list[dict[str, Any]] = [{"role": "user", "content": "please"}]
    for number, (tool, arguments, answer) in enumerate(calls):
        function = {"name": tool, "arguments": json.dumps(arguments)}
        call = {"id": f"c{number}", "type": "function", "function": function}
        messages.append({"role": "assistant", "content": None, "tool_calls": [call]})
        messages.append({"role": "tool", "tool_call_id": f"c{number}", "content": answer})
    if calls and calls[-1][0].endswith("render"):
        picture = {"type": "image_url", "image_url": {"url": f"data:image/png;base64,{PNG}"}}
        messages.append({"role": "user", "content": [picture]})
    tools = [{"type": "function", "function": {"name": f"mcp__plannerforge__{name}"}} for name in TOOLS]
    return {"model": NAME, "messages": messages, "tools": tools}


def chat_reply(body: dict[str, Any]) -> tuple[str, dict[str, Any], str]:
    message = ChatCompletion.model_validate(body, strict=True).choices[0].message
    for call in message.tool_calls or []:
        assert call.type == "function"
        return call.function.name, json.loads(call.function.arguments), ""
    return "", {}, message.content or ""


def chat_stream_reply(lines: list[str]) -> tuple[str, dict[str, Any], str]:
    assert lines[-1] == "data: [DONE]"
    name = arguments = text = ""
    for line in lines[:-1]:
        chunk = ChatCompletionChunk.model_validate_json(line.removeprefix("data: "), strict=True)
        for choice in chunk.choices:
            text += choice.delta.content or ""
            for call in choice.delta.tool_calls or []:
                assert call.function is not None
                name += call.function.name or ""
                arguments += call.function.arguments or ""
    return name, json.loads(arguments or "{}"), text


def responses_request(calls: list[tuple[str, dict[str, Any], str]]) -> dict[str, Any]:
    items: list[dict[str, Any]] = [{"role": "user", "content": "please"}]
    for number, (tool, arguments, answer) in enumerate(calls):
        call = {"type": "function_call", "call_id": f"c{number}", "name": tool, "arguments": json.dumps(arguments)}
        picture = {"type": "input_image", "image_url": f"data:image/png;base64,{PNG}"}
        output = [{"type": "input_text", "text": answer}, *([picture] if tool.endswith("render") else [])]
        items += [call, {"type": "function_call_output", "call_id": f"c{number}", "output": output}]
    inner = [{"type": "function", "name": name} for name in TOOLS]
    return {"model": NAME, "input": items, "tools": [{"type": "namespace", "name": "mcp__forge", "tools": inner}]}


def responses_reply(body: dict[str, Any]) -> tuple[str, dict[str, Any], str]:
    (item,) = OpenAIResponse.model_validate(body).output
    if item.type == "function_call":
        assert body["output"][0]["namespace"] == "mcp__forge"
        return item.name, json.loads(item.arguments), ""
    assert item.type == "message"
    return "", {}, "".join(part.text for part in item.content if part.type == "output_text")


def responses_stream_reply(lines: list[str]) -> tuple[str, dict[str, Any], str]:
    events = [json.loads(line.removeprefix("data: ")) for line in lines if line.startswith("data: ")]
    read: TypeAdapter[Any] = TypeAdapter(ResponseStreamEvent)
    assert [read.validate_python(event).sequence_number for event in events] == list(range(len(events)))
    pieces = "".join(event["delta"] for event in events if event["type"].endswith(".delta"))
    name, arguments, text = responses_reply(events[-1]["response"])
    assert pieces == (json.dumps(arguments) if name else text)
    return name, arguments, text


def messages_request(calls: list[tuple[str, dict[str, Any], str]]) -> dict[str, Any]:
    messages: list[dict[str, Any]] = [{"role": "user", "content": "please"}]
    for number, (tool, arguments, answer) in enumerate(calls):
        use = {"type": "tool_use", "id": f"c{number}", "name": tool, "input": arguments}
        source = {"type": "base64", "media_type": "image/png", "data": PNG}
        content = [{"type": "text", "text": answer}, *([{"type": "image", "source": source}] * tool.endswith("render"))]
        result = {"type": "tool_result", "tool_use_id": f"c{number}", "content": content}
        messages += [{"role": "assistant", "content": [use]}, {"role": "user", "content": [result]}]
    tools = [{"name": f"mcp__plannerforge__{name}", "input_schema": {}} for name in TOOLS]
    return {"model": NAME, "max_tokens": 100, "messages": messages, "tools": tools}


def messages_reply(body: dict[str, Any]) -> tuple[str, dict[str, Any], str]:
    (block,) = body["content"]
    assert body["stop_reason"] == ("tool_use" if block["type"] == "tool_use" else "end_turn")
    assert body["usage"].keys() >= {"input_tokens", "output_tokens"}
    return block.get("name", ""), block.get("input", {}), block.get("text", "")


def messages_stream_reply(lines: list[str]) -> tuple[str, dict[str, Any], str]:
    names = [line.removeprefix("event: ") for line in lines if line.startswith("event: ")]
    events = [json.loads(line.removeprefix("data: ")) for line in lines if line.startswith("data: ")]
    assert names == [event["type"] for event in events]
    assert [name for name in names if name != "content_block_delta"] == [
        *("message_start", "content_block_start"),
        *("content_block_stop", "message_delta", "message_stop"),
    ]
    block = events[1]["content_block"]
    pieces = [event["delta"] for event in events if event["type"] == "content_block_delta"]
    if block["type"] == "text":
        return "", {}, "".join(piece["text"] for piece in pieces)
    return block["name"], json.loads("".join(piece["partial_json"] for piece in pieces)), ""


def ollama_request(calls: list[tuple[str, dict[str, Any], str]]) -> dict[str, Any]:
    messages: list[dict[str, Any]] = [{"role": "user", "content": "please"}]
    for tool, arguments, answer in calls:
        call = {"function": {"name": tool, "arguments": arguments}}
        messages.append({"role": "assistant", "content": "", "tool_calls": [call]})
        picture = {"images": [PNG]} if tool.endswith("render") else {}
        messages.append({"role": "tool", "tool_name": tool, "content": answer, **picture})
    tools = [{"type": "function", "function": {"name": f"plannerforge.{name}"}} for name in TOOLS]
    return {"model": NAME, "messages": messages, "tools": tools}


def ollama_reply(body: dict[str, Any]) -> tuple[str, dict[str, Any], str]:
    message = ollama.ChatResponse.model_validate(body, strict=True).message
    for call in message.tool_calls or []:
        return call.function.name, dict(call.function.arguments), ""
    return "", {}, message.content or ""


def ollama_stream_reply(lines: list[str]) -> tuple[str, dict[str, Any], str]:
    parts = [ollama_reply(json.loads(line)) for line in lines]
    name, arguments, _ = next((part for part in parts if part[0]), ("", {}, ""))
    return name, arguments, "".join(text for _, _, text in parts)


def plain_request(calls: list[tuple[str, dict[str, Any], str]]) -> dict[str, Any]:
    shown = [
        {"tool": tool, "content": [{"type": "text", "text": answer}, *([{"type": "image"}] * (tool == "render"))]}
        for tool, _, answer in calls
    ]
    return {"tools": TOOLS, "shown": shown}


def plain_reply(body: dict[str, Any]) -> tuple[str, dict[str, Any], str]:
    return body["tool"], body["arguments"] or {}, body["text"]


PROTOCOLS: dict[str, tuple[str, Any, Any, Any]] = {
    "chat": ("/v1/chat/completions", chat_request, chat_reply, chat_stream_reply),
    "responses": ("/v1/responses", responses_request, responses_reply, responses_stream_reply),
    "messages": ("/v1/messages", messages_request, messages_reply, messages_stream_reply),
    "ollama": ("/api/chat", ollama_request, ollama_reply, ollama_stream_reply),
    "plain": ("/story", plain_request, plain_reply, None),
}


@pytest.fixture(scope="module")
def served() -> Iterator[ScriptedModel]:
    with scripted_model() as model:
        yield model


@pytest.mark.parametrize("streamed", [False, True], ids=["whole", "streamed"])
@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_every_protocol_tells_the_whole_story(served: ScriptedModel, protocol: str, streamed: bool) -> None:
    path, request, reply, stream_reply = PROTOCOLS[protocol]
    if streamed and stream_reply is None:
        pytest.skip("it is never streamed")
    served.shown = ()
    calls: list[tuple[str, dict[str, Any], str]] = []
    with httpx.Client(base_url=served.url, timeout=60.0) as client:
        for _ in range(9):
            answer = client.post(path, json={**request(calls), "stream": streamed})
            assert answer.status_code == 200
            lines = [line for line in answer.text.splitlines() if line]
            offered, arguments, text = stream_reply(lines) if streamed else reply(answer.json())
            if text:
                break
            tool = offered.replace(".", "__").rpartition("__")[2]
            calls.append((offered, arguments, answer_to(tool, arguments)))
    assert text.startswith(CLOSING)
    assert len(calls) == 8
    summary = summary_of(served.shown)
    assert (summary.answers, summary.pictures, summary.refusals) == ("text", "shown", True)


@pytest.mark.parametrize(
    ("path", "part"),
    [
        ("/v1/chat/completions", {"type": "image_url", "image_url": {"url": "plannerforge://picture/p.png"}}),
        ("/v1/chat/completions", {"type": "file", "url": "plannerforge://scenario/x/xml"}),
        ("/v1/messages", {"type": "image", "source": {"type": "url", "url": "plannerforge://picture/p.png"}}),
    ],
)
def test_an_address_that_no_service_could_fetch_is_refused(
    served: ScriptedModel, path: str, part: dict[str, Any]
) -> None:
    body = {"model": NAME, "messages": [{"role": "user", "content": [part]}], "tools": []}
    answer = httpx.post(f"{served.url}{path}", json=body)
    assert answer.status_code == 400
    assert "plannerforge://" in answer.json()["error"]["message"]


def test_a_request_without_the_servers_tools_gets_a_text(served: ScriptedModel) -> None:
    body = {"model": NAME, "messages": [{"role": "user", "content": "a title, please"}]}
    answer = httpx.post(f"{served.url}/v1/messages", json=body).json()
    assert answer["content"] == [{"type": "text", "text": "I am offered no tool find_scenarios."}]


def test_an_ollama_client_finds_the_model(served: ScriptedModel) -> None:
    with ollama.Client(served.url) as client:
        assert [model.model for model in client.list().models] == [NAME]
        assert "tools" in (client.show(NAME).capabilities or [])


# The judge: a whole story passes, and each thing that may be missing is told


def call_of(tool: str, *made: str, error: str = "", client: str = "workbench 7") -> JournalledCall:
    return JournalledCall(client, tool, made, error)


WHOLE = StoredWork(
    calls=(
        call_of("find_scenarios", BASE),
        call_of("describe_scenario", BASE),
        call_of("modify_scenario", error="no"),
        call_of("modify_scenario", error="no"),
        call_of("modify_scenario", EDITED, BASE),
        call_of("run_planner", *RUNS),
        call_of("compare_results", *RUNS),
        call_of("render", EDITED),
    ),
    bases={EDITED: BASE},
    runs={RUNS[0]: (EDITED, "cfg_1"), RUNS[1]: (EDITED, "cfg_2")},
    pictures=("picture_1.png",),
)


def without(tool: str) -> StoredWork:
    return replace(WHOLE, calls=tuple(call for call in WHOLE.calls if call.tool != tool))


def test_a_whole_story_has_no_fault() -> None:
    assert faults_of(WHOLE, f"│ {CLOSING.replace(' and', chr(10) + '  and')}. │", "workbench 7") == []


@pytest.mark.parametrize(
    ("work", "fault"),
    [
        (without("find_scenarios"), "not carried out: find_scenarios"),
        (without("render"), "not carried out: render"),
        (replace(WHOLE, calls=WHOLE.calls[::-1]), "not carried out in the order"),
        (without("modify_scenario"), "fewer than 2 wrong edits"),
        (replace(WHOLE, calls=WHOLE.calls[:4]), "nothing was carried out after the refusals"),
        (replace(WHOLE, bases={}), "no scenario that was found was modified"),
        (replace(WHOLE, bases={EDITED: "ZAM_Other-1_1_T-1"}), "no scenario that was found was modified"),
        (replace(WHOLE, runs={RUNS[0]: (EDITED, "cfg_1")}), "1 configurations ran"),
        (replace(WHOLE, runs=dict.fromkeys(RUNS, (EDITED, "cfg_1"))), "1 configurations ran"),
        (replace(WHOLE, runs={RUNS[0]: (BASE, "cfg_1"), RUNS[1]: (BASE, "cfg_2")}), "0 configurations ran"),
        (
            replace(WHOLE, calls=(*WHOLE.calls[:6], call_of("compare_results", RUNS[0]), WHOLE.calls[7])),
            "the comparison does not hold",
        ),
        (replace(WHOLE, pictures=()), "no file of a picture"),
        (replace(WHOLE, calls=()), "not carried out: find_scenarios, modify_scenario"),
    ],
)
def test_each_thing_that_is_missing_is_reported(work: StoredWork, fault: str) -> None:
    assert any(fault in told for told in faults_of(work, CLOSING))


def test_a_step_that_was_refused_was_not_carried_out() -> None:
    refused = tuple(replace(call, error="no") if call.tool == "render" else call for call in WHOLE.calls)
    assert faults_of(replace(WHOLE, calls=refused), CLOSING) == ["not carried out: render"]


@pytest.mark.parametrize(
    ("names", "own", "fault"),
    [
        (("unknown",) * 8, "", "the journal does not name the client"),
        (("workbench 7",) * 7 + ("other 1",), "", "the journal names several clients: other 1, workbench 7"),
        (("workbench 7",) * 8, "workbench 8", "the journal names workbench 7, and the client calls itself workbench 8"),
    ],
)
def test_a_journal_that_does_not_name_the_client_is_reported(names: tuple[str, ...], own: str, fault: str) -> None:
    calls = tuple(replace(call, client=name) for call, name in zip(WHOLE.calls, names, strict=True))
    assert faults_of(replace(WHOLE, calls=calls), CLOSING, own) == [fault]


def test_a_last_message_that_no_user_saw_is_reported() -> None:
    assert faults_of(WHOLE, "Working …") == ["the model's last message did not reach the user"]


def test_a_workspace_that_no_server_wrote_is_empty(tmp_path: Path) -> None:
    assert stored_work(tmp_path) == StoredWork((), {}, {}, ())


@pytest.mark.anyio
@pytest.mark.usefixtures("starter_ready")
async def test_the_real_server_carries_the_story_out(connect: Connect, settings: Settings) -> None:
    shown: list[ShownResult] = []
    async with connect() as client:
        while (move := next_move(shown)).tool:
            result = await client.call_tool(move.tool, dict(move.arguments))
            text = "\n".join(block.text for block in result.content if isinstance(block, TextContent))
            links = [str(block.uri) for block in result.content if isinstance(block, ResourceLink)]
            pictures = sum(isinstance(block, ImageContent) for block in result.content)
            shown.append(ShownResult(move.tool, "\n".join([text, *links]), pictures))
    work = stored_work(settings.workspace)
    assert faults_of(work, move.text, "mcp 0.1.0") == []
    assert faults_of(replace(work, runs={}), move.text) != []
    summary = summary_of(shown)
    assert (summary.answers, summary.pictures, summary.links, summary.refusals) == ("text", "shown", True, True)


# What stands between client and server


def test_lines_pass_in_both_directions_and_are_copied(tmp_path: Path) -> None:
    copy = tmp_path / "copy.txt"
    program = "import sys\nfor line in sys.stdin:\n    print(line.strip().upper(), flush=True)\nsys.exit(3)"
    command = [sys.executable, "-P", wire.__file__, str(copy), sys.executable, "-c", program]
    done = subprocess.run(command, input='{"a": 1}\nä\n', capture_output=True, text=True, check=False)
    assert (done.stdout, done.returncode) == ('{"A": 1}\nÄ\n', 3)
    assert sorted(copy.read_text(encoding="utf-8").splitlines()) == sorted(
        ['client {"a": 1}', "client ä", 'server {"A": 1}', "server Ä"]
    )


def test_revision_name_and_progress_are_read_of_both_eras(tmp_path: Path) -> None:
    named = {"name": "workbench", "version": "7"}
    earlier = [
        ("client", {"method": "initialize", "params": {"protocolVersion": "2026-07-28", "clientInfo": named}}),
        ("server", {"result": {"protocolVersion": "2025-11-25"}}),
        ("client", {"method": "tools/call", "params": {"name": "render"}}),
    ]
    meta = {"io.modelcontextprotocol/protocolVersion": "2026-07-28", "io.modelcontextprotocol/clientInfo": named}
    newer = [
        ("client", {"method": "tools/call", "params": {"_meta": {**meta, "progressToken": 1}}}),
        ("server", {"method": "notifications/progress", "params": {"progressToken": 1}}),
    ]
    for name, messages in (("earlier", earlier), ("newer", newer)):
        lines = [f"{sender} {json.dumps(message)}" for sender, message in messages]
        (tmp_path / name).write_text("\n".join([*lines, "server no json", "client [1]"]))
    assert wire.wire_facts(tmp_path / "earlier") == wire.WireFacts("2025-11-25", "workbench 7")
    assert wire.wire_facts(tmp_path / "newer") == wire.WireFacts("2026-07-28", "workbench 7", True, 1)
    assert wire.wire_facts(tmp_path / "none") == wire.WireFacts()


# The clients: environments, drivers, the table


def installer(folder: Path, program: str) -> str:
    """A made-up Node whose npm is this program of a shell."""
    node = folder / "node" / "bin" / "node"
    npm = folder / "node" / "lib" / "node_modules" / "npm" / "bin" / "npm-cli.js"
    for path in (node, npm):
        path.parent.mkdir(parents=True)
    node.write_text(f"#!/bin/sh\n{program}\n")
    node.chmod(0o755)
    npm.touch()
    return str(node)


def test_a_client_is_installed_once_and_names_its_version(tmp_path: Path) -> None:
    host = Host("made", "Made", "npm", ("@made/client@1.2.3",), "typescript.mjs")
    program = f"""echo once >> {tmp_path}/installed; mkdir -p node_modules/@made/client
echo '{{"version": "1.2.3"}}' > node_modules/@made/client/package.json"""
    environments = Environments(tmp_path / "kept", installer(tmp_path, program))
    first = environments.installed(host)
    assert (first.version, environments.installed(host)) == ("1.2.3", first)
    assert (tmp_path / "installed").read_text() == "once\n"
    assert environments.installed(replace(host, packages=("@made/client@1.2.4",))).folder != first.folder


def test_a_client_that_cannot_be_installed_is_left_out_with_the_reason(tmp_path: Path) -> None:
    host = Host("made", "Made", "npm", ("@made/client@1.2.3",), "typescript.mjs")
    environments = Environments(tmp_path / "kept", installer(tmp_path, "echo 404 not found >&2; exit 1"))
    with pytest.raises(LeftOut, match="made cannot be installed by npm: 404 not found"):
        environments.installed(host)
    with pytest.raises(LeftOut, match="nowhere/node does not exist"):
        Environments(tmp_path, "nowhere/node").installed(host)


def test_a_client_gets_no_environment_of_the_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", "secret")
    monkeypatch.setenv("HTTPS_PROXY", "http://somewhere")
    variables = quiet_variables(tmp_path / "home")
    assert variables["HOME"] == str(tmp_path / "home")
    assert not {"OPENAI_API_KEY", "HTTPS_PROXY", "PYTHONPATH"} & set(variables)


def test_every_driver_is_self_contained() -> None:
    drivers = Path(running.__file__).parent / "drivers"
    there = [*drivers.glob("*_driver.py"), *drivers.glob("*.mjs")]
    assert {host.driver for host in HOSTS} == {path.name for path in there}
    for path in drivers.glob("*_driver.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        assert "plannerforge" not in {
            (node.module or "").partition(".")[0] for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)
        }


def test_every_version_is_pinned() -> None:
    for host in HOSTS:
        separator = "==" if host.installer == "pip" else "@"
        assert all(package.rpartition(separator)[2][:1].isdigit() for package in host.packages), host.name


def test_a_client_that_is_not_known_is_refused() -> None:
    assert [host.name for host in chosen_hosts(["codex", "fastmcp"])] == ["fastmcp", "codex"]
    with pytest.raises(ValueError, match="unknown client: emacs; valid are fastmcp"):
        chosen_hosts(["emacs"])


SHOWN = summary_of([ShownResult("modify_scenario", "1 edit done"), ShownResult("render", "", 1)])
MADE = Host("made", "Made Client", "pip", ("made==1",), "fastmcp_driver.py", help="retries=3")
GOOD = StoryRun("stdio", False, (), "made 1", "2026-07-28", SHOWN, True, 3, goes_on=True)
BAD = replace(GOOD, faults=("not carried out: render",), goes_on=False)


def test_a_client_passes_by_all_its_transports_alone_or_with_help() -> None:
    by_http = replace(GOOD, transport="http")
    assert HostRecord(MADE, "1", (GOOD, by_http)).passed
    assert HostRecord(MADE, "1", (BAD, replace(GOOD, helped=True), by_http)).passed
    assert not HostRecord(MADE, "1", (GOOD,)).passed
    assert not HostRecord(MADE, "1", (GOOD, replace(BAD, transport="http"))).passed
    assert not HostRecord(MADE, left_out="no such package").passed
    records = [HostRecord(MADE, "1", (GOOD, by_http)), HostRecord(MADE, left_out="no such package")]
    figures = figures_of(records)
    assert (figures["hosts_passed"], figures["hosts_tried"]) == (1, 2)
    assert figures["host_made"] == "left out: no such package"


def test_the_table_lists_help_failures_and_omissions(tmp_path: Path) -> None:
    helped = replace(GOOD, helped=True)
    record = HostRecord(MADE, "1", (BAD, helped, replace(BAD, transport="http")))
    told = table_of([record, HostRecord(MADE, left_out="no such package")])
    assert told.startswith("0 of 2 clients pass.")
    assert (
        "| stdio, http (fails) | text | shown | not shown | shown | continues; ends without the setting below" in told
    )
    unrefused = HostRecord(MADE, "1", (replace(BAD, goes_on=None), helped))
    assert "without the setting" not in table_of([unrefused])
    assert "only with `retries=3`. Without this setting, it fails (not carried out: render)." in told
    assert "Made Client is left out: no such package" in told
    page = tmp_path / "hosts.md"
    page.write_text(f"# Hosts\n\n{MARK}\n\nold")
    write_page(page, [record])
    assert page.read_text().startswith(f"# Hosts\n\n{MARK}\n\n0 of 1 clients pass.")
    assert "old" not in page.read_text()


def test_the_page_has_a_row_for_every_client() -> None:
    page = (CHECKOUT / "docs" / "hosts.md").read_text(encoding="utf-8")
    written = page.partition(MARK)[2]
    rows = [line.split("|")[1].strip() for line in written.splitlines() if line.startswith("| ")]
    assert rows[2:] == [host.title for host in HOSTS]
    assert all(host.help in page for host in HOSTS)
