"""``plannerforge ui``: serves the workspace as web pages to all users of this machine."""

import sys
import webbrowser

from ..engine.execution import hide_environment, share_heaps
from ..server.assembly import create_server
from ..server.http.pages.application import ROOT, Pages
from ..server.http.serving import serve_http
from ..server.observing.journal import JOURNAL
from ..server.settings import Settings
from .view import has_screen

_HERE = "127.0.0.1"


def serve_pages(settings: Settings, *, open_it: bool) -> None:
    """Serve until a signal arrives; print the address, and open it if there is a screen and ``open_it`` is set.

    The pages need no token, so the settings for ``serve --http`` do not apply. The pages listen only on this machine,
    and a web page that is allowed to make calls with a token is not allowed to make calls here without a token.

    Raises:
        PlannerForgeError: The port is taken, or the workspace cannot be opened.
    """
    own = settings.model_copy(
        update={
            "http_host": _HERE,
            "http_url": "",
            "http_hosts": (),
            "http_origins": (),
            "http_proxies": (),
            "http_tokens": (),
            "http_token_file": None,
            "oauth_issuer": "",
        }
    )

    def announce(port: int) -> None:
        url = f"http://{_HERE}:{port}{ROOT}"
        sys.stdout.write(f"{url}\n")
        sys.stdout.flush()
        if open_it and has_screen():
            webbrowser.open(url)  # the socket already listens, so the browser waits for the first answer

    hide_environment()
    share_heaps()
    serve_http(create_server(own), own, Pages(own.workspace.expanduser() / JOURNAL), announce)
