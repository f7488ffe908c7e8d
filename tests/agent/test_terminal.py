"""The agent in a terminal: what is printed, kept and returned; Ctrl-C ends a turn and nothing else."""

import io
import os
import signal
import stat
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from support import tool_server
from support.model_servers import ModelServer, Reply, replies, serving
from support.tool_server import served_tools
from typer.testing import CliRunner

from plannerforge.agent.settings import AgentSettings
from plannerforge.agent.terminal import ReadLine, run_chat, run_request
from plannerforge.cli.main import application

MAKE = Reply(calls=(("make_scenario", {"vehicles": 2}),))
DONE = Reply("TST_Town-2_1_T-1 has 2 vehicles.")
SERVER = f"{sys.executable} {Path(tool_server.__file__)}"


@pytest.fixture(scope="module")
def tools_url() -> Iterator[str]:
    with served_tools() as url:
        yield url


@pytest.fixture(autouse=True)
def served(tools_url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Unless a test names another server, the agent works with the one at this address."""
    monkeypatch.setenv("PLANNERFORGE_AGENT_URL", tools_url)


def settings_for(model_server: ModelServer, **others: Any) -> AgentSettings:
    return AgentSettings(**{"model": "ollama:big:70b", "host": model_server.url} | others)


def printed(run: Callable[[Console], int]) -> tuple[str, int]:
    console = Console(file=io.StringIO(), width=100, highlight=False)
    status = run(console)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue(), status


def lines(*said: str) -> ReadLine:
    """A user who says this, and then leaves."""
    waiting = list(said)

    def next_line(prompt: str) -> str:
        if not waiting:
            raise EOFError
        return waiting.pop(0)

    return next_line


def chat(workspace: Path, *said: str, script: tuple[Reply, ...], resume: bool = False) -> tuple[str, int, ModelServer]:
    with serving("ollama", replies(*script)) as server:
        settings = settings_for(server)

        def run(console: Console) -> int:
            return run_chat(settings, workspace=workspace, console=console, read_line=lines(*said), resume=resume)

        text, status = printed(run)
    return text, status, server


def request(tmp_path: Path, *script: Reply, **others: Any) -> tuple[str, int]:
    with serving("ollama", replies(*script)) as server:
        settings = settings_for(server, **others)
        return printed(lambda console: run_request(settings, "Do it.", workspace=tmp_path, console=console))


def test_a_request_prints_calls_with_progress_and_the_answer(tmp_path: Path) -> None:
    text, status = request(tmp_path, MAKE, DONE)
    assert status == 0
    assert '● make_scenario {"vehicles": 2}\n    50% placing vehicles\n  ✓ ' in text
    assert "TST_Town-2_1_T-1 has 2 vehicles.\n(1 call, 108 tokens, " in text


@pytest.mark.parametrize(
    ("reply", "status"),
    [(Reply("Out of scope: no poems."), 3), (Reply("Which town do you mean?"), 4), (Reply("no memory", status=500), 1)],
)
def test_the_exit_status_gives_the_end_of_a_request(tmp_path: Path, reply: Reply, status: int) -> None:
    assert request(tmp_path, reply)[1] == status


@pytest.mark.parametrize(
    ("others", "told"),
    [
        ({"model": "ollama:none"}, "no model 'none'. Valid: plain:8b, big:70b"),
        ({"model": "none"}, "'none' is not a model name"),
        ({"host": "http://127.0.0.1:9"}, "no Ollama answers at http://127.0.0.1:9"),
        ({"url": "", "server": "/no/such/program"}, "the MCP server cannot be reached"),
        ({"url": "", "server": "'unclosed"}, "cannot be read"),
    ],
)
def test_a_failure_to_start_the_agent_is_one_line(tmp_path: Path, others: dict[str, str], told: str) -> None:
    text, status = request(tmp_path, DONE, **others)
    assert status == 2
    assert told in text
    assert text.startswith("plannerforge: ")
    assert len(text.splitlines()) == 1


def test_a_chat_shows_state_history_and_help(tmp_path: Path) -> None:
    said = ("A scenario.", "/state", "/history", "/help", "/what", "")
    text, status, _ = chat(tmp_path, *said, script=(MAKE, DONE))
    assert status == 0
    assert "Working on: scenario TST_Town-2_1_T-1" in text
    assert 'assistant:; make_scenario {"vehicles": 2}' in text
    assert "/quit     leave" in text
    assert "There is no command /what." in text


def test_a_cleared_chat_leaves_the_one_before_in_its_folder(tmp_path: Path) -> None:
    chat(tmp_path, "A scenario.", "/clear", "Hello.", script=(MAKE, DONE, Reply("Hello.")))
    assert len(list(tmp_path.glob("chats/*/messages.jsonl"))) == 2


def test_a_chat_is_resumed_with_its_messages_and_artifacts(tmp_path: Path) -> None:
    chat(tmp_path, "A scenario.", script=(MAKE, DONE))
    text, _, server = chat(tmp_path, "And now?", script=(Reply("It stands."),), resume=True)
    sent = server.requests[0]["messages"]
    assert "4 messages. Working on: scenario TST_Town-2_1_T-1" in text
    assert [message["role"] for message in sent] == ["system", "user", "assistant", "tool", "assistant", "user"]
    assert "TST_Town-2_1_T-1" in sent[-1]["content"]


def test_a_missing_chat_cannot_be_resumed(tmp_path: Path) -> None:
    text, status, _ = chat(tmp_path, script=(DONE,), resume=True)
    assert (status, "there is no earlier chat" in text) == (2, True)


def test_a_damaged_chat_is_reported(tmp_path: Path) -> None:
    chat(tmp_path, "Hello.", script=(DONE,))
    [file] = tmp_path.glob("chats/*/messages.jsonl")
    file.write_text('{"state": {}}\n{"role": 7}\n')
    text, status, _ = chat(tmp_path, script=(DONE,), resume=True)
    assert (status, "cannot be read" in text) == (2, True)


def test_pictures_are_files_of_the_chat_that_are_the_users_alone(tmp_path: Path) -> None:
    text, _, _ = chat(tmp_path, "Draw.", script=(Reply(calls=(("draw", {}),)), Reply("There.")))
    [picture] = tmp_path.glob("chats/*/picture-1.png")
    assert str(picture) in text.replace("\n", "")
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert stat.S_IMODE(picture.parent.stat().st_mode) == 0o700


def test_a_workspace_that_cannot_be_written_ends_no_chat(tmp_path: Path) -> None:
    (tmp_path / "chats").write_text("a file where the folder should be")
    said = ("Draw.", "Still there?")
    text, status, _ = chat(tmp_path, *said, script=(Reply(calls=(("draw", {}),)), Reply("There."), Reply("Yes.")))
    assert "cannot write the picture to" in text
    assert text.count("The conversation cannot be stored in") == 2
    assert ("Yes." in text, status) == (True, 0)


def test_a_model_s_text_cannot_steer_the_terminal(tmp_path: Path) -> None:
    text, _ = request(tmp_path, Reply("\x1b[2JGone.\x07"))
    assert "\x1b" not in text
    assert "Gone." in text


def test_an_interrupt_ends_the_turn_and_the_chat_continues(tmp_path: Path) -> None:
    with serving("ollama", replies(Reply("One moment please", fault="hold"), Reply("Here I am."))) as server:

        def interrupt() -> None:
            server.held.wait()
            os.kill(os.getpid(), signal.SIGINT)

        thread = threading.Thread(target=interrupt)
        thread.start()
        before = signal.getsignal(signal.SIGINT)
        settings, said = settings_for(server), lines("Hello?", "Still there?")
        text, status = printed(lambda console: run_chat(settings, workspace=tmp_path, console=console, read_line=said))
        thread.join()
    assert status == 0
    assert "\nInterrupted; all work so far is kept.\n" in text
    assert "Here I am." in text
    assert signal.getsignal(signal.SIGINT) is before


def test_an_interrupt_at_the_prompt_explains_how_to_leave(tmp_path: Path) -> None:
    waiting = ["interrupted", "Hello?"]

    def read_line(prompt: str) -> str:
        if not waiting:
            raise EOFError
        line = waiting.pop(0)
        if line == "interrupted":
            signal.raise_signal(signal.SIGINT)
        return line

    with serving("ollama", replies(Reply("Here I am."))) as server:
        settings = settings_for(server)
        text, status = printed(
            lambda console: run_chat(settings, workspace=tmp_path, console=console, read_line=read_line)
        )
    assert (status, "/quit leaves." in text, "Here I am." in text) == (0, True, True)


def test_the_commands_take_flags_and_variables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with serving("ollama", replies(MAKE, DONE)) as server:
        monkeypatch.setenv("PLANNERFORGE_AGENT_MODEL", "ollama:big:70b")
        monkeypatch.setenv("PLANNERFORGE_AGENT_CONTEXT_TOKENS", "20000")
        monkeypatch.delenv("PLANNERFORGE_AGENT_URL")
        flags = ["--host", server.url, "--server", SERVER, "--workspace", str(tmp_path)]
        done = CliRunner().invoke(application, ["agent", "A scenario.", *flags])
    assert done.exit_code == 0, done.output
    assert "TST_Town-2_1_T-1 has 2 vehicles." in done.output
    assert server.requests[0]["options"]["num_ctx"] == 20_000


@pytest.mark.parametrize("flags", [["--think", "maybe"], ["--context-tokens", "-1"], []])
def test_a_wrong_flag_ends_with_one_line(flags: list[str], tmp_path: Path) -> None:
    done = CliRunner().invoke(application, ["chat", "--workspace", str(tmp_path), *flags])
    assert done.exit_code == 2
    assert len(done.output.strip().splitlines()) == 1
