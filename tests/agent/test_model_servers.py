"""The loopback servers speak as the real ones: the client libraries' own types take every line that they send."""

import json

import httpx
import ollama
import pytest
from openai.types import Model
from openai.types.chat import ChatCompletionChunk
from support.model_servers import Reply, replies, serving

FULL = Reply("Two scenarios.", calls=(("make", {"count": 2}), ("make", {})), thinking="Let me see.")


def lines(url: str, body: dict[str, object]) -> list[str]:
    with httpx.stream("POST", url, json=body) as answer:
        return [line for line in answer.iter_lines() if line]


def test_lines_of_the_ollama_server_are_chat_responses() -> None:
    with serving("ollama", replies(FULL)) as server:
        sent = [json.loads(line) for line in lines(f"{server.url}/api/chat", {"model": "big:70b"})]
    parts = [ollama.ChatResponse.model_validate(line, strict=True) for line in sent]
    assert all(set(line) <= set(ollama.ChatResponse.model_fields) for line in sent)
    assert "".join(part.message.content or "" for part in parts) == FULL.text
    assert [part.done for part in parts] == [False] * (len(parts) - 1) + [True]


def test_facts_of_the_ollama_server_match_what_the_client_reads() -> None:
    with serving("ollama", replies(FULL)) as server, ollama.Client(server.url) as client:
        shown, listed = client.show("big:70b"), client.list()
    assert shown.capabilities == ["completion", "tools", "thinking"]
    assert shown.details is not None
    assert shown.details.parameter_size == "70.6B"
    assert [model.model for model in listed.models] == ["big:70b", "plain:8b"]
    assert {"name", "model", "modified_at", "size", "digest", "details"} >= set(ollama.ListResponse.Model.model_fields)


def test_lines_of_the_openai_server_are_chunks() -> None:
    body = {"model": "big:70b", "stream_options": {"include_usage": True}}
    with serving("openai", replies(FULL)) as server:
        sent = lines(f"{server.url}/v1/chat/completions", body)
    assert all(line.startswith("data: ") for line in sent)
    assert sent[-1] == "data: [DONE]"
    chunks = [ChatCompletionChunk.model_validate_json(line.removeprefix("data: "), strict=True) for line in sent[:-1]]
    assert chunks[-1].usage is not None
    assert chunks[-2].choices[0].finish_reason == "tool_calls"


def test_the_openai_server_s_list_contains_models() -> None:
    with serving("openai", replies(FULL)) as server:
        data = httpx.get(f"{server.url}/v1/models").json()["data"]
    assert [Model.model_validate(entry, strict=True).id for entry in data] == ["big:70b", "plain:8b"]


@pytest.mark.parametrize(
    ("kind", "path", "body", "status"),
    [
        ("ollama", "/api/chat", {"model": "none"}, 404),
        ("ollama", "/api/chat", {"model": "plain:8b", "tools": [{}]}, 400),
        ("ollama", "/api/chat", {"model": "plain:8b", "think": True}, 400),
        ("ollama", "/api/none", {"model": "plain:8b"}, 404),
        ("openai", "/v1/chat/completions", {"model": "none"}, 404),
        ("openai", "/v1/none", {"model": "plain:8b"}, 404),
    ],
)
def test_a_server_s_refusal_is_an_error_with_its_status(
    kind: str, path: str, body: dict[str, object], status: int
) -> None:
    with serving(kind, replies(FULL)) as server:  # type: ignore[arg-type]
        answer = httpx.post(f"{server.url}{path}", json=body)
    assert answer.status_code == status
    assert "error" in answer.json()
