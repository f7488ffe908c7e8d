"""``plannerforge serve --http``: MCP at ``/mcp``, with ``/health`` and ``/ready``, and a shutdown that loses nothing.

``plannerforge ui`` serves the same together with the pages of the workspace, on this machine only.
"""

import asyncio
import ipaddress
import logging
import math
import socket
import sys
import time
from collections.abc import Callable
from contextlib import AsyncExitStack
from dataclasses import dataclass
from types import FrameType
from typing import TYPE_CHECKING, cast

import anyio
import uvicorn
from mcp.server.auth.middleware.auth_context import AuthContextMiddleware
from mcp.server.auth.middleware.bearer_auth import BearerAuthBackend, RequireAuthMiddleware
from mcp.server.auth.provider import TokenVerifier
from mcp.server.auth.routes import build_resource_metadata_url, create_protected_resource_routes
from mcp.server.auth.settings import AuthSettings
from mcp.server.streamable_http_manager import StreamableHTTPASGIApp, StreamableHTTPSessionManager
from mcp.server.transport_security import TransportSecuritySettings
from pydantic import AnyHttpUrl, ConfigDict, TypeAdapter
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.middleware.authentication import AuthenticationMiddleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import JSONResponse
from starlette.routing import Route
from starlette.types import ASGIApp

from ...schemas.errors import InvalidRequest
from ..application import PlannerForgeServer
from ..clients import READ_SCOPE, WRITE_SCOPE
from ..settings import Settings
from .access import EitherTokens, IssuedTokens, OwnTokens, tokens_of
from .connections import ConnectionLimits, Connections, calm_logs
from .gate import Gate, HttpLimits
from .sessions import BoundedSessions

if TYPE_CHECKING:
    from .pages.application import Pages

logger = logging.getLogger(__name__)
PATH = "/mcp"
_LOOPBACK_NAMES = ("127.0.0.1", "localhost", "[::1]")
_ANY_ADDRESS = {"0.0.0.0", "::"}  # noqa: S104 - searched for, not bound
_SESSION_IDLE_S = 1800.0
"""Seconds until an idle session is forgotten; the SDK's default. A client simply begins another."""
_BACKLOG = 256
_CONNECTIONS_END_S = 2.0
"""Connections that wait to be accepted, and their time to close after the last request; chosen."""
KEEP_ALIVE_S = 75
"""How long an idle connection stays open. Chosen: longer than clients (5 s) and proxies (60 s) keep one, so that they
close it; if the server closes first, a request that is on its way then is lost.
"""
READY_KEPT_S = 1.0
"""Lifetime of the answer of ``/ready`` (chosen): it needs no token, and must not disturb clients."""


class HttpServer:
    """MCP over HTTP for the given settings, with access control and limits.

    Args:
        server: the server.
        settings: address and access.
        pages: pages of the workspace, which are a client of this endpoint; for everyone on this machine.

    Raises:
        InvalidRequest: it would be open to others, or settings contradict each other.
        OutsideRoots: the file of tokens cannot be read.
    """

    def __init__(self, server: PlannerForgeServer, settings: Settings, pages: "Pages | None" = None) -> None:
        authentication = _Authentication.of(settings)
        if authentication is None and not _is_loopback(settings.http_host):
            raise InvalidRequest(
                f"http_host {settings.http_host} lets other machines in, but tokens are not required",
                valid=["127.0.0.1, which needs no token"],
                next_step="`plannerforge token NAME` creates one for the file in http_token_file; or set oauth_issuer",
            )
        most_bytes = settings.http_body_mb * 1024**2
        let_in = _accepted_headers(settings)
        self._sessions = StreamableHTTPSessionManager(
            app=server.protocol,
            security_settings=let_in,
            max_request_body_size=most_bytes + 1,  # the gate explains the refusal of a larger one
            session_idle_timeout=_SESSION_IDLE_S,
            max_sessions=None,  # they are limited per token
        )
        limits = HttpLimits(most_bytes, settings.http_calls, settings.http_rate)
        self._gate = Gate(BoundedSessions(StreamableHTTPASGIApp(self._sessions)), limits, let_in)
        endpoint: ASGIApp = self._gate
        if authentication is not None:  # before the gate: a stranger takes up no room there, and their body is not read
            endpoint = RequireAuthMiddleware(endpoint, [READ_SCOPE], authentication.metadata_url)
        self._readiness = _Readiness(self._gate, server)
        routes = [
            Route(PATH, endpoint=endpoint),
            Route("/health", endpoint=_health, methods=["GET"]),
            Route("/ready", endpoint=self._readiness.answer, methods=["GET"]),
            *(authentication.routes() if authentication is not None else ()),
            *(pages.routes() if pages is not None else ()),
        ]
        middleware = authentication.middleware() if authentication is not None else []
        if pages is not None:
            middleware.append(Middleware(TrustedHostMiddleware, allowed_hosts=list(_LOOPBACK_NAMES[:2])))
        proxies = list(settings.http_proxies)
        self._application, self._pages = Starlette(routes=routes, middleware=middleware), pages
        config = uvicorn.Config(
            self._application,
            lifespan="off",
            ws="none",
            log_config=None,
            http=cast("type[asyncio.Protocol]", Connections(ConnectionLimits.for_descriptors()).protocol),
            access_log=False,
            server_header=False,
            proxy_headers=bool(proxies),
            forwarded_allow_ips=proxies,
            timeout_keep_alive=KEEP_ALIVE_S,
            timeout_graceful_shutdown=round(_CONNECTIONS_END_S),
        )
        self._uvicorn = _Uvicorn(config, self._gate, settings.http_stop_s)

    async def serve(self, listener: socket.socket) -> None:
        """Serve until ``stop`` or a signal; write the address to standard error.

        Raises:
            PlannerForgeError: the services of the tools cannot be opened.
        """
        with calm_logs():
            await self._serve(listener)

    async def _serve(self, listener: socket.socket) -> None:
        async with self._sessions.run():
            host, port = listener.getsockname()[:2]
            name = f"[{host}]" if ":" in host else host
            url = f"http://{name}:{port}"
            sys.stderr.write(f"PlannerForge: MCP at {url}{PATH}\n")
            sys.stderr.flush()
            async with AsyncExitStack() as stack:
                if self._pages is not None:
                    await stack.enter_async_context(self._pages.connected(self._application, url + PATH))
                await self._uvicorn.serve(sockets=[listener])

    def stop(self) -> None:
        """Let calls in progress end, then stop."""
        self._uvicorn.should_exit = True


class _Readiness:
    """Checks whether requests are accepted and the workspace can be read, at most once a second.

    Args:
        gate: accepts requests.
        server: reads the workspace.
    """

    def __init__(self, gate: Gate, server: PlannerForgeServer) -> None:
        self._gate, self._server = gate, server
        self._looking = anyio.Lock()
        self._can_read, self._looked_at = False, -math.inf

    async def answer(self, request: Request) -> JSONResponse:
        """Return status 200 if the server is ready, otherwise 503."""
        del request
        is_ready = self._gate.is_open and await self._reads() and self._gate.is_open
        if is_ready:
            return JSONResponse({"status": "ready"})
        return JSONResponse({"status": "not ready"}, 503, {"retry-after": str(math.ceil(READY_KEPT_S))})

    async def _reads(self) -> bool:
        async with self._looking:
            if time.monotonic() - self._looked_at > READY_KEPT_S:
                self._can_read = await self._server.is_ready()
                self._looked_at = time.monotonic()
        return self._can_read


async def _health(request: Request) -> JSONResponse:
    """Report that the process is alive."""
    del request
    return JSONResponse({"status": "ok"})


@dataclass(frozen=True)
class _Authentication:
    """The check of tokens and, with an OAuth authorization server, the metadata that lead clients to it."""

    verifier: TokenVerifier
    settings: AuthSettings | None

    @classmethod
    def of(cls, settings: Settings) -> "_Authentication | None":
        """Return the authentication that the settings require, or None if everyone on this machine has access."""
        tokens = tokens_of(settings.http_tokens, settings.http_token_file)
        if not settings.oauth_issuer:
            return cls(OwnTokens(tokens), None) if tokens else None
        if not settings.http_url:
            raise InvalidRequest(
                "oauth_issuer is set but http_url, the required audience of tokens, is not",
                next_step="set http_url to the address that clients use, such as https://forge.example.org/mcp",
            )
        oauth = AuthSettings(
            issuer_url=_as_written(settings.oauth_issuer),
            resource_server_url=AnyHttpUrl(settings.http_url),
            required_scopes=[READ_SCOPE],
            validate_token_resource=True,
        )
        issued = IssuedTokens(settings.oauth_issuer, settings.http_url, settings.oauth_keys_url)
        return cls(EitherTokens(OwnTokens(tokens, settings.http_url), issued), oauth)

    @property
    def metadata_url(self) -> AnyHttpUrl | None:
        """The address at which a refused client finds the accepted authorization servers (RFC 9728)."""
        if self.settings is None or self.settings.resource_server_url is None:
            return None
        return build_resource_metadata_url(self.settings.resource_server_url)

    def middleware(self) -> list[Middleware]:
        """Return the middleware that reads each request's token and checks its audience."""
        audience = self.settings.resource_server_url if self.settings is not None else None
        backend = BearerAuthBackend(self.verifier, resource_server_url=audience)
        return [Middleware(AuthenticationMiddleware, backend=backend), Middleware(AuthContextMiddleware)]

    def routes(self) -> list[Route]:
        """Return the metadata of this server as a resource."""
        if self.settings is None or self.settings.resource_server_url is None:
            return []
        return create_protected_resource_routes(
            resource_url=self.settings.resource_server_url,
            authorization_servers=[self.settings.issuer_url],
            scopes_supported=[READ_SCOPE, WRITE_SCOPE],
            resource_name="PlannerForge",
        )


def _as_written(url: str) -> AnyHttpUrl:
    """Return a URL without an added slash: clients compare issuers character by character (RFC 8414, section 3.3)."""
    adapter = TypeAdapter(AnyHttpUrl, config=ConfigDict(url_preserve_empty_path=True))
    return adapter.validate_python(url)


def _accepted_headers(settings: Settings) -> TransportSecuritySettings:
    """Return the accepted Host and Origin headers: of this machine, of the bound address, and those in the settings.

    Raises:
        InvalidRequest: every address of the machine is bound, but the settings give no name for it.
    """
    hosts = [*_LOOPBACK_NAMES, *settings.http_hosts]
    origins = [f"http://{name}" for name in _LOOPBACK_NAMES]
    if settings.http_url:
        url = AnyHttpUrl(settings.http_url)
        hosts.append(str(url.host))
        origins.append(f"{url.scheme}://{url.host}")
    if settings.http_host not in _ANY_ADDRESS:
        bound = settings.http_host
        hosts.append(f"[{bound}]" if ":" in bound else bound)
    elif not settings.http_hosts and not settings.http_url:
        raise InvalidRequest(
            f"http_host {settings.http_host} is every address of this machine, but the settings give no name for it",
            next_step="add its name to http_hosts, or set http_url; requests with another Host are refused",
        )
    return TransportSecuritySettings(
        enable_dns_rebinding_protection=True,
        allowed_hosts=[form for host in dict.fromkeys(hosts) for form in (host, f"{host}:*")],
        allowed_origins=[form for one in (*origins, *settings.http_origins) for form in (one, f"{one}:*")],
    )


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


class _Uvicorn(uvicorn.Server):
    """Uvicorn with a shutdown that waits for calls in progress; a second signal ends the wait."""

    def __init__(self, config: uvicorn.Config, gate: Gate, patience_s: float) -> None:
        super().__init__(config)
        self._gate, self._patience_s = gate, patience_s

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Stop at a signal with exit code 0; uvicorn would raise the signal again at the end."""
        del sig, frame
        self.force_exit = self.should_exit
        self.should_exit = True

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Close the gate, then the connections, then the server with its jobs and workers."""
        await self._gate.close(0.0 if self.force_exit else self._patience_s)
        await super().shutdown(sockets)


def serve_http(
    server: PlannerForgeServer,
    settings: Settings,
    pages: "Pages | None" = None,
    when_bound: Callable[[int], None] | None = None,
) -> None:
    """Serve until a signal ends it; call ``when_bound`` with the port.

    Raises:
        PlannerForgeError: the settings do not allow serving, the port is in use, or the services cannot be opened.
    """
    made = HttpServer(server, settings, pages)
    with bound(settings.http_host, settings.http_port) as listener:
        if when_bound is not None:
            when_bound(listener.getsockname()[1])
        anyio.run(made.serve, listener)


def bound(host: str, port: int) -> socket.socket:
    """Return a listening socket.

    Raises:
        InvalidRequest: the address does not belong to this machine, or the port is in use.
    """
    listener: socket.socket | None = None
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        # with an explicit protocol; otherwise asyncio leaves Nagle's algorithm on, and each answer waits 40 ms for an
        # acknowledgement
        listener = socket.socket(family, kind, protocol or socket.IPPROTO_TCP)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
        listener.listen(_BACKLOG)
    except OSError as error:
        if listener is not None:
            listener.close()
        raise InvalidRequest(
            f"http_host {host} and http_port {port} cannot be bound: {error.strerror or error}",
            next_step="choose another http_port; 0 picks a free one",
        ) from error
    return listener
