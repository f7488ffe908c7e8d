"""``plannerforge ui``: the routes of the pages. They only read, accept no requests from other sites, and run no script.

The player and the board are separate pages in a frame, with the policy that pins their script.
"""

from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from importlib.resources import files
from pathlib import Path
from typing import Any

import httpx2
from jinja2 import Environment, PackageLoader, StrictUndefined
from mcp import Client
from mcp.client.streamable_http import streamable_http_client
from mcp.types import Implementation
from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.routing import BaseRoute, Route
from starlette.types import ASGIApp

from .... import __version__
from ....schemas.vocabulary import ORIGINS
from .content import PAGE_SIZE, Content, Facts, Refused

ROOT = "/ui"
_TIMEOUT_S = 120.0
"""Maximum wait for an answer of the server (chosen): no request of a page becomes a job."""
_POLICY = (
    "default-src 'none'; img-src 'self'; style-src 'self'; frame-src 'self'; form-action 'self'; base-uri 'none'; "
    "frame-ancestors 'none'"
)
_HEADERS = {"X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer", "Cache-Control": "no-store"}
_Handler = Callable[["Pages", Request], Awaitable[Response]]


class Pages:
    """The pages of one server, after they are connected to it."""

    def __init__(self, journal: Path) -> None:
        self._journal = journal
        self._content: Content | None = None
        self._templates = Environment(
            loader=PackageLoader("plannerforge.server.http.pages", "."),
            autoescape=True,
            undefined=StrictUndefined,
            trim_blocks=True,
            lstrip_blocks=True,
        )

    @asynccontextmanager
    async def connected(self, endpoint: ASGIApp, url: str) -> AsyncIterator[None]:
        """Act as a client of an MCP endpoint in this process for the duration of the block."""
        transport = httpx2.ASGITransport(app=endpoint)
        name = Implementation(name="plannerforge-ui", version=__version__)
        async with (
            httpx2.AsyncClient(transport=transport, timeout=httpx2.Timeout(_TIMEOUT_S)) as http,
            Client(streamable_http_client(url, http_client=http), client_info=name) as client,
        ):
            self._content = Content(client, self._journal)
            try:
                yield
            finally:
                self._content = None

    def routes(self) -> list[BaseRoute]:
        """Return the routes of the pages."""
        handlers: dict[str, _Handler] = {
            "": Pages.catalogue,
            "/scenario/{artifact_id}": Pages.scenario,
            "/run/{artifact_id}": Pages.run,
            "/batches": Pages.batches,
            "/batch/{artifact_id}": Pages.batch,
            "/comparison": Pages.comparison,
            "/journal": Pages.calls,
            "/picture/{artifact_id}.png": Pages.picture,
            "/view/{kind}/{ids}": Pages.view,
            "/style.css": Pages.style,
        }
        routes: list[BaseRoute] = [Route(ROOT + path, self._answering(handler)) for path, handler in handlers.items()]
        return [Route("/", _to_the_catalogue), *routes]

    def _answering(self, handler: _Handler) -> Callable[[Request], Awaitable[Response]]:
        async def answer(request: Request) -> Response:
            if request.headers.get("sec-fetch-site") == "cross-site":
                return self._page("refused.html.j2", 403, told="Requests from other sites are not allowed.")
            try:
                return await handler(self, request)
            except Refused as refusal:
                return self._page("refused.html.j2", 404, told=str(refusal))

        return answer

    async def catalogue(self, request: Request) -> Response:
        """Return the page of the catalogue: scenarios that match the form's conditions, each with a picture."""
        facts, fault = _facts(request.query_params), ""
        try:
            found = await self._read.scenarios(facts)
        except Refused as refusal:
            found, fault = await self._read.scenarios(Facts()), str(refusal)
        return self._page(
            "catalogue.html.j2", facts=facts, found=found, fault=fault, origins=ORIGINS, page_size=PAGE_SIZE
        )

    async def scenario(self, request: Request) -> Response:
        """Return the page of a scenario: its text, and its motion."""
        shown, text = await self._read.scenario(request.path_params["artifact_id"])
        return self._page("scenario.html.j2", shown=shown, told=text)

    async def run(self, request: Request) -> Response:
        """Return the page of a run, which shows its motion."""
        return self._page("run.html.j2", run_id=request.path_params["artifact_id"])

    async def batches(self, request: Request) -> Response:
        """Return the page of the batches with their rates, newest first."""
        offset = _offset(request.query_params)
        listed = await self._read.artifacts("batch", offset)
        return self._page("batches.html.j2", listed=listed, offset=offset, page_size=PAGE_SIZE)

    async def batch(self, request: Request) -> Response:
        """Return the page of a batch: its board, its analysis, and the comparison of its configurations."""
        batch_id = request.path_params["artifact_id"]
        analysis = await self._read.analysis(batch_id)
        comparison = await self._read.comparison([batch_id])
        return self._page("batch.html.j2", batch_id=batch_id, analysis=analysis, comparison=comparison)

    async def comparison(self, request: Request) -> Response:
        """Return the page that compares two batches."""
        results = [one for one in request.query_params.getlist("of") if one]
        text = await self._read.comparison(results)
        return self._page("comparison.html.j2", results=results, told=text)

    async def calls(self, request: Request) -> Response:
        """Return the page of the journal of calls."""
        failed_only = request.query_params.get("failed") == "yes"
        lines = self._read.calls(failed_only=failed_only)
        return self._page("journal.html.j2", lines=lines, failed_only=failed_only)

    async def picture(self, request: Request) -> Response:
        """Return a picture of a scenario from above."""
        png = await self._read.picture(request.path_params["artifact_id"])
        headers = {**_HEADERS, "Cache-Control": "private, max-age=3600"}
        return Response(png, media_type="image/png", headers=headers)

    async def view(self, request: Request) -> Response:
        """Return the player or the board; only a page of this server may frame it."""
        kind, ids = request.path_params["kind"], request.path_params["ids"].split("+")
        page = await self._read.view(kind, ids)
        return HTMLResponse(page, headers={**_HEADERS, "Content-Security-Policy": "frame-ancestors 'self'"})

    async def style(self, request: Request) -> Response:
        """Return the style of the pages."""
        del request
        style = files("plannerforge.server.http.pages").joinpath("style.css").read_bytes()
        return Response(style, media_type="text/css", headers=_HEADERS)

    @property
    def _read(self) -> Content:
        if self._content is None:
            raise Refused("The server is starting or stopping; reload the page.")
        return self._content

    def _page(self, template: str, status: int = 200, **shown: Any) -> HTMLResponse:
        text = self._templates.get_template(template).render(root=ROOT, version=__version__, **shown)
        return HTMLResponse(text, status, headers={**_HEADERS, "Content-Security-Policy": _POLICY})


def _facts(query: Mapping[str, str]) -> Facts:
    names = ("text", "obstacles", "features", "road_net", "ego_speed", "origin")
    return Facts(**{name: query.get(name, "") for name in names}, offset=_offset(query))


def _offset(query: Mapping[str, str]) -> int:
    written = query.get("offset", "0")
    return int(written) if written.isdecimal() and len(written) < 9 else 0


async def _to_the_catalogue(request: Request) -> Response:
    del request
    return RedirectResponse(ROOT)
