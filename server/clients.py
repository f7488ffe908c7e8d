"""Identifies the clients of a shared server: their permissions, and what each made last.

Over standard input, a server has one client. Over HTTP, it has many. In protocol revisions with sessions, a session
identifies each client. Since 2026-07-28 there are no sessions, and a client is identified by its token (without tokens
by its address) and the name that it gives itself.
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
"""Clients with a token of this scope may use every tool; others see only the tools that create nothing."""
READ_SCOPE = "plannerforge:read"
_MOST_REMEMBERED = 1_000
"""Clients with remembered artifacts; chosen: the longest idle one is forgotten first."""
_UNNAMED = "unknown"


@dataclass(frozen=True)
class ClientIdentity:
    """The client of a request.

    Args:
        key: distinguishes the client from other clients of the same server; empty if it is the only client.
        name: its own name, and the name of its token.
        reads_only: whether it may use only tools that create nothing.
        owner: the owner of its token; empty if tokens are not required.
    """

    key: str
    name: str
    reads_only: bool = False
    owner: str = ""


def client_of(context: ServerRequestContext[Any]) -> ClientIdentity:
    """Return the client that sent a request."""
    parameters = context.session.client_params
    own_name = _UNNAMED if parameters is None else f"{parameters.client_info.name} {parameters.client_info.version}"
    request = context.request
    if not isinstance(request, Request):
        return ClientIdentity("", own_name)
    principal = principal_of(request.scope)
    name = f"{own_name} ({principal})" if principal else own_name
    session = request.headers.get(MCP_SESSION_ID_HEADER)
    whose = principal or (f"at {request.client.host}" if request.client else "")
    key = f"{principal} session {session}" if session else f"{whose} named {own_name}"
    return ClientIdentity(key, name, reads_only=not may_write(request.scope), owner=principal)


def principal_of(scope: Scope) -> str:
    """Return the owner of a request's token: its name, or client and subject of an OAuth token; empty if absent."""
    user = scope.get("user")
    if not isinstance(user, AuthenticatedUser):
        return ""
    client, _, subject = principal_components(user.access_token)
    return client if subject in (None, client) else f"{client} {subject}"


def may_write(scope: Scope) -> bool:
    """Return whether the sender of a request may create something.

    Senders may if their token allows it, or if tokens are not required.
    """
    user = scope.get("user")
    return not isinstance(user, AuthenticatedUser) or WRITE_SCOPE in user.scopes


class ClientMemories:
    """The latest artifacts and choices of each client of one server."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._by_key: OrderedDict[str, Recent] = OrderedDict()

    def of(self, key: str) -> Recent:
        """Return what is remembered about a client; it is empty for a new client."""
        with self._lock:
            recent = self._by_key.setdefault(key, Recent())
            self._by_key.move_to_end(key)
            if len(self._by_key) > _MOST_REMEMBERED:
                self._by_key.popitem(last=False)
            return recent
