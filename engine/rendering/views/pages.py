"""The pages of views: one HTML file each, style and scripts inside, no request to elsewhere.

This module imports nothing heavy: the server hands the empty pages to MCP hosts, and fills them with data that workers
wrote.
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
"""The scripts of each page, in the order in which they are read; a later one uses what an earlier one names.

A board opens its runs in a player, so its page shows whatever there is to show.
"""


def empty_page(kind: ViewKind) -> str:
    """The page without data, which asks the host that shows it; the host sets the policy for it."""
    return _page(kind, title="PlannerForge", data="", policy="")


def filled_page(kind: ViewKind, title: str, data: str) -> str:
    """The page with its data, a JSON text; it runs the page's own script alone, by its hash, and loads nothing."""
    digest = base64.b64encode(hashlib.sha256(_scripts(kind).encode()).digest()).decode()
    policy = (
        '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; '
        f"script-src 'sha256-{digest}'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'\">"
    )
    return _page(kind, title=title, data=escaped(data), policy=policy)


def escaped(data: str) -> str:
    """A JSON text that no parser of HTML ends, opens or comments anything in; it reads as the same JSON."""
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
    # In one pass: what is put in may itself look like a place to fill.
    return re.sub(r"\{\{ (\w+) \}\}", lambda place: parts[place[1]], _part("page.html"))


def _scripts(kind: ViewKind) -> str:
    return "\n" + "\n".join(_part(name) for name in _SCRIPTS[kind])


def _part(name: str) -> str:
    return files("plannerforge.engine.rendering.views").joinpath(name).read_text(encoding="utf-8")
