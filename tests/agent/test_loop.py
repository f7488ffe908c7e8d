"""The agent's loop with a real MCP server and a scripted model: calls are made, state and history are kept."""

import pytest
from support.agents import Kind, talk
from support.model_servers import Reply

from plannerforge.agent.loop import CallProgress, CallStarted, CompletedCall, TurnLimits
from plannerforge.agent.models.interface import TextPart, ThinkingPart

pytestmark = pytest.mark.anyio
both = pytest.mark.parametrize("kind", ["ollama", "openai"])
MAKE = Reply(calls=(("make_scenario", {"vehicles": 2}),))


@both
async def test_a_call_is_made_and_its_answer_reaches_the_model(kind: Kind) -> None:
    async with talk(MAKE, Reply("The scenario TST_Town-2_1_T-1 has 2 vehicles."), kind=kind) as talked:
        result = await talked.say("A scenario with two vehicles, please.")
        sent = talked.model_server.requests[1]["messages"]
    assert (result.ending, result.problem) == ("answered", "")
    assert result.answer == "The scenario TST_Town-2_1_T-1 has 2 vehicles."
    assert [message["role"] for message in sent] == ["system", "user", "assistant", "tool"]
    assert "TST_Town-2_1_T-1" in sent[-1]["content"]
    assert (result.rounds, result.prompt_tokens, result.completion_tokens) == (2, 52, 56)


@pytest.mark.parametrize("written", ["functions.make_scenario", "made:make_scenario", "tools/make_scenario"])
async def test_a_prefix_of_the_tools_names_is_removed(written: str) -> None:
    async with talk(Reply(calls=((written, {"vehicles": 2}),)), Reply("It is there.")) as talked:
        result = await talked.say("A scenario.")
    assert [(done.call.tool, done.answer.is_error) for done in result.calls] == [("make_scenario", False)]


async def test_all_events_are_shown_as_they_happen() -> None:
    done = Reply("Made it.", thinking="All went well.")
    async with talk(MAKE, done) as talked:
        await talked.say("A scenario.")
    kinds = [type(event) for event in talked.shown]
    assert kinds[:3] == [CallStarted, CallProgress, CompletedCall]
    assert {TextPart, ThinkingPart} == set(kinds[3:])
    assert CallProgress(talked.shown[0].call, 0.5, "placing vehicles") in talked.shown  # type: ignore[union-attr]


async def test_the_system_message_contains_the_server_s_description_of_its_tools() -> None:
    async with talk(Reply("Hello.")) as talked:
        await talked.say("Hello.")
    assert "Scenarios are made by make_scenario." in talked.model_server.requests[0]["messages"][0]["content"]


async def test_ids_of_answers_are_carried_into_the_next_turn() -> None:
    async with talk(MAKE, Reply("It is there."), Reply("It has two.")) as talked:
        await talked.say("A scenario.")
        await talked.say("How many vehicles has it?")
        sent = talked.model_server.requests[-1]["messages"]
    assert talked.session.state.scenario == "TST_Town-2_1_T-1"
    assert sent[-1]["content"] == "How many vehicles has it?\n\n[Working on: scenario TST_Town-2_1_T-1]"


async def test_a_model_without_tools_makes_calls_too() -> None:
    call = Reply('{"tool": "make_scenario", "arguments": {"vehicles": 2}}')
    async with talk(call, Reply('{"answer": "It has two."}'), model="plain:8b") as talked:
        result = await talked.say("A scenario.")
        sent = talked.model_server.requests[1]["messages"]
    assert (result.answer, result.calls[0].answer.structured["vehicles"]) == ("It has two.", 2)
    assert [message["role"] for message in sent] == ["system", "user", "assistant", "user"]
    assert sent[3]["content"].startswith("Answer of make_scenario:")


@pytest.mark.parametrize(
    ("text", "ending"),
    [
        ("Out of scope: I work on driving scenarios.", "refused"),
        ("**Out of scope:** no poems.", "refused"),
        ("Which town do you mean?", "asked"),
        ("Hello.", "answered"),
    ],
)
async def test_refusals_and_counter_questions_are_distinguished_from_answers(text: str, ending: str) -> None:
    async with talk(Reply(text)) as talked:
        assert (await talked.say("Write a poem.")).ending == ending


async def test_an_offer_after_finished_work_is_not_a_counter_question() -> None:
    async with talk(MAKE, Reply("It is there. Shall I run a planner on it?")) as talked:
        assert (await talked.say("A scenario.")).ending == "answered"


async def test_waiting_for_a_job_is_not_a_repetition_and_takes_no_rounds() -> None:
    look = Reply(calls=(("look_at_job", {}),))
    async with talk(*[look] * 5, Reply("The job is done."), limits=TurnLimits(rounds=3)) as talked:
        result = await talked.say("Is it done?")
    assert (result.ending, result.answer, len(result.calls)) == ("answered", "The job is done.", 5)
    assert talked.session.state.job == "job_1"


async def test_pictures_are_passed_on_and_the_model_is_informed() -> None:
    async with talk(Reply(calls=(("draw", {}),)), Reply("Here it is.")) as talked:
        result = await talked.say("Draw it.")
        sent = talked.model_server.requests[1]["messages"]
    [picture] = result.calls[0].answer.pictures
    assert (picture.mime_type, picture.data[:4]) == ("image/png", b"\x89PNG")
    assert sent[-1]["content"] == "A picture of it.\n[1 picture shown to the user]"


async def test_a_conversation_past_its_budget_is_summarised_by_the_model() -> None:
    told = Reply("word " * 400)
    summary = Reply("The user asked for TST_Town-2_1_T-1.")
    async with talk(told, summary, Reply("Go on."), limits=TurnLimits(history_tokens=300)) as talked:
        await talked.say("Tell much.")
        await talked.say("And now?")
        asked = talked.model_server.requests[1]["messages"]
        sent = talked.model_server.requests[2]["messages"]
    assert asked[0]["content"].startswith("Summarise")
    assert "user: Tell much." in asked[1]["content"]
    assert [message["role"] for message in sent] == ["system", "user", "assistant", "user"]
    assert "TST_Town-2_1_T-1" in sent[1]["content"]
    assert "summarised" in talked.notes


async def test_a_summary_is_requested_within_the_budget() -> None:
    told = [Reply("word " * 100) for _ in range(20)]
    async with talk(*told, limits=TurnLimits(history_tokens=900)) as talked:
        for _ in range(20):
            await talked.say("Tell more.")
        asked = [request["messages"] for request in talked.model_server.requests]
    summaries = [messages for messages in asked if messages[0]["content"].startswith("Summarise")]
    assert len(summaries) > 1
    assert max(len(messages[1]["content"]) for messages in summaries) < 900 * 4


async def test_a_conversation_that_cannot_be_summarised_is_left_out_with_a_note() -> None:
    broken = Reply("no memory", status=500)
    async with talk(Reply("word " * 400), broken, Reply("Go on."), limits=TurnLimits(history_tokens=300)) as talked:
        await talked.say("Tell much.")
        result = await talked.say("And now?")
    assert result.ending == "answered"
    assert "dropped, since the model gave no summary" in talked.notes
    assert talked.session.messages[0].text == "[Earlier messages were left out for want of room]"


async def test_answers_of_a_long_turn_make_room_for_newer_ones() -> None:
    calls = [Reply(calls=(("tell_much", {}),)), Reply(calls=(("draw", {}),)), Reply("Done.")]
    async with talk(*calls, limits=TurnLimits(history_tokens=600)) as talked:
        await talked.say("Tell much.")
        sent = talked.model_server.requests[2]["messages"]
    assert "shortened to make room" in sent[3]["content"]
    assert sent[5]["content"].startswith("A picture")


async def test_a_cleared_conversation_begins_again() -> None:
    async with talk(MAKE, Reply("It is there."), Reply("Hello.")) as talked:
        await talked.say("A scenario.")
        talked.session.clear()
        await talked.say("Hello.")
        sent = talked.model_server.requests[-1]["messages"]
    assert [message["content"] for message in sent[1:]] == ["Hello."]
