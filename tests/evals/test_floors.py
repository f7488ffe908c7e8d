"""The floors: keywords alone, in routing and in selection."""

from pathlib import Path

import pytest
from support.evaluations import EchoSession, request

from plannerforge.evals.attempts import EvalRequest
from plannerforge.evals.floors import class_of
from plannerforge.evals.roster import open_agent
from plannerforge.evals.scoring.scores import score_attempt

pytestmark = pytest.mark.anyio


def routing(text: str, actions: list[str], letters: str = "") -> EvalRequest:
    truth = {"actions": actions, **({"vehicle_mod": letters} if letters else {})}
    return EvalRequest("rt-1", "routing", "routing", text, truth, "ok")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("Remove vehicle 12 and reroute truck 9.", ("vehicle_mod", "TP")),
        ("Set the jerk weight to 0.2", ("param_mod", "")),
        ("Which presets are there?", ("param_qa", "")),
        ("Start a batch of 50", ("batch_sim", "")),
        ("Compare the last two batches.", ("batch_analysis", "")),
        ("Sing a song", ("fail", "")),
    ],
)
def test_regex_chooses_the_first_class_with_a_matching_pattern(text: str, expected: tuple[str, str]) -> None:
    assert class_of(text) == expected


async def test_regex_is_right_by_keywords_and_wrong_without_them(tmp_path: Path) -> None:
    agent, _ = open_agent("regex", "baseline", 0)
    session = EchoSession(tmp_path)
    plain = routing("Set the goal to lanelet 7.", ["vehicle_mod"], "G")
    assert score_attempt(plain, await agent.attempt(plain, session), tmp_path).done
    veiled = routing("Our ego should arrive somewhere else.", ["vehicle_mod"], "G")
    assert not score_attempt(veiled, await agent.attempt(veiled, session), tmp_path).done


async def test_bm25_searches_for_the_words_without_conditions(tmp_path: Path) -> None:
    agent, _ = open_agent("bm25", "baseline", 0)
    attempt = await agent.attempt(request(3), EchoSession(tmp_path))
    assert [call.arguments for call in attempt.calls] == [{"text": "Find scenario 3.", "method": "bm25", "limit": 5}]


@pytest.mark.parametrize(("name", "corpus"), [("regex", "selection"), ("bm25", "routing")])
async def test_a_floor_makes_no_call_in_another_task(name: str, corpus: str, tmp_path: Path) -> None:
    agent, _ = open_agent(name, "baseline", 0)
    attempt = await agent.attempt(request(1, corpus), EchoSession(tmp_path))
    assert (attempt.ending, attempt.calls) == ("failed", ())
    assert "nothing else" in attempt.failure
