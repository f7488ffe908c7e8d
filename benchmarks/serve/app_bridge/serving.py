"""Serves the judge's host: its page, the sandbox of another origin, and a proxy to the MCP server.

A browser lets a page talk only to its own origin, so requests to ``/mcp`` are forwarded to the real server. The sandbox
has the policy that the specification gives for pages that declare nothing: it loads nothing.
"""

import http.client
import threading
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import urlsplit

POLICY = (
    "default-src 'none'; script-src 'self' 'unsafe-inline'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data:; media-src 'self' data:; connect-src 'none'"
)
"""The permissions of a page that declares nothing (MCP Apps of 2026-01-26)."""
_TYPES = {"html": "text/html; charset=utf-8", "js": "text/javascript; charset=utf-8", "json": "application/json"}
_OWN = {"connection", "transfer-encoding", "content-length", "host", "origin", "referer", "keep-alive"}
"""Headers of one connection, which are not forwarded, and those that name the page to the server."""
_TIMEOUT_S = 120.0


@dataclass(frozen=True)
class Host:
    """The addresses of the host's page and the sandbox."""

    url: str
    sandbox: str


@contextmanager
def host(files: Mapping[str, bytes], sandbox: bytes, server_url: str = "") -> Iterator[Host]:
    """Serve a host until the block ends.

    Args:
        files: of the host by name; ``host.html`` is its page.
        sandbox: the page of the sandbox.
        server_url: the address of MCP; empty if the host calls no server.
    """
    with ExitStack() as stack:
        own = stack.enter_context(_listening(files, "", server_url))
        other = stack.enter_context(_listening({"sandbox.html": sandbox}, POLICY, ""))
        yield Host(f"{own}/host.html", f"{other}/sandbox.html")


@contextmanager
def _listening(files: Mapping[str, bytes], policy: str, server_url: str) -> Iterator[str]:
    class Handler(_Handler):
        pass

    Handler.files, Handler.policy, Handler.server_url = files, policy, server_url
    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


class _Handler(BaseHTTPRequestHandler):
    """Returns files, and forwards requests for the server."""

    files: Mapping[str, bytes] = {}
    policy = server_url = ""

    def do_GET(self) -> None:
        name = urlsplit(self.path).path.removeprefix("/")
        if name == "mcp":
            self._pass_on()
            return
        found = self.files.get(name)
        # A browser requests an icon from each origin; a missing icon is not a fault of the page.
        self.send_response(204 if name == "favicon.ico" else 404 if found is None else 200)
        self.send_header("Content-Type", _TYPES.get(name.rpartition(".")[2], "text/plain"))
        if self.policy:
            self.send_header("Content-Security-Policy", self.policy)
        self.end_headers()
        self.wfile.write(found or b"")

    def do_POST(self) -> None:
        self._pass_on()

    def do_DELETE(self) -> None:
        self._pass_on()

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 - the name that the library gives it
        """Say nothing."""

    def _pass_on(self) -> None:
        target = urlsplit(self.server_url)
        size = int(self.headers.get("Content-Length", 0))
        headers = {name: value for name, value in self.headers.items() if name.lower() not in _OWN}
        upstream = http.client.HTTPConnection(target.netloc, timeout=_TIMEOUT_S)
        try:
            upstream.request(self.command, target.path, self.rfile.read(size) if size else None, headers)
            answer = upstream.getresponse()
            self.send_response(answer.status)
            for name, value in answer.getheaders():
                if name.lower() not in _OWN:
                    self.send_header(name, value)
            self.end_headers()
            # A stream of events is passed on as it comes; the end of the connection is its end.
            while part := answer.read1(1 << 16):
                self.wfile.write(part)
                self.wfile.flush()
        except (OSError, http.client.HTTPException):
            self.close_connection = True
        finally:
            upstream.close()
