"""The installed Chromium, driven by Playwright: pages with their logs and requests, and their frames."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from playwright import sync_api as playwright

_PROGRAMS = ("chromium", "chromium-browser", "google-chrome")
_GUARD_S = 120.0
"""A page that does not answer for this long hangs."""
BrowserFault = playwright.Error
"""A script threw, the browser refused a command, it ended, or something did not come true in time."""


def find_chromium() -> str | None:
    """Return the program, or None if it is not installed."""
    return next(filter(None, map(shutil.which, _PROGRAMS)), None)


class Box(NamedTuple):
    """The position of an element, in CSS pixels of the whole page."""

    left: float
    top: float
    width: float
    height: float

    def point(self, share: float = 0.5) -> tuple[float, float]:
        """Return a point at half its height and a share of its width."""
        return self.left + share * self.width, self.top + self.height / 2


class Frame:
    """A frame of a page: scripts are its own, points and keys those of the page."""

    def __init__(self, frame: playwright.Frame) -> None:
        self._frame, self.keyboard, self.mouse = frame, frame.page.keyboard, frame.page.mouse

    def value(self, expression: str) -> Any:
        """Return an expression's value, awaiting a promise.

        Raises:
            BrowserFault: it threw.
        """
        return self._frame.evaluate(expression)

    def wait_for(self, expression: str) -> None:
        """Wait until an expression is true; the page itself checks it at each frame."""
        self.value(f"(async () => {{ while (!({expression})) await new Promise(requestAnimationFrame); }})()")

    def comes_true(self, expression: str, within_s: float) -> bool:
        """Return True if an expression becomes true within some time; one that throws is not true yet."""
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
        """Return the position of a selector's first element in the whole page, once earlier requests are drawn."""
        self.value("(async () => { for (const _ of [1, 2]) await new Promise(requestAnimationFrame); })()")
        found = self._frame.locator(selector).first.bounding_box()
        if found is None:
            raise BrowserFault(f"{selector} is not shown")
        return Box(found["x"], found["y"], found["width"], found["height"])

    def press(self, key: str) -> None:
        """Press and release a key."""
        self.keyboard.press(key)

    def click(self, x: float, y: float) -> None:
        """Click at a point in CSS pixels."""
        self.mouse.click(x, y)

    def move(self, x: float, y: float) -> None:
        """Move the pointer there."""
        self.mouse.move(x, y)


class Page(Frame):
    """One page of the browser, with a size in CSS pixels.

    ``errors``: exceptions and errors of its scripts, and loads that the browser refused; ``requests``: its loads.
    """

    def __init__(self, page: playwright.Page) -> None:
        super().__init__(page.main_frame)
        self._page = page
        self.errors: list[str] = []
        self.requests: list[str] = []
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("console", self._note)
        page.on("request", lambda request: self.requests.append(request.url))

    def _note(self, message: playwright.ConsoleMessage) -> None:
        if message.type == "error":
            self.errors.append(f"{message.text} {message.location.get('url', '')}".strip())

    def frame(self, depth: int) -> Frame:
        """Return the first frame in the page; the first frame in that, for each further step of depth."""
        found = self._page.main_frame
        for _ in range(depth):
            found = found.child_frames[0]
        return Frame(found)

    def picture(self) -> bytes:
        """Return a picture of its full height, as PNG."""
        width, height = self.value("[innerWidth, Math.min(Math.ceil(document.body.scrollHeight), innerHeight)]")
        return self._page.screenshot(clip={"x": 0, "y": 0, "width": width, "height": height})

    def close(self) -> None:
        """Close the page."""
        self._page.context.close()


class Browser:
    """A running Chromium."""

    def __init__(self, browser: playwright.Browser) -> None:
        self._browser = browser

    def open(self, url: str, width: int = 1280, height: int = 800, scheme: Any = "light") -> Page:
        """Return a new page with a URL, once it is loaded."""
        context = self._browser.new_context(viewport={"width": width, "height": height}, color_scheme=scheme)
        context.set_default_timeout(1000 * _GUARD_S)
        opened = context.new_page()
        page = Page(opened)
        opened.goto(url)
        return page


@contextmanager
def chromium() -> Iterator[Browser]:
    """Start the installed browser, and close it with the block.

    Raises:
        BrowserFault: it is not installed.
    """
    program = find_chromium()
    if program is None:
        raise BrowserFault(f"none of {', '.join(_PROGRAMS)} is installed")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=Path(program), args=["--no-sandbox", "--disable-dev-shm-usage"]
        )
        try:
            yield Browser(browser)
        finally:
            browser.close()
