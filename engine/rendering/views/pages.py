"""The pages of views: one HTML file each with style and scripts, without any external request.

This module imports nothing heavy: the server gives the empty pages to MCP hosts, and fills them with the workers' data.
"""

import base64
import hashlib
import html
import re
from collections.abc import Sequence
from importlib.resources import files

from ....schemas.rendering import ViewKind

_SCRIPTS: dict[ViewKind, Sequence[str]] = {
    "player": ("scene.js", "player.js", "host.js"),
    "board": ("scene.js", "player.js", "board.js", "host.js"),
}
"""The scripts of each page in loading order; later ones use names of earlier ones.

A board opens its runs in a player, so its page can show both.
"""


def empty_page(kind: ViewKind) -> str:
    """Return a view's page without data; the page requests them from its host, which also sets the page's policy."""
    return _page(kind, title="PlannerForge", data="", policy="")


def filled_page(kind: ViewKind, title: str, data: str) -> str:
    """Return the page with its data, a JSON text.

    A hash allows only the page's own script to run, and the page loads nothing."""
    digest = base64.b64encode(hashlib.sha256(_scripts(kind).encode()).digest()).decode()
    policy = (
        '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; '
        f"script-src 'sha256-{digest}'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'\">"
    )
    return _page(kind, title=title, data=escaped(data), policy=policy)


def escaped(data: str) -> str:
    """Escape a JSON text so that no HTML parser sees markup in it; it stays the same JSON."""
    for sign in "<>&\u2028\u2029":
        data = data.replace(sign, f"\\u{ord(sign):04x}")
    return data


def _page(kind: ViewKind, *, title: str, data: str, policy: str) -> str:
    parts = {
        "policy": policy,
        "title": html.escape(title),
        "style": _part("view.css"),
        "data": data,
        "scripts": _scripts(kind),
    }
    # In one pass, since the inserted text may itself look like a placeholder.
    return re.sub(r"\{\{ (\w+) \}\}", lambda place: parts[place[1]], _part("page.html"))


def _scripts(kind: ViewKind) -> str:
    return "\n" + "\n".join(_part(name) for name in _SCRIPTS[kind])


def _part(name: str) -> str:
    return files("plannerforge.engine.rendering.views").joinpath(name).read_text(encoding="utf-8")
