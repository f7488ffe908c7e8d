"""Agents under test: a scripted model behind a real client library, and a real MCP server."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any, Literal

import anyio

from plannerforge.agent.connection import Server, ToolConnection
from plannerforge.agent.loop import AgentEvent, AgentSession, Note, TurnLimits, TurnResult
from plannerforge.agent.models.interface import ModelSettings
from plannerforge.agent.models.registry import open_model
from support.model_servers import ModelServer, Reply, replies, serving
from support.tool_server import tool_server

Kind = Literal["ollama", "openai"]


@dataclass
class Talk:
    """A conversation under test: the displayed output, and the model's server."""

    session: AgentSession
    model_server: ModelServer
    connection: ToolConnection
    working: anyio.Event
    shown: list[AgentEvent] = field(default_factory=list)

    async def say(self, text: str) -> TurnResult:
        return await self.session.take_turn(text, self.shown.append)

    @property
    def notes(self) -> str:
        return "\n".join(event.text for event in self.shown if isinstance(event, Note))

    async def goes_on(self) -> TurnResult:
        """Run another turn, in which the model only answers."""
        self.model_server.script = replies(Reply("Here I am."))
        return await self.say("Are you there?")


def named(kind: Kind, url: str, model: str = "big:70b") -> str:
    return f"ollama:{model}" if kind == "ollama" else f"openai:{model}@{url}/v1"


@asynccontextmanager
async def talk(
    *scripted: Reply,
    kind: Kind = "ollama",
    limits: TurnLimits | None = None,
    model: str = "big:70b",
    server: Server | None = None,
    silence_s: float = 60.0,
    context_tokens: int = 0,
    think: bool | None = None,
    answer_tokens: int = 512,
    host: str = "",
    **known: Any,
) -> AsyncIterator[Talk]:
    """Hold a conversation with a model that answers as scripted, over the real client library and MCP."""
    working = anyio.Event()
    with serving(kind, replies(*scripted), **known) as model_server:
        settings = ModelSettings(
            host=host or model_server.url,
            silence_s=silence_s,
            context_tokens=context_tokens,
            think=think,
            answer_tokens=answer_tokens,
        )
        opened = open_model(named(kind, model_server.url, model), settings)
        try:
            async with ToolConnection.open(server or tool_server(working)) as connection:
                session = AgentSession(opened, connection, limits or TurnLimits(answer_tokens=answer_tokens))
                yield Talk(session, model_server, connection, working)
        finally:
            await opened.close()
