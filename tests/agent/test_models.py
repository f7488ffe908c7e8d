"""Models through the official clients, against loopback servers: what they say, and what goes wrong with them."""

import socket
import sys
from typing import Any

import pytest
from support.agents import Kind, named
from support.model_servers import ModelServer, Reply, replies, serving

from plannerforge.agent.errors import (
    ModelFailure,
    ModelRefused,
    ModelSilent,
    ModelUnreachable,
    SettingsFault,
    StreamCut,
    UnknownModel,
)
from plannerforge.agent.models.interface import (
    CallPart,
    Message,
    ModelEvent,
    ModelSettings,
    StreamEnd,
    TextPart,
    ThinkingPart,
    ToolDefinition,
)
from plannerforge.agent.models.registry import open_model

pytestmark = pytest.mark.anyio
COUNT = {"type": "integer", "description": "How many (at least 1)"}
MAKE = ToolDefinition("make", "Make some.", {"type": "object", "properties": {"count": COUNT}, "required": ["count"]})
ASKED = [Message("system", "Be brief."), Message("user", "Make two.")]
KINDS: list[Kind] = ["ollama", "openai"]
both = pytest.mark.parametrize("kind", KINDS)


async def asked(
    kind: Kind,
    server: ModelServer,
    *,
    tools: tuple[ToolDefinition, ...] = (MAKE,),
    model: str = "big:70b",
    **options: Any,
) -> list[ModelEvent]:
    settings = {"silence_s": 60.0, "api_key": "", "think": None, "context_tokens": 0} | options
    opened = open_model(named(kind, server.url, model), ModelSettings(host=server.url, **settings))
    try:
        return [event async for event in opened.stream(ASKED, tools)]
    finally:
        await opened.close()


def text_of(events: list[ModelEvent]) -> str:
    return "".join(event.text for event in events if isinstance(event, TextPart))


@both
async def test_text_and_thinking_come_in_pieces_and_tokens_at_the_end(kind: Kind) -> None:
    with serving(kind, replies(Reply("Two scenarios are there.", thinking="The user wants two."))) as server:
        events = await asked(kind, server)
    assert text_of(events) == "Two scenarios are there."
    assert "".join(event.text for event in events if isinstance(event, ThinkingPart)) == "The user wants two."
    assert len([event for event in events if isinstance(event, TextPart)]) > 1
    assert events[-1] == StreamEnd(26, 28, cut=False)


@both
@pytest.mark.parametrize(
    ("written", "thought", "said"),
    [
        ("<think>Two, or three?</think>\n\nTwo.", "Two, or three?", "Two."),
        ("\n<think>Two", "Two", ""),
        ("<think></think>Two.", "", "Two."),
        ("a < b <think>", "", "a < b <think>"),
        ("<thin", "", "<thin"),
        ("<think>a </thin b</think>c", "a </thin b", "c"),
    ],
)
async def test_thinking_inside_the_text_is_separated(kind: Kind, written: str, thought: str, said: str) -> None:
    with serving(kind, replies(Reply(written))) as server:
        events = await asked(kind, server)
    assert "".join(event.text for event in events if isinstance(event, ThinkingPart)) == thought
    assert text_of(events) == said


@both
async def test_calls_come_whole_with_their_arguments(kind: Kind) -> None:
    wanted = Reply(calls=(("make", {"count": 2}), ("make", {"count": 3})))
    with serving(kind, replies(wanted)) as server:
        events = await asked(kind, server)
    calls = [event.call for event in events if isinstance(event, CallPart)]
    assert [(call.tool, call.arguments) for call in calls] == [("make", {"count": 2}), ("make", {"count": 3})]
    assert len({call.call_id for call in calls}) == 2


@both
async def test_a_call_that_is_not_json_has_no_arguments(kind: Kind) -> None:
    with serving(kind, replies(Reply(calls=(("make", '{"count": }'),)))) as server:
        events = await asked(kind, server)
    [call] = [event.call for event in events if isinstance(event, CallPart)]
    assert call.arguments is None
    assert '{"count": }' in call.written


@both
async def test_an_answer_cut_at_its_limit_says_so(kind: Kind) -> None:
    with serving(kind, replies(Reply("Two and", end="length"))) as server:
        end = (await asked(kind, server))[-1]
    assert isinstance(end, StreamEnd)
    assert end.cut


@both
async def test_uncounted_tokens_are_unknown(kind: Kind) -> None:
    with serving(kind, replies(Reply("Two.", counts_tokens=False))) as server:
        assert (await asked(kind, server))[-1] == StreamEnd(None, None)


@both
async def test_earlier_calls_and_answers_are_sent_in_the_form_of_the_server(kind: Kind) -> None:
    from plannerforge.agent.models.interface import RequestedCall

    call = RequestedCall("call_1", "make", {"count": 2})
    told = [*ASKED, Message("assistant", "", (call,)), Message("tool", "made", call_id="call_1", tool="make")]
    with serving(kind, replies(Reply("Done."))) as server:
        opened = open_model(named(kind, server.url), ModelSettings(host=server.url))
        _ = [event async for event in opened.stream(told, [MAKE])]
        await opened.close()
    sent = server.requests[0]["messages"]
    assert [message["role"] for message in sent] == ["system", "user", "assistant", "tool"]
    function = sent[2]["tool_calls"][0]["function"]
    assert function["arguments"] == ({"count": 2} if kind == "ollama" else '{"count": 2}')
    assert (sent[3].get("tool_name") or sent[3].get("tool_call_id")) == ("make" if kind == "ollama" else "call_1")


async def test_ollama_gets_context_thinking_and_time_in_memory() -> None:
    with serving("ollama", replies(Reply("Two."))) as server:
        await asked("ollama", server, think=False, context_tokens=8192, temperature=0.0, seed=7)
    request = server.requests[0]
    assert request["options"] == {"num_ctx": 8192, "num_predict": 4096, "temperature": 0.0, "seed": 7}
    assert request["think"] is False
    assert request["keep_alive"] == "5m"


@pytest.mark.parametrize(("written", "sent"), [("10m", "10m"), ("-1", -1.0), ("0", 0.0)])
async def test_time_in_memory_is_a_number_or_has_its_unit(written: str, sent: str | float) -> None:
    with serving("ollama", replies(Reply("Two."))) as server:
        await asked("ollama", server, keep_alive=written)
    assert server.requests[0]["keep_alive"] == sent


async def test_a_context_is_never_longer_than_the_model_has() -> None:
    with serving("ollama", replies(Reply("Two.")), context_tokens=2048) as server:
        await asked("ollama", server, context_tokens=100_000)
    assert server.requests[0]["options"]["num_ctx"] == 2048


@pytest.mark.parametrize(
    ("written", "called", "said"),
    [
        ('{"tool": "make", "arguments": {"count": 2}}', ("make", {"count": 2}), ""),
        ('{"answer": "There are two."}', None, "There are two."),
        ('{"tool": "make", "argum', ("", None), ""),
        ('["make"]', ("", None), ""),
    ],
)
async def test_a_model_without_tools_chooses_by_a_schema(
    written: str, called: tuple[str, Any] | None, said: str
) -> None:
    with serving("ollama", replies(Reply(written))) as server:
        events = await asked("ollama", server, model="plain:8b")
    [request] = server.requests
    assert not request.get("tools")
    assert request["format"]["anyOf"][0]["properties"]["tool"] == {"const": "make"}
    assert "make: Make some." in request["messages"][0]["content"]
    calls = [(event.call.tool, event.call.arguments) for event in events if isinstance(event, CallPart)]
    assert (calls, text_of(events)) == ([called] if called else [], said)


@both
async def test_an_address_without_a_server_gives_the_start_command(kind: Kind) -> None:
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        nowhere = ModelServer(url=f"http://127.0.0.1:{closed.getsockname()[1]}")
        with pytest.raises(ModelUnreachable, match=r"answers at .*Next: start"):
            await asked(kind, nowhere)


@both
async def test_an_unknown_model_is_reported_with_the_valid_ones(kind: Kind) -> None:
    with serving(kind, replies(Reply())) as server, pytest.raises(UnknownModel, match="no model 'big:7b'") as caught:
        await asked(kind, server, model="big:7b")
    assert caught.value.valid == ("big:70b", "plain:8b")


@both
@pytest.mark.parametrize(
    ("reply", "failure", "told"),
    [
        (Reply("Two and", fault="cut"), StreamCut, "was interrupted"),
        (Reply("Two and", fault="no json"), StreamCut, "cannot be read"),
        (Reply("Two and", fault="error line"), ModelRefused, "refused: .*(EOF|memory)"),
        (Reply("more system memory is needed", status=500), ModelRefused, "more system memory"),
        (Reply("slow down", status=429), ModelRefused, "slow down"),
    ],
    ids=["cut", "no json", "error in the stream", "error", "too many"],
)
async def test_a_failed_answer_gives_its_reason(
    kind: Kind, reply: Reply, failure: type[ModelFailure], told: str
) -> None:
    with serving(kind, replies(reply)) as server, pytest.raises(failure, match=told):
        await asked(kind, server)


@both
async def test_a_model_that_stays_silent_is_abandoned(kind: Kind) -> None:
    with (
        serving(kind, replies(Reply("Two and", fault="hold"))) as server,
        pytest.raises(ModelSilent, match=r"nothing came from .* for 0\.2 s"),
    ):
        await asked(kind, server, silence_s=0.2)


async def test_a_refused_key_names_its_setting() -> None:
    with serving("openai", replies(Reply("Two.")), key="right") as server:
        with pytest.raises(ModelRefused, match="PLANNERFORGE_AGENT_API_KEY"):
            await asked("openai", server, api_key="wrong")
        assert text_of(await asked("openai", server, api_key="right")) == "Two."


@pytest.mark.parametrize(
    "name",
    ["", "qwen3", "llama:x", "ollama:", "openai:m", "openai:m@ftp://x", "openai:@http://x", "openai:m@http://[x"],
)
def test_a_name_of_another_form_is_refused_with_the_forms(name: str) -> None:
    with pytest.raises(SettingsFault, match=r"ollama:|openai:MODEL@URL"):
        open_model(name, ModelSettings())


@pytest.mark.parametrize("host", ["nonsense::", "http://[bad"])
def test_an_invalid_address_is_reported(host: str) -> None:
    with pytest.raises(SettingsFault, match="is not an address of an Ollama server"):
        open_model("ollama:m", ModelSettings(host=host))


async def test_an_address_of_another_protocol_is_unreachable() -> None:
    opened = open_model("ollama:m", ModelSettings(host="ftp://somewhere"))
    with pytest.raises(ModelUnreachable, match="ftp://somewhere"):
        await opened.facts()
    await opened.close()


def test_a_missing_package_is_reported_with_the_command_that_installs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "openai", None)
    with pytest.raises(SettingsFault, match=r"pip install 'plannerforge-mcp\[openai\]'"):
        open_model("openai:m@http://localhost:1/v1", ModelSettings())
