"""The journal: one line per call with all that is needed to count and to make it again."""

import json
import logging
import subprocess
import sys
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
from mcp.types import CallToolResult, Implementation, TextContent

from plannerforge.server.observing.journal import KEPT_FILES, Journal
from plannerforge.server.observing.logs import REDACTED
from plannerforge.server.settings import Settings
from plannerforge.server.tokens import count_tokens

TESTS = Path(__file__).parents[1]
FIELDS = {"time", "call_id", "client", "tool", "arguments", "result_ids", "duration_s", "result_tokens", "error"}


@pytest.fixture(scope="module", autouse=True)
def _tables_of_the_token_count_are_read() -> None:
    count_tokens("a text")


def entries(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def add(journal: Journal, text: str = "done", structured: dict[str, Any] | None = None, **changes: Any) -> None:
    result = CallToolResult(
        content=[TextContent(type="text", text=text)],
        structured_content=structured,
        is_error=changes.pop("is_error", False),
    )
    call = {
        "time": "t",
        "call_id": "1",
        "client": "c",
        "tool": "echo",
        "arguments": {},
        "duration_s": 0.123456,
        **changes,
    }
    journal.add(result=result, **call)


@pytest.mark.anyio
@pytest.mark.usefixtures("probe_tools")
async def test_each_call_of_a_client_is_one_line_with_all_fields(connect: Any, settings: Settings) -> None:
    async with connect() as client:
        await client.call_tool("echo", {"text": "run_0123456789ab and map_bonn and DEU_Bonn-1_1_T-1"})
        await client.call_tool("echo", {"text": "x", "cuont": 1})
    done, refused = entries(settings.workspace / "journal" / "calls.jsonl")
    assert set(done) == set(refused) == FIELDS
    assert (done["tool"], done["error"]) == ("echo", "")
    assert done["arguments"] == {"text": "run_0123456789ab and map_bonn and DEU_Bonn-1_1_T-1"}
    assert done["result_ids"] == ["run_0123456789ab", "map_bonn", "DEU_Bonn-1_1_T-1"]
    assert done["result_tokens"] > 10
    assert done["duration_s"] >= 0
    assert datetime.fromisoformat(done["time"]).utcoffset() is not None
    assert done["client"].startswith("mcp ")
    assert refused["error"].startswith("[invalid_request] there is no argument 'cuont'")
    assert refused["result_ids"] == []


@pytest.mark.anyio
@pytest.mark.usefixtures("probe_tools")
async def test_journal_names_the_client_as_it_calls_itself(connect: Any, settings: Settings) -> None:
    async with connect(client_info=Implementation(name="workbench", version="7.1")) as client:
        await client.call_tool("echo", {"text": "x"})
    (entry,) = entries(settings.workspace / "journal" / "calls.jsonl")
    assert entry["client"] == "workbench 7.1"


@pytest.mark.anyio
@pytest.mark.usefixtures("probe_tools")
async def test_no_journal_is_written_if_it_is_off(connect: Any, settings: Settings) -> None:
    async with connect(settings.model_copy(update={"journal": False})) as client:
        await client.call_tool("echo", {"text": "x"})
    assert not (settings.workspace / "journal").exists()


def test_ids_come_from_the_structure_once_each(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "calls.jsonl", 10_000)
    add(journal, "text", {"a": "run_0123456789ab", "b": ["cfg_aaaaaaaa", "run_0123456789ab"], "c": "runway_1"})
    journal.close()
    assert entries(tmp_path / "calls.jsonl")[0]["result_ids"] == ["run_0123456789ab", "cfg_aaaaaaaa"]


def test_journal_is_rotated_by_size_and_old_parts_go(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "calls.jsonl", 1000)
    for number in range(60):
        add(journal, arguments={"number": number, "padding": "x" * 100})
    journal.close()
    files = sorted(tmp_path.iterdir())
    assert len(files) == KEPT_FILES + 1
    assert all(file.stat().st_size <= 1000 for file in files)
    kept = [entry["arguments"]["number"] for file in files for entry in entries(file)]
    assert sorted(kept) == list(range(60 - len(kept), 60)), "the newest are kept, none twice"


def test_the_journal_continues_after_it_was_closed(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "calls.jsonl", 10_000)
    journal.close()
    for tool in ("first", "second"):
        add(journal, tool=tool)
        journal.close()
    assert [entry["tool"] for entry in entries(tmp_path / "calls.jsonl")] == ["first", "second"]


def test_a_server_that_ends_at_once_reads_no_tables_to_count_tokens(tmp_path: Path) -> None:
    program = f"""
import sys
from pathlib import Path
sys.path[:0] = {[str(TESTS / "server"), str(TESTS)]!r}
from test_journal import Journal, add, entries
from plannerforge.server.tokens import has_tables
journal, path = Journal(Path("calls.jsonl"), 10_000), Path("calls.jsonl")
add(journal)
journal.close()
assert not has_tables()
assert [entry["result_tokens"] for entry in entries(path)] == [None]
"""
    subprocess.run([sys.executable, "-c", program], cwd=tmp_path, check=True)


def test_text_that_no_file_can_contain_is_still_written(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "calls.jsonl", 10_000)
    add(journal, arguments={"text": "half a pair \ud83d", "line": "a\nb\u2028c"})
    journal.close()
    assert len((tmp_path / "calls.jsonl").read_bytes().split(b"\n")) == 2
    (line,) = (tmp_path / "calls.jsonl").read_text(encoding="utf-8").removesuffix("\n").split("\n")
    assert json.loads(line)["arguments"]["text"] == "half a pair"


def test_an_unwritable_journal_fails_no_call_but_is_reported(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "file").write_text("")
    journal = Journal(tmp_path / "file" / "calls.jsonl", 10_000)
    with caplog.at_level(logging.ERROR):
        add(journal)
        add(journal)
        journal.close()
    assert caplog.text.count("could not be recorded") == 2


def test_journal_is_its_owners_alone_and_follows_no_link(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "journal" / "calls.jsonl", 10_000)
    add(journal)
    journal.close()
    assert (tmp_path / "journal" / "calls.jsonl").stat().st_mode & 0o077 == 0
    assert (tmp_path / "journal").stat().st_mode & 0o077 == 0
    (tmp_path / "linked.jsonl").symlink_to(tmp_path / "elsewhere")
    linked = Journal(tmp_path / "linked.jsonl", 10_000)
    add(linked)
    linked.close()
    assert not (tmp_path / "elsewhere").exists()


@pytest.mark.parametrize(
    "secret",
    [
        "sk-abcdefghijklmnop1234",
        "Authorization: Bearer abc.def-ghi_12345",
        "api_key=hunter2hunter2",
        "eyJhbGciOiJIUzI1NiJ9.eyJzdWIiOiIxMjM0NTY3ODkw.abc",
        "ticket-0815",
    ],
)
def test_secrets_are_left_out_in_all_places(tmp_path: Path, secret: str) -> None:
    journal = Journal(tmp_path / "calls.jsonl", 100_000, redact=[r"ticket-\d+"])
    add(journal, arguments={"text": f"see {secret} there", "list": [{"a": secret}], secret: 1}, text=f"no {secret}")
    journal.close()
    written = (tmp_path / "calls.jsonl").read_text()
    assert secret not in written
    assert written.count(REDACTED) >= 3


def test_long_texts_and_lists_are_cut(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "calls.jsonl", 10**6)
    add(journal, arguments={"text": "x" * 10**5, "ids": ["y" * 300] * 3000, "seed": 10**4000})
    journal.close()
    assert (tmp_path / "calls.jsonl").stat().st_size < 20_000


def test_call_that_cannot_be_written_down_costs_no_other_its_line(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    journal = Journal(tmp_path / "calls.jsonl", 1024**2)
    add(journal, arguments={"what": {1, 2}})
    add(journal)
    journal.close()
    assert len(entries(tmp_path / "calls.jsonl")) == 1
    assert "a call of echo could not be recorded" in caplog.text


def test_text_of_any_length_is_counted() -> None:
    text = "".join(chr(33 + number * 7919 % 90) for number in range(400_000))
    assert 200_000 < count_tokens(text) < 400_000
