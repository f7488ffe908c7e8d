"""Whatever a model, a tool or a server does wrong: the turn says so, and the conversation goes on."""

import sys
from pathlib import Path

import anyio
import pytest
from mcp import StdioServerParameters
from support import tool_server
from support.agents import Kind, talk
from support.model_servers import Reply, replies

from plannerforge.agent.loop import TurnLimits
from plannerforge.agent.models.interface import TextPart

pytestmark = pytest.mark.anyio
both = pytest.mark.parametrize("kind", ["ollama", "openai"])
MAKE = Reply(calls=(("make_scenario", {"vehicles": 2}),))
DONE = Reply("It is done.")


@both
async def test_an_unknown_tool_is_answered_with_the_valid_ones(kind: Kind) -> None:
    async with talk(Reply(calls=(("create_scenario", {}),)), MAKE, DONE, kind=kind) as talked:
        result = await talked.say("A scenario.")
        assert (await talked.goes_on()).ending == "answered"
    wrong, right = result.calls
    assert wrong.answer.text.startswith("There is no tool 'create_scenario'. Nearest: make_scenario")
    assert not right.answer.is_error
    assert result.ending == "answered"


@both
async def test_arguments_of_wrong_types_are_answered_with_the_error(kind: Kind) -> None:
    wrong = Reply(calls=(("make_scenario", {"vehicles": "a few"}),))
    async with talk(wrong, MAKE, DONE, kind=kind) as talked:
        result = await talked.say("A scenario.")
        assert (await talked.goes_on()).ending == "answered"
    assert result.calls[0].answer.is_error
    assert "vehicles" in result.calls[0].answer.text
    assert not result.calls[1].answer.is_error


@both
async def test_a_call_that_is_not_json_is_requested_again(kind: Kind) -> None:
    async with talk(Reply(calls=(("make_scenario", '{"vehicles": '),)), MAKE, DONE, kind=kind) as talked:
        result = await talked.say("A scenario.")
        asked = talked.model_server.requests[1]["messages"]
        assert (await talked.goes_on()).ending == "answered"
    assert "its arguments are not a JSON object" in asked[-1]["content"]
    assert [done.call.arguments for done in result.calls] == [{"vehicles": 2}]
    assert "could not be read" in talked.notes


@both
async def test_calls_that_stay_unreadable_end_the_turn(kind: Kind) -> None:
    async with talk(Reply(calls=(("make_scenario", "{"),)), kind=kind) as talked:
        result = await talked.say("A scenario.")
        assert (await talked.goes_on()).ending == "answered"
    assert result.ending == "failed"
    assert "3 consecutive calls that are not JSON" in result.problem


async def test_the_same_call_again_and_again_ends_the_turn() -> None:
    async with talk(MAKE) as talked:
        result = await talked.say("A scenario.")
        assert (await talked.goes_on()).ending == "answered"
    assert result.ending == "failed"
    assert "repeating the same call: make_scenario" in result.problem
    assert "is not repeated" in result.calls[2].answer.text
    assert [done.answer.is_error for done in result.calls] == [False, False, True, True, True]


async def test_calls_without_an_end_stop_at_the_limit_of_rounds() -> None:
    calls = [Reply(calls=(("make_scenario", {"vehicles": number}),)) for number in range(1, 9)]
    async with talk(*calls, limits=TurnLimits(rounds=4)) as talked:
        result = await talked.say("Scenarios.")
        assert (await talked.goes_on()).ending == "answered"
    assert "called 4 times without reaching an answer" in result.problem
    assert len(result.calls) == 4


async def test_a_turn_stops_at_the_limit_of_tokens() -> None:
    calls = [Reply(calls=(("make_scenario", {"vehicles": number}),)) for number in range(1, 9)]
    async with talk(*calls, limits=TurnLimits(tokens=100)) as talked:
        result = await talked.say("Scenarios.")
        assert (await talked.goes_on()).ending == "answered"
    assert "took more than 100 tokens" in result.problem


async def test_a_turn_stops_at_the_limit_of_time() -> None:
    async with talk(Reply("One moment", fault="hold"), limits=TurnLimits(turn_s=0.5)) as talked:
        result = await talked.say("A scenario.")
        assert (await talked.goes_on()).ending == "answered"
    assert result.ending == "failed"
    assert "longer than 0.5 s" in result.problem


@both
async def test_an_empty_answer_is_requested_again(kind: Kind) -> None:
    async with talk(Reply(""), Reply("Here I am."), kind=kind) as talked:
        result = await talked.say("Hello?")
    assert (result.ending, result.answer) == ("answered", "Here I am.")
    assert "the answer was empty; the model gets another try" in talked.notes


async def test_a_second_empty_answer_ends_the_turn() -> None:
    async with talk(Reply("")) as talked:
        result = await talked.say("Hello?")
        assert (await talked.goes_on()).ending == "answered"
    assert (result.ending, result.rounds) == ("failed", 2)
    assert result.problem.startswith("The model gave an empty answer, twice.")


@both
async def test_a_cut_stream_ends_the_turn_and_earlier_results_stay(kind: Kind) -> None:
    async with talk(MAKE, Reply("The scenario is", fault="cut"), kind=kind) as talked:
        result = await talked.say("A scenario.")
        assert (await talked.goes_on()).ending == "answered"
        sent = talked.model_server.requests[-1]["messages"]
    assert result.ending == "failed"
    assert "was interrupted" in result.problem
    assert "repeat the request; the conversation is kept" in result.problem
    assert any("TST_Town-2_1_T-1" in message.get("content", "") for message in sent)
    assert any(message.get("content", "").endswith("[broken off]") for message in sent)


@both
async def test_an_answer_that_cannot_be_read_ends_the_turn(kind: Kind) -> None:
    async with talk(Reply("The scenario is", fault="no json"), kind=kind) as talked:
        result = await talked.say("A scenario.")
        assert (await talked.goes_on()).ending == "answered"
    assert "cannot be read" in result.problem


@both
async def test_a_model_that_vanishes_midway_ends_the_turn(kind: Kind) -> None:
    async with talk(MAKE, Reply("the model runner has stopped", status=500), kind=kind) as talked:
        result = await talked.say("A scenario.")
        assert (await talked.goes_on()).ending == "answered"
    assert (result.ending, len(result.calls)) == ("failed", 1)
    assert "the model runner has stopped" in result.problem


async def test_a_refused_connection_ends_the_turn_with_the_program_to_start() -> None:
    async with talk(DONE, host="http://127.0.0.1:9") as talked:
        result = await talked.say("Hello?")
    assert result.ending == "failed"
    assert "no Ollama answers at http://127.0.0.1:9" in result.problem
    assert talked.session.messages[-1].role == "assistant"


async def test_a_silent_model_ends_the_turn() -> None:
    async with talk(Reply("One", fault="hold"), silence_s=0.2) as talked:
        result = await talked.say("Hello?")
        assert (await talked.goes_on()).ending == "answered"
    assert "nothing came from ollama:big:70b for 0.2 s" in result.problem


async def test_a_huge_answer_of_a_tool_is_cut_with_the_count() -> None:
    async with talk(Reply(calls=(("tell_much", {}),)), DONE, limits=TurnLimits(result_characters=1000)) as talked:
        result = await talked.say("Tell much.")
        sent = talked.model_server.requests[1]["messages"][-1]["content"]
        assert (await talked.goes_on()).ending == "answered"
    assert "[cut: 1,000 of 210,000 characters are shown; request less" in sent
    assert len(sent) < 1200
    assert result.ending == "answered"


async def test_a_huge_answer_of_the_model_is_left() -> None:
    async with talk(Reply("word " * 5000), Reply("In short: none."), answer_tokens=64) as talked:
        result = await talked.say("Tell much.")
        assert (await talked.goes_on()).ending == "answered"
    assert result.answer == "In short: none."
    assert "did not end and was cut" in talked.notes
    assert sum(len(event.text) for event in talked.shown if isinstance(event, TextPart)) < 1000


@both
async def test_two_calls_at_once_are_carried_out_in_order(kind: Kind) -> None:
    two = Reply(calls=(("make_scenario", {"vehicles": 2}), ("make_scenario", {"vehicles": 5})))
    async with talk(two, DONE, kind=kind) as talked:
        result = await talked.say("Two scenarios.")
        sent = talked.model_server.requests[1]["messages"]
        assert (await talked.goes_on()).ending == "answered"
    assert [done.answer.structured["vehicles"] for done in result.calls] == [2, 5]
    assert [message["role"] for message in sent[2:]] == ["assistant", "tool", "tool"]
    assert len({done.call.call_id for done in result.calls}) == 2


@both
async def test_an_error_of_a_tool_is_an_answer(kind: Kind) -> None:
    async with talk(Reply(calls=(("refuse_all", {}),)), Reply("There is no road."), kind=kind) as talked:
        result = await talked.say("A scenario.")
        assert (await talked.goes_on()).ending == "answered"
    assert result.calls[0].answer.is_error
    assert (result.ending, result.answer) == ("answered", "There is no road.")


async def test_a_server_that_ends_is_reported_and_started_again_with_the_next_turn() -> None:
    folder = Path(tool_server.__file__).parent
    program = StdioServerParameters(command=sys.executable, args=[str(folder / "tool_server.py")])
    async with talk(Reply(calls=(("end_the_server", {}),)), server=program) as talked:
        result = await talked.say("End it.")
        talked.model_server.script = replies(MAKE, DONE)
        after = await talked.say("A scenario.")
    assert result.ending == "failed"
    assert "the MCP server ended while it worked on end_the_server" in result.problem
    assert "the MCP server was restarted" in talked.notes
    assert (after.ending, after.calls[0].answer.is_error) == ("answered", False)


async def test_an_interrupt_while_the_model_speaks_keeps_the_conversation() -> None:
    async with talk(MAKE, Reply("The scenario is", fault="hold")) as talked, anyio.create_task_group() as tasks:

        async def interrupt() -> None:
            await anyio.to_thread.run_sync(talked.model_server.held.wait)
            talked.session.interrupt()

        tasks.start_soon(interrupt)
        result = await talked.say("A scenario.")
        assert (await talked.goes_on()).ending == "answered"
    assert result.ending == "interrupted"
    assert result.problem == "Interrupted; all work so far is kept."
    assert talked.session.state.scenario == "TST_Town-2_1_T-1"


async def test_an_interrupt_while_a_tool_works_answers_the_call_for_the_model() -> None:
    both_calls = Reply(calls=(("wait_for_ever", {}), ("make_scenario", {})))
    async with talk(both_calls) as talked, anyio.create_task_group() as tasks:

        async def interrupt() -> None:
            await talked.working.wait()
            talked.session.interrupt()

        tasks.start_soon(interrupt)
        result = await talked.say("Work.")
        assert (await talked.goes_on()).ending == "answered"
        sent = talked.model_server.requests[-1]["messages"]
    assert result.ending == "interrupted"
    assert [message["role"] for message in sent[2:6]] == ["assistant", "tool", "tool", "assistant"]
    assert sent[3]["content"].startswith("[not carried out")


async def test_an_interrupt_between_turns_has_no_effect() -> None:
    async with talk(DONE) as talked:
        talked.session.interrupt()
        assert (await talked.say("Hello.")).ending == "answered"


@both
async def test_endless_thinking_is_cut_and_the_model_is_queried_once_more(kind: Kind) -> None:
    async with talk(Reply(fault="endless"), Reply("Here I am."), kind=kind, answer_tokens=64) as talked:
        result = await talked.say("Hello?")
    assert (result.ending, result.answer) == ("answered", "Here I am.")
    assert "did not end" in talked.notes
    request = talked.model_server.requests[1]
    assert request.get("think", request.get("chat_template_kwargs")) in (False, {"enable_thinking": False})


async def test_thinking_that_never_ends_ends_the_turn() -> None:
    async with talk(Reply(fault="endless"), answer_tokens=64) as talked:
        result = await talked.say("Hello?")
        assert (await talked.goes_on()).ending == "answered"
    assert result.problem.startswith("The model's answer did not end, twice.")


@pytest.mark.parametrize(
    "text",
    [
        'I will call it: {"name": "make_scenario", "arguments": {"vehicles": 2}}',
        '<tool_call>\n{"name": "make_scenario", "arguments": {}}\n</tool_call>',
        '```json\n{"tool": "make_scenario", "parameters": {"vehicles": 2}}\n```',
        "make_scenario(vehicles=2)",
        'Call: make_scenario {"vehicles": 2}',
        "**Action:** `make_scenario`",
        "<function=make_scenario><parameter=vehicles>2</parameter></function>",
    ],
)
async def test_a_call_written_as_text_is_requested_as_a_call(text: str) -> None:
    async with talk(Reply(text), MAKE, DONE) as talked:
        result = await talked.say("A scenario.")
        asked = talked.model_server.requests[1]["messages"]
        assert (await talked.goes_on()).ending == "answered"
    assert "Call make_scenario as a tool call" in asked[-1]["content"]
    assert (result.ending, len(result.calls)) == ("answered", 1)


@pytest.mark.parametrize(
    "text",
    [
        "I can do this:\n- make_scenario (makes scenarios)\n- `draw`: draws them",
        "The answer of make_scenario has vehicles: 2.",
        'It is {"vehicles": 2}.',
    ],
)
async def test_a_text_that_names_tools_is_not_a_call(text: str) -> None:
    async with talk(Reply(text)) as talked:
        result = await talked.say("What can you do?")
    assert (result.ending, result.rounds) == ("answered", 1)


async def test_a_call_that_stays_text_is_reported_to_the_user() -> None:
    async with talk(Reply('{"name": "make_scenario", "arguments": {"vehicles": 2}}')) as talked:
        result = await talked.say("A scenario.")
        assert (await talked.goes_on()).ending == "answered"
    assert result.ending == "failed"
    assert "wrote the call of make_scenario as text" in result.problem


@pytest.mark.parametrize(
    "text",
    [
        "I have generated a scenario with two vehicles.",
        "I've successfully created it.",
        "The scenario has been generated.",
        "Successfully modified the scenario.",
    ],
)
async def test_a_claim_without_a_call_is_questioned_and_then_reported(text: str) -> None:
    async with talk(Reply(text)) as talked:
        result = await talked.say("A scenario.")
        asked = talked.model_server.requests[1]["messages"]
        assert (await talked.goes_on()).ending == "answered"
    assert "No tool was called in this turn" in asked[-1]["content"]
    assert result.ending == "failed"
    assert "no tool was called in this turn, so nothing was done" in result.problem


async def test_a_claim_is_fulfilled_by_the_call() -> None:
    async with talk(Reply("I have generated a scenario."), MAKE, Reply("I have generated TST_Town-2_1_T-1.")) as talked:
        result = await talked.say("A scenario.")
    assert (result.ending, result.problem, len(result.calls)) == ("answered", "", 1)


async def test_a_report_of_earlier_work_is_an_answer_with_a_remark() -> None:
    async with talk(MAKE, DONE, Reply("I have generated TST_Town-2_1_T-1 before.")) as talked:
        await talked.say("A scenario.")
        result = await talked.say("What did you do?")
    assert result.ending == "answered"
    assert "no tool was called in this turn" in result.problem
