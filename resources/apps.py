"""MCP Apps: a host with the extension shows the answers of several tools in pages with views.

A tool refers to its page (``_meta.ui.resourceUri``), and an answer to the view on that page (``VIEW_KEY`` in its
``_meta``). The page reads the view's data as a resource through the host, so they never pass through the model. Hosts
without the extension get the same answers without that reference.

The code for pages and views is imported at the first request, so that the server's first answer does not wait for it.
"""

import re
from collections.abc import Sequence
from functools import partial
from typing import Literal

from mcp.server.apps import Apps
from mcp.server.mcpserver.resources import FunctionResource
from mcp.types import ResourceTemplate

from ..engine.workspace import VIEWED_KINDS, Workspace
from .templates import SCHEME

VIEW_KEY = "plannerforge/view"
"""The key of the URI of an answer's view in its ``_meta``."""
PAGES = "ui://plannerforge/"
PageKind = Literal["player", "board"]
_TITLES: dict[PageKind, str] = {"player": "Scenario and run player", "board": "Board of runs"}
_MOST_NAMED = 20
"""How many ids the URI of a view may have (chosen): more are runs without a batch, too many to view one by one."""
_MOST_COMPLETED = 300
"""How many of the newest artifacts per kind complete the ids of a view (chosen)."""
VIEW_TEMPLATE = ResourceTemplate(
    uri_template=f"{SCHEME}view/{{ids}}",
    name="view",
    title="View",
    description="Data for the MCP Apps pages: a scenario or run, two joined by +, or a batch",
    mime_type="application/json",
)


def page_uri(kind: PageKind) -> str:
    """Return the URI of a page."""
    return f"{PAGES}{kind}.html"


def view_uri(ids: Sequence[str]) -> str | None:
    """Return the URI of a view's data; None if there are no ids, or too many."""
    return f"{SCHEME}view/{'+'.join(ids)}" if 1 <= len(ids) <= _MOST_NAMED else None


def viewed_ids(uri: str) -> list[str]:
    """Return the ids in the URI of a view's data; empty if the URI is not that of a view."""
    plain = uri.replace("%2B", "+")  # encoded as clients fill in a template
    match = re.fullmatch(rf"{re.escape(SCHEME)}view/([\w.\-]+(?:\+[\w.\-]+){{0,{_MOST_NAMED - 1}}})", plain)
    return match[1].split("+") if match else []


def completed_views(typed: str, workspace: Workspace) -> list[str]:
    """Return the ids for a view that complete the last id typed, ignoring case; newest first."""
    before, plus, last = typed.rpartition("+")
    stored = [artifact for kind in VIEWED_KINDS for artifact in workspace.newest(kind=kind, limit=_MOST_COMPLETED)]
    newest = sorted(stored, key=lambda artifact: -artifact.sequence)
    begun = [artifact.artifact_id for artifact in newest if artifact.artifact_id.casefold().startswith(last.casefold())]
    return [f"{before}{plus}{artifact_id}" for artifact_id in begun]


def pages() -> Apps:
    """Return the extension with its two pages, which are built when a host reads them."""
    apps = Apps()
    for kind, title in _TITLES.items():
        apps.add_resource(
            FunctionResource(
                uri=page_uri(kind),
                name=kind,
                title=title,
                mime_type="text/html;profile=mcp-app",
                meta={"ui": {"prefersBorder": True}},
                fn=partial(_page, kind),
            )
        )
    return apps


def _page(kind: PageKind) -> str:
    from ..engine.rendering import empty_page

    return empty_page(kind)
