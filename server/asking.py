"""Sends progress and questions to the client of a call, in both protocol eras."""

import asyncio
import hashlib
from collections.abc import Mapping
from typing import Any, Literal

import anyio
from mcp import MCPError
from mcp.server.elicitation import AcceptedElicitation, render_elicitation_schema
from mcp.server.mcpserver.context import Context
from mcp.types import ElicitRequest, ElicitRequestFormParams, ElicitResult, InputRequiredResult
from pydantic import BaseModel, Field, create_model

from ..engine.execution import run_in
from ..workflows.context import Question, Services
from .tool_calls import InputNeeded

_PROGRESS_INTERVAL_S = 0.5
"""Minimum interval between progress reports; faster ones are dropped; chosen."""
STATELESS_SINCE = "2026-07-28"
"""The first protocol revision without requests from the server to the client."""


class PacedProgress:
    """Sends progress to the client, in strictly increasing values, at most twice a second."""

    def __init__(self, context: Context[Services, Any]) -> None:
        self._context, self._home = context, asyncio.get_running_loop()
        self._share, self._sent_at = 0.0, -1.0

    async def send(self, share: float, message: str) -> None:
        """Report the finished share in [0, 1], from any thread, if it is new and due."""
        await run_in(self._home, self._send, share, message)

    async def _send(self, share: float, message: str) -> None:
        now = anyio.current_time()
        if share <= self._share or (now - self._sent_at < _PROGRESS_INTERVAL_S and share < 1.0):
            return
        self._share, self._sent_at = share, now
        await self._context.report_progress(round(share, 4), 1.0, message or None)


class Asker:
    """Asks the person at the client of one call, in both protocol eras.

    Until 2025-11-25, a question is a request from the server during the call. Since 2026-07-28 there are no such
    requests: the call ends with the question, and the client repeats it with the answer, which the question's digest
    identifies.
    """

    def __init__(self, context: Context[Services, Any]) -> None:
        self._context, self._home = context, asyncio.get_running_loop()

    async def ask(self, question: Question) -> str | None:
        """Return the choice, from any thread, or None if the client cannot ask or the person does not choose.

        Raises:
            InputNeeded: the client must repeat the call with the answer.
        """
        key = self.key(question)
        given = (self._context.input_responses or {}).get(key)
        if given is not None:
            if not isinstance(given, ElicitResult) or given.action != "accept":
                return None
            return chosen(given.content, question)
        if not self.can_ask():
            return None
        version = self._context.protocol_version
        if version is not None and version >= STATELESS_SINCE:
            raise InputNeeded(key, question)
        return await run_in(self._home, self._elicit, question)

    @staticmethod
    def key(question: Question) -> str:
        """Return the key that identifies the question that an answer belongs to."""
        return f"choice-{hashlib.sha256(repr(question).encode()).hexdigest()[:16]}"

    def can_ask(self) -> bool:
        """Return whether the client shows forms; a client that declares elicitation without a mode does."""
        capabilities = self._context.client_capabilities
        elicitation = capabilities.elicitation if capabilities is not None else None
        return elicitation is not None and (elicitation.form is not None or elicitation.url is None)

    async def _elicit(self, question: Question) -> str | None:
        try:
            outcome = await self._context.elicit(question.text, _form(question))
        except (MCPError, ValueError):  # ignore an answer that does not fit
            return None
        return chosen(outcome.data.model_dump(), question) if isinstance(outcome, AcceptedElicitation) else None


def question_result(needed: InputNeeded) -> InputRequiredResult:
    """Return the result of a call that needs an answer before it can continue."""
    return InputRequiredResult(input_requests={needed.key: _request(needed.question)})


def question_request(question: Question) -> dict[str, Any]:
    """Return a question in the form that clients receive."""
    return _request(question).model_dump(by_alias=True, mode="json", exclude_none=True)


def _request(question: Question) -> ElicitRequest:
    form = render_elicitation_schema(_form(question))
    return ElicitRequest(params=ElicitRequestFormParams(message=question.text, requested_schema=form))


def _form(question: Question) -> type[BaseModel]:
    """Return a form with one field: one of the choices."""
    choices: Any = Literal[question.choices]
    form: type[BaseModel] = create_model("Choice", choice=(choices, Field(description="one of these")))
    return form


def chosen(content: Mapping[str, Any] | None, question: Question) -> str | None:
    """Return the choice in a completed form, or None if it is not one of the choices."""
    choice = (content or {}).get("choice")
    return choice if isinstance(choice, str) and choice in question.choices else None
