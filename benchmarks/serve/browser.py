"""A headless Chromium in which pages are opened, keys pressed and clicks made: DevTools protocol on two pipes."""

import base64
import json
import os
import shutil
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, cast

_PROGRAMS = ("chromium", "chromium-browser", "google-chrome")
_FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--remote-debugging-pipe",
)
_GUARD_S = 120.0
"""A browser that does not answer for so long hangs: it is killed, so that who asked does not hang as well."""
_KEYS = {" ": ("Space", 32), "ArrowLeft": ("ArrowLeft", 37), "ArrowRight": ("ArrowRight", 39), "Enter": ("Enter", 13)}


class BrowserFault(Exception):
    """A script threw, the browser refused a command, or it ended."""


def find_chromium() -> str | None:
    """The program; None where it is not installed."""
    return next(filter(None, map(shutil.which, _PROGRAMS)), None)


class Box(NamedTuple):
    """Where an element is, in CSS pixels of the whole page."""

    left: float
    top: float
    width: float
    height: float

    def point(self, share: float = 0.5) -> tuple[float, float]:
        """A point at half its height and a share of its width."""
        return self.left + share * self.width, self.top + self.height / 2


class Page:
    """One page of the browser, of a size in CSS pixels.

    ``errors``: what its scripts threw or logged as errors and what the browser refused it, ``requests``: its loads,
    ``contexts``: where scripts of each of its frames run.
    """

    def __init__(self, browser: "Browser", session: str) -> None:
        self._browser, self._session = browser, session
        self.errors: list[str] = []
        self.requests: list[str] = []
        self.contexts: dict[str, int] = {}

    def call(self, method: str, **parameters: Any) -> Any:
        """A command of the DevTools protocol."""
        return self._browser.call(method, parameters, self._session)

    def value(self, expression: str) -> Any:
        """What an expression is, once a promise that it may be has come true.

        Raises:
            BrowserFault: it threw.
        """
        return self._value(expression, {})

    def _value(self, expression: str, where: dict[str, Any]) -> Any:
        answer = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True, **where)
        if "exceptionDetails" in answer:
            raise BrowserFault(str(answer["exceptionDetails"]))
        return answer["result"].get("value")

    def wait_for(self, expression: str) -> None:
        """Until an expression is true; the page itself looks, once a frame."""
        self.value(f"(async () => {{ while (!({expression})) await new Promise(requestAnimationFrame); }})()")

    def comes_true(self, expression: str, within_s: float) -> bool:
        """Whether an expression is true within some time; one that throws is not yet."""
        looks = f"(() => {{ try {{ return Boolean({expression}); }} catch {{ return false; }} }})()"
        pause = "await new Promise(look => setTimeout(look, 20))"
        ended = f"performance.now() > begun + {1000 * within_s}"
        return bool(
            self.value(
                f"(async () => {{ const begun = performance.now(); "
                f"while (!{looks}) {{ if ({ended}) return false; {pause}; }} return true; }})()"
            )
        )

    def box(self, selector: str) -> Box:
        """Where the first element that a selector finds is, once what was asked of the page before is drawn."""
        box = f"document.querySelector({json.dumps(selector)}).getBoundingClientRect()"
        drawn = "for (const _ of [1, 2]) await new Promise(requestAnimationFrame);"
        look = f"const {{ left, top, width, height }} = {box}; return [left, top, width, height];"
        return Box(*self.value(f"(async () => {{ {drawn} {look} }})()"))

    def frame(self, depth: int) -> "Frame":
        """The first frame in the page; the first frame in that, for each further step of depth."""
        tree, found = self.call("Page.getFrameTree")["frameTree"], self
        for _ in range(depth):
            tree = tree["childFrames"][0]
            found = Frame(self, found, tree["frame"]["id"])
        return cast("Frame", found)

    def close(self) -> None:
        """Close the page."""
        self.call("Page.close")

    def picture(self) -> bytes:
        """What is seen of it as far down as it goes, as PNG."""
        width, height = self.value("[innerWidth, Math.min(Math.ceil(document.body.scrollHeight), innerHeight)]")
        clip = {"x": 0, "y": 0, "width": width, "height": height, "scale": 1}
        return base64.b64decode(self.call("Page.captureScreenshot", format="png", clip=clip)["data"])

    def press(self, key: str) -> None:
        """Press and release a key."""
        code, number = _KEYS.get(key, (f"Key{key.upper()}", ord(key.upper()[0])))
        text = {"text": key} if len(key) == 1 else {}
        parts = {"key": key, "code": code, "windowsVirtualKeyCode": number}
        self.call("Input.dispatchKeyEvent", type="keyDown", **parts, **text)
        self.call("Input.dispatchKeyEvent", type="keyUp", **parts)

    def click(self, x: float, y: float) -> None:
        """Click at a point in CSS pixels."""
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)

    def move(self, x: float, y: float) -> None:
        """Move the pointer there."""
        self.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)


class Frame(Page):
    """A frame in a page, of the same site as the page: points and keys are those of the page, scripts the frame's own.

    It has no border.
    """

    def __init__(self, page: Page, above: Page, frame_id: str) -> None:
        super().__init__(page._browser, page._session)
        self.errors, self.requests, self.contexts = page.errors, page.requests, page.contexts
        self._above, self._frame_id = above, frame_id

    def value(self, expression: str) -> Any:
        """What an expression is in the frame, once a promise that it may be has come true.

        Raises:
            BrowserFault: it threw.
        """
        return self._value(expression, {"contextId": self.contexts[self._frame_id]})

    def box(self, selector: str) -> Box:
        """Where the first element that a selector finds is in the whole page, once what was asked before is drawn."""
        box, window = super().box(selector), self._above.box("iframe")
        return box._replace(left=window.left + box.left, top=window.top + box.top)


class Browser:
    """A running Chromium."""

    def __init__(self, process: subprocess.Popen[bytes], incoming: int, outgoing: int) -> None:
        self._process, self._in, self._out = process, os.fdopen(incoming, "rb"), os.fdopen(outgoing, "wb")
        self._count, self._pages, self._rest = 0, dict[str, Page](), b""

    def open(self, url: str, width: int = 1280, height: int = 800, scheme: str = "light") -> Page:
        """A new page with a URL, once it is loaded."""
        target = self.call("Target.createTarget", {"url": "about:blank"})["targetId"]
        session = self.call("Target.attachToTarget", {"targetId": target, "flatten": True})["sessionId"]
        page = self._pages[session] = Page(self, session)
        for domain in ("Runtime", "Page", "Network", "Log"):
            page.call(f"{domain}.enable")
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        page.call("Emulation.setDeviceMetricsOverride", **size)
        page.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
        page.call("Page.navigate", url=url)
        page.wait_for("document.readyState === 'complete' && location.href !== 'about:blank'")
        return page

    def call(self, method: str, parameters: dict[str, Any], session: str | None = None) -> Any:
        """A command and its result; what happens meanwhile is noted on the pages.

        Raises:
            BrowserFault: the browser refused, or ended.
        """
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        self._out.write(json.dumps(message | ({"sessionId": session} if session else {})).encode() + b"\0")
        self._out.flush()
        guard = threading.Timer(_GUARD_S, self._process.kill)
        guard.start()
        try:
            while (answer := self._next()).get("id") != self._count:
                self._note(answer)
        finally:
            guard.cancel()
        if "error" in answer:
            raise BrowserFault(f"{method}: {answer['error']}")
        return answer["result"]

    def close(self) -> None:
        """End the browser and its processes."""
        try:
            self.call("Browser.close", {})
        finally:
            self._process.wait(_GUARD_S)
            self._in.close()
            self._out.close()

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            more = self._in.read1(1 << 20)
            if not more:
                raise BrowserFault("the browser ended")
            self._rest += more
        text, _, self._rest = self._rest.partition(b"\0")
        read: dict[str, Any] = json.loads(text)
        return read

    def _note(self, event: dict[str, Any]) -> None:
        page, told = self._pages.get(event.get("sessionId", "")), event.get("params", {})
        if page is None:
            return
        if event["method"] == "Runtime.exceptionThrown":
            page.errors.append(json.dumps(told["exceptionDetails"]))
        elif event["method"] == "Runtime.consoleAPICalled" and told["type"] == "error":
            page.errors.append(" ".join(str(one.get("value", one.get("description"))) for one in told["args"]))
        elif event["method"] == "Log.entryAdded" and told["entry"]["level"] == "error":
            page.errors.append(f"{told['entry']['text']} {told['entry'].get('url', '')}".strip())
        elif event["method"] == "Network.requestWillBeSent":
            page.requests.append(told["request"]["url"])
        elif event["method"] == "Runtime.executionContextCreated" and told["context"]["auxData"].get("isDefault"):
            page.contexts[told["context"]["auxData"]["frameId"]] = told["context"]["id"]


@contextmanager
def chromium(folder: Path) -> Iterator[Browser]:
    """A browser with a profile of its own in a folder; ended with the block.

    Raises:
        BrowserFault: none is installed.
    """
    program = find_chromium()
    if program is None:
        raise BrowserFault(f"none of {', '.join(_PROGRAMS)} is installed")
    to_browser, from_us = os.pipe()
    from_browser, to_us = os.pipe()
    command = [program, *_FLAGS, f"--user-data-dir={folder}", "about:blank"]
    # Chromium reads its descriptor 3 and writes to 4.
    shell = f'exec "$@" 3<&{to_browser} 4>&{to_us}'
    process = subprocess.Popen(
        ["bash", "-c", shell, "chromium", *command],
        pass_fds=(to_browser, to_us),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.close(to_browser)
    os.close(to_us)
    browser = Browser(process, from_browser, from_us)
    try:
        yield browser
    finally:
        browser.close()
