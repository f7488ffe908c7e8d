"""Messages that the SDK cannot read: which of them are answered, with what, and how much of them is kept."""

import io
import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcp.types import INVALID_REQUEST, PARSE_ERROR, jsonrpc_message_adapter

from plannerforge.server.stdio.messages import LONGEST_MESSAGE, unreadable
from plannerforge.server.stdio.streams import BoundedLines

CALL: dict[str, Any] = {"jsonrpc": "2.0", "id": 7, "method": "tools/call"}


def answered(line: str) -> tuple[object, int] | None:
    """The id and the code of the answer to a line; None where there is none."""
    with pytest.raises(Exception) as raised:  # noqa: PT011 - whatever the SDK raises
        jsonrpc_message_adapter.validate_json(line, by_name=False)
    answer = unreadable(raised.value)
    return None if answer is None else (answer.id, answer.error.code)


def nested(depth: int, **more: Any) -> str:
    """A call with lists in each other, which Python's encoder does not write."""
    text = json.dumps(CALL | {"params": {"deep": "DEEP"}} | more)
    return text.replace('"DEEP"', "[" * depth + "]" * depth)


@pytest.mark.parametrize("request_id", [0, -5, 2**53, "a", 'with "quotes" and \\', ""])
def test_a_request_that_no_parser_accepts_is_answered_by_its_id(request_id: int | str) -> None:
    assert answered(nested(5000, id=request_id)) == (request_id, PARSE_ERROR)


def test_number_of_thousands_of_digits_is_answered() -> None:
    line = json.dumps(CALL | {"params": {"name": "render", "arguments": {"id": 1, "time_s": "N"}}})
    assert answered(line.replace('"N"', "9" * 5000)) == (7, PARSE_ERROR)


def test_id_behind_the_parameters_is_found() -> None:
    line = nested(5000)
    assert answered('{"params"' + line.partition('"params"')[2][:-1] + ', "method": "x", "id": 3}') == (3, PARSE_ERROR)


@pytest.mark.parametrize("line", ["hello", "[1]", '{"jsonrpc": "2.0", "id": 7}', "{", '{"id": "\\', ""])
def test_an_invalid_request_is_not_answered(line: str) -> None:
    assert answered(line) is None


def test_response_that_cannot_be_read_is_not_answered() -> None:
    line = nested(5000).replace('"method": "tools/call", ', "")
    assert answered(line) is None


def test_request_of_another_form_is_an_invalid_one() -> None:
    assert answered('{"id": 7, "method": "tools/call"}') == (7, INVALID_REQUEST)


@given(st.text(alphabet='{}[]":,\\idmethod5 ', max_size=60))
def test_no_line_makes_the_search_for_an_id_fail(text: str) -> None:
    line = "[" * 300 + text
    assert answered(line) is None


def test_line_longer_than_a_message_is_cut_and_the_next_one_is_whole() -> None:
    long = '{"id": 7, "method": "x", "params": "' + "x" * (2 * LONGEST_MESSAGE) + '"}'
    lines = BoundedLines(io.BytesIO(f"{long}\nsecond\nthird".encode()))
    first = lines.readline()
    assert len(first) == LONGEST_MESSAGE
    assert answered(first) == (7, PARSE_ERROR)
    assert (lines.readline(), lines.readline(), lines.readline()) == ("second\n", "third", "")
