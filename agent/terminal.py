"""The agent in a terminal: one request (``plannerforge agent``) or a conversation (``plannerforge chat``)."""

import asyncio
import json
import signal
import sys
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from types import FrameType

import anyio
from rich.console import Console
from rich.status import Status
from rich.text import Text

from ..schemas.errors import PlannerForgeError
from ..schemas.text import counted, one_line, printable
from .connection import Server, ToolConnection, own_server, server_of_command
from .errors import AgentError
from .instructions import own_instructions
from .loop import AgentEvent, AgentSession, CallProgress, CallStarted, CompletedCall, Ending, TurnResult
from .models.interface import Message, ModelFacts, TextPart, ThinkingPart
from .models.registry import open_model
from .records import ChatRecord, server_log
from .settings import AgentSettings

_SHOWN_LINES, _SHOWN_CHARACTERS = 6, 200
"""Shown lines of a tool's answer, and shown characters of a line or of arguments (chosen: the model reports
the rest).
"""
_FILE_WIDTH, _INDENT = 118, 10
"""Answers' lines are cut at the width of the terminal, or at this width if there is no terminal (chosen)."""
_EXIT_STATUS: dict[Ending, int] = {"answered": 0, "failed": 1, "refused": 3, "asked": 4, "interrupted": 130}
CANNOT_BEGIN = 2
"""Exit status if the model or the server is unavailable."""
_HELP = """\
/help     this list
/history  earlier messages and calls
/state    current ids, and the size of the conversation
/clear    start anew
/quit     leave (also Ctrl-D)
Ctrl-C ends the current answer; messages and work so far are kept."""
ReadLine = Callable[[str], str]
"""Requests a line; raises EOFError at the end, and KeyboardInterrupt if the user interrupts."""


class TurnView:
    """Shows a turn as it happens: streamed text, calls with their progress, pictures as files."""

    def __init__(self, console: Console, record: ChatRecord, *, show_thinking: bool = False) -> None:
        self._console, self._show_thinking = console, show_thinking
        self.record = record
        self._status: Status | None = None
        self._in_text = False
        self._last_progress = ""

    def __call__(self, event: AgentEvent) -> None:
        """Show an event."""
        if isinstance(event, TextPart):
            self._stream(Text(printable(event.text)))
        elif isinstance(event, ThinkingPart):
            if self._show_thinking:
                self._stream(Text(printable(event.text), style="dim italic"))
            else:
                self._wait("thinking")
        elif isinstance(event, CallStarted):
            arguments = one_line(json.dumps(dict(event.call.arguments or {}), ensure_ascii=False), _SHOWN_CHARACTERS)
            self._line(Text.assemble(("● ", "cyan"), (one_line(event.call.tool), "bold cyan"), f" {arguments}"))
            self._wait(event.call.tool)
        elif isinstance(event, CallProgress):
            self._progress(event)
        elif isinstance(event, CompletedCall):
            self._completed(event)
        else:
            self._line(Text(f"  note: {event.text}", style="yellow"))

    def begin(self) -> None:
        """Show that the model has been called."""
        self._wait("waiting for the model")

    def end(self, result: TurnResult) -> None:
        """Show the problem, if there is one, and the cost of an ended turn."""
        self._line(None)
        if result.problem:
            style = "yellow" if result.ending in ("answered", "interrupted") else "bold red"
            self._console.print(Text(result.problem, style=style), soft_wrap=True)
        tokens = result.prompt_tokens + result.completion_tokens
        spent = f"{counted(len(result.calls), 'call')}, {tokens:,} tokens, {result.duration_s:.1f} s"
        self._console.print(Text(f"({spent})", style="dim"))

    def _completed(self, done: CompletedCall) -> None:
        answer = done.answer
        sign, style = ("✗", "yellow") if answer.is_error else ("✓", "green")
        lines = [line for line in printable(answer.text).splitlines() if line.strip()] or ["(nothing)"]
        more = len(lines) - _SHOWN_LINES
        width = (self._console.width if self._console.is_terminal else _FILE_WIDTH) - _INDENT
        lines = [one_line(line, 2 * width if answer.is_error else width) for line in lines[:_SHOWN_LINES]]
        lines += [f"… {counted(more, 'more line')}"] if more > 0 else []
        self._line(Text.assemble((f"  {sign} ", style), (f"{done.duration_s:.1f} s  ", "dim"), lines[0]))
        for line in lines[1:]:
            self._line(Text(f"    {line}", style="dim"))
        for picture in answer.pictures:
            try:
                path = self.record.save_picture(picture.data, picture.mime_type)
            except (PlannerForgeError, OSError) as error:
                self._line(Text(f"    cannot write the picture to {self.record.folder}: {error}", style="yellow"))
                continue
            self._line(Text.assemble("    picture: ", (str(path), f"link {path.as_uri()}")))
        self._wait("waiting for the model")

    def _progress(self, event: CallProgress) -> None:
        share = f"{event.share:.0%} " if event.share is not None else ""
        shown = one_line(f"{share}{event.message}") or "working"
        if self._console.is_terminal:
            self._wait(f"{event.call.tool}: {shown}")
        elif event.message and event.message != self._last_progress:
            self._last_progress = event.message
            self._line(Text(f"    {shown}", style="dim"))

    def _wait(self, what: str) -> None:
        """Show the current activity; only on a terminal."""
        if self._in_text or not self._console.is_terminal:
            return
        if self._status is None:
            self._status = self._console.status(Text(f"{what} …", style="dim"), spinner="dots")
            self._status.start()
        else:
            self._status.update(Text(f"{what} …", style="dim"))

    def _stream(self, text: Text) -> None:
        self._stop_waiting()
        self._in_text = True
        self._console.print(text, end="", soft_wrap=True)

    def _line(self, text: Text | None) -> None:
        """Print a separate line, below any streamed text."""
        self._stop_waiting()
        if self._in_text:
            self._console.print()
            self._in_text = False
        if text is not None:
            self._console.print(text, soft_wrap=True)

    def _stop_waiting(self) -> None:
        if self._status is not None:
            self._status.stop()
            self._status = None


@dataclass(frozen=True)
class _OpenSession:
    session: AgentSession
    greeting: str


def run_request(
    settings: AgentSettings, request: str, *, workspace: Path, console: Console, show_thinking: bool = False
) -> int:
    """Fulfil one request and print the steps.

    Returns the exit status: 0 answered, 1 failed, 2 the model or the server is unavailable, 3 refused as out of scope,
    4 asked a question, 130 interrupted.
    """

    async def carry_out() -> int:
        record = ChatRecord.begin(workspace, _now())
        async with _open_session(settings, workspace) as opened:
            console.print(Text(opened.greeting, style="dim"), soft_wrap=True)
            result = await _turn(opened.session, request, TurnView(console, record, show_thinking=show_thinking))
            return _EXIT_STATUS[result.ending]

    return _run(carry_out, console)


def run_chat(
    settings: AgentSettings,
    *,
    workspace: Path,
    console: Console,
    resume: bool = False,
    show_thinking: bool = False,
    read_line: ReadLine | None = None,
) -> int:
    """Chat with the agent until the user leaves; the conversation is stored in the workspace.

    Returns the exit status: 0, or 2 if the model or the server is unavailable.
    """
    ask = read_line or _line_reader(console)

    async def talk() -> int:
        record = ChatRecord.newest(workspace) if resume else ChatRecord.begin(workspace, _now())
        view = TurnView(console, record, show_thinking=show_thinking)
        async with _open_session(settings, workspace, record if resume else None) as opened:
            console.print(Text(opened.greeting, style="dim"), soft_wrap=True)
            if resume:
                before = f"Continuing {record.folder.name}: {len(opened.session.messages)} messages."
                console.print(Text(f"{before} {opened.session.state.line.strip('[]')}", style="dim"), soft_wrap=True)
            console.print(Text("Say what you need; /help lists the commands.", style="dim"))
            await _conversation(opened.session, view, console, ask)
        if view.record.folder.exists():
            console.print(Text(f"The conversation is stored in {view.record.folder}.", style="dim"), soft_wrap=True)
        return 0

    return _run(talk, console)


async def _conversation(session: AgentSession, view: TurnView, console: Console, ask: ReadLine) -> None:
    while True:
        console.print()
        try:
            with _on_interrupt(signal.default_int_handler):
                line = ask("you › ").strip()
        except EOFError:
            return
        except KeyboardInterrupt:
            console.print(Text("\n/quit leaves.", style="dim"))
            continue
        if line in ("/quit", "/exit"):
            return
        if line.startswith("/"):
            _command(line, session, view, console)
        elif line:
            await _turn(session, line, view)
            _save(session, view.record, console)


def _save(session: AgentSession, record: ChatRecord, console: Console) -> None:
    try:
        record.save(session.messages, session.state)
    except (PlannerForgeError, OSError) as error:
        shown = f"The conversation cannot be stored in {record.folder}: {error}"
        console.print(Text(shown, style="yellow"), soft_wrap=True)


def _command(line: str, session: AgentSession, view: TurnView, console: Console) -> None:
    if line == "/help":
        console.print(Text(_HELP))
    elif line == "/history":
        shown = [_format_message(message) for message in session.messages]
        console.print(Text("\n".join(shown) or "No messages yet."), soft_wrap=True)
    elif line == "/state":
        console.print(Text(session.state.line.strip("[]") or "No current ids yet."), soft_wrap=True)
        console.print(Text(f"The conversation has {session.history_tokens:,} tokens."))
    elif line == "/clear":
        session.clear()
        view.record = ChatRecord.begin(view.record.folder.parent.parent, _now())
        console.print(Text("Started anew; the earlier conversation stays in its folder."))
    else:
        console.print(Text(f"There is no command {one_line(line)}.\n{_HELP}"))


def _format_message(message: Message) -> str:
    calls = [f"{call.tool} {json.dumps(dict(call.arguments or {}), ensure_ascii=False)}" for call in message.calls]
    speaker = f"  answer of {message.tool}" if message.role == "tool" else message.role
    return one_line("; ".join(filter(None, [f"{speaker}: {message.text}".rstrip(), *calls])), _SHOWN_CHARACTERS)


async def _turn(session: AgentSession, text: str, view: TurnView) -> TurnResult:
    """Run a turn that Ctrl-C can end."""
    loop = asyncio.get_running_loop()

    def interrupt(number: int, frame: FrameType | None) -> None:
        del number, frame
        loop.call_soon_threadsafe(session.interrupt)

    with _on_interrupt(interrupt):
        view.begin()
        result = await session.take_turn(text, view)
        view.end(result)
        return result


@contextmanager
def _on_interrupt(handler: Callable[[int, FrameType | None], object]) -> Iterator[None]:
    """Set the effect of Ctrl-C for the block, which would otherwise cancel the whole program's task."""
    before = signal.signal(signal.SIGINT, handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@asynccontextmanager
async def _open_session(
    settings: AgentSettings, workspace: Path, resumed: ChatRecord | None = None
) -> AsyncIterator[_OpenSession]:
    """Yield a session with the model and the server of the settings."""
    model = open_model(settings.model, settings.for_model())
    try:
        facts = await model.facts()
        small = settings.small(facts)
        messages, state = resumed.load() if resumed else ((), None)
        log = server_log(workspace)
        async with ToolConnection.open(_server(settings, facts, workspace), log) as connection:
            condition = "none" if settings.url or settings.server else settings.condition
            session = AgentSession(
                model,
                connection,
                settings.for_turns(facts),
                instructions=own_instructions(condition),
                short=bool(small),
                history=messages,
            )
            session.state = state or session.state
            yield _OpenSession(session, _greeting(settings, model.name, small, len(connection.tools)))
    finally:
        await model.close()


def _server(settings: AgentSettings, facts: ModelFacts, workspace: Path) -> Server:
    if settings.url:
        return settings.url
    if settings.server:
        return server_of_command(settings.server)
    return own_server(workspace=str(workspace), tools=settings.tool_set(facts))


def _greeting(settings: AgentSettings, model: str, small: str, tool_count: int) -> str:
    others = settings.url or settings.server
    if small and not others and settings.tools == "auto":
        tools = f"the {tool_count} essential tools and short answers, since the model has {small}"
    elif small:
        tools = f"{tool_count} tools and short answers, since the model has {small}"
    else:
        tools = f"{tool_count} tools"
    return f"{model} with {tools}{f' of {one_line(others)}' if others else ''}."


def _line_reader(console: Console) -> ReadLine:
    """Return a reader of standard input, with history and editing on a terminal, and with an echo otherwise."""
    if not sys.stdin.isatty():

        def read_and_echo(prompt: str) -> str:
            line = sys.stdin.readline()
            if not line:
                raise EOFError
            console.print(Text.assemble((prompt, "bold"), line.rstrip("\n")), soft_wrap=True)
            return line

        return read_and_echo
    import readline  # noqa: F401 - lets input() edit lines

    return input


def _now() -> datetime:
    return datetime.now().astimezone()


def _run(work: Callable[[], Awaitable[int]], console: Console) -> int:
    """Run the work to its end, and print an error that prevents it from starting."""
    try:
        return anyio.run(work)
    except AgentError as error:
        console.print(Text(f"plannerforge: {error.text}", style="bold red"), soft_wrap=True)
        return CANNOT_BEGIN
    except KeyboardInterrupt:
        return _EXIT_STATUS["interrupted"]
