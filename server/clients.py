"""Who asks, where several clients share one server: what each may do, and what each made last.

By standard input a server has one client. By HTTP it has many: a session tells them apart in the revisions that have
sessions; since 2026-07-28 there is none, and a client is known by its token and the name that it gives itself.
"""

import threading
from collections import OrderedDict
from dataclasses import dataclass
from typing import Any

from mcp.server.auth.middleware.bearer_auth import AuthenticatedUser
from mcp.server.auth.provider import principal_components
from mcp.server.context import ServerRequestContext
from mcp.server.streamable_http import MCP_SESSION_ID_HEADER
from starlette.requests import Request
from starlette.types import Scope

from ..workflows.context import Recent

WRITE_SCOPE = "plannerforge:write"
"""Whose token has it may use every tool; others see the tools that make nothing."""
READ_SCOPE = "plannerforge:read"
_MOST_REMEMBERED = 1_000
"""Clients whose last artifacts are remembered; chosen: the one that was quiet for longest is forgotten first."""
_UNNAMED = "unknown"


@dataclass(frozen=True)
class ClientIdentity:
    """The client of a request.

    Args:
        key: what tells it from others on the same server; empty where it is the only one.
        name: what it calls itself, and the name of its token.
        reads_only: it may use only what makes nothing.
        owner: whose token it has; empty where none is asked for.
    """

    key: str
    name: str
    reads_only: bool = False
    owner: str = ""


def client_of(context: ServerRequestContext[Any]) -> ClientIdentity:
    """The client that sent a request."""
    parameters = context.session.client_params
    own_name = _UNNAMED if parameters is None else f"{parameters.client_info.name} {parameters.client_info.version}"
    request = context.request
    if not isinstance(request, Request):
        return ClientIdentity("", own_name)
    principal = principal_of(request.scope)
    name = f"{own_name} ({principal})" if principal else own_name
    session = request.headers.get(MCP_SESSION_ID_HEADER)
    key = f"{principal} session {session}" if session else f"{principal} named {own_name}"
    return ClientIdentity(key, name, reads_only=not may_write(request.scope), owner=principal)


def principal_of(scope: Scope) -> str:
    """Whose token a request carries: its name, or client and subject of an OAuth token; empty where it has none."""
    user = scope.get("user")
    if not isinstance(user, AuthenticatedUser):
        return ""
    client, _, subject = principal_components(user.access_token)
    return client if subject in (None, client) else f"{client} {subject}"


def may_write(scope: Scope) -> bool:
    """Whether the sender of a request may make something: its token says so, or none is asked for."""
    user = scope.get("user")
    return not isinstance(user, AuthenticatedUser) or WRITE_SCOPE in user.scopes


class ClientMemories:
    """What each client of one server made or chose last."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._by_key: OrderedDict[str, Recent] = OrderedDict()

    def of(self, key: str) -> Recent:
        """What is remembered of a client; of a new one nothing."""
        with self._lock:
            recent = self._by_key.setdefault(key, Recent())
            self._by_key.move_to_end(key)
            if len(self._by_key) > _MOST_REMEMBERED:
                self._by_key.popitem(last=False)
            return recent
