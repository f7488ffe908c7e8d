"""The checks of a page in a host: by clicks and keys, and by the messages over the bridge.

Each check is a description and whether it passes. If a page breaks, the current check fails.
"""

import json
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from ..browser import BrowserFault, Frame, Page

Check = tuple[str, bool]
Checks = Iterator[Check]
_PLAYER = "document.querySelector('.player:not(.board)').player"
_BOARD = "document.querySelector('.board').board"
_SETTLED_MS = 400
_MOST_SIZES = 8
"""Most sizes that a page may report before it settles (chosen): each is a jump of the host's window."""
_DRAWN = (
    "(canvas => new Set(new Uint32Array(canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height)"
    f".data.buffer)).size)({_PLAYER}.panes[0].canvas) > 8"
)
_NO_WIDER = "document.documentElement.scrollWidth <= document.documentElement.clientWidth"
_CLOCK, _TIP = "document.querySelector('.time').innerText", "document.querySelector('.tip')"
_CELLS, _ROWS = "document.querySelectorAll('.list .cell')", "document.querySelectorAll('.grid tbody tr')"
_READS = "host.asked('resources/read')"
_STILL = f"""(() => {{
  const sizes = host.sizes.length;
  if (window.sizesThen !== sizes) {{ window.sizesThen = sizes; window.sizesAt = performance.now(); return false; }}
  return performance.now() - window.sizesAt > {_SETTLED_MS};
}})()"""
_TRACK = """(() => {
  const player = PLAYER, pane = player.panes[0], state = {}, { clientWidth: w, clientHeight: h } = pane.canvas;
  for (const track of pane.tracks.filter(one => WANTED)) {
    if (!track.at(player.moment(pane, track), state)) continue;
    const [x, y] = pane.camera.toPixels(state.x, state.y, w, h);
    if (x < 5 || y < 5 || x > w - 5 || y > h - 5 || player.userAt(pane, x, y)?.track !== track) continue;
    return { id: track.id, kind: track.kind, speed: state.speed.toFixed(1), x, y };
  }
  return null;
})()"""


@dataclass(frozen=True)
class View:
    """A page in a host.

    Args:
        page: the host's.
        frame: the page itself.
        theme: the host's theme.
        keep: stores a picture of the view under a name, or None.
        patience_s: the page's time for something that a user waits for (chosen).
    """

    page: Page
    frame: Frame
    theme: str
    keep: Callable[[str], None] | None = None
    patience_s: float = 4.0

    def comes_true(self, expression: str) -> bool:
        """Return True if a condition becomes true in the page."""
        return self.frame.comes_true(expression, self.patience_s)

    def is_shown(self, expression: str) -> bool:
        """Do the same for a condition that may wait for the server to create a view's data."""
        return self.frame.comes_true(expression, 10 * self.patience_s)

    def host_sees(self, expression: str) -> bool:
        """Return True if a condition becomes true in the host."""
        return self.page.comes_true(expression, self.patience_s)

    def stands_still(self) -> bool:
        """Return True if the page stops reporting new sizes."""
        return self.host_sees(_STILL)

    def pictured(self, name: str) -> None:
        """Store a picture once the view no longer changes."""
        if self.keep is not None:
            self.stands_still()
            self.keep(name)

    def clicks(self, selector: str, share: float = 0.5) -> None:
        """Click at a share of an element's width, in the middle of its height."""
        self.frame.click(*self.frame.box(selector).point(share))

    def presses(self, keys: str) -> None:
        """Press keys that are a letter or sign each."""
        for key in keys:
            self.frame.press(key)


def held(checks: Callable[[View], Checks], view: View) -> list[Check]:
    """Return all checks of a kind on a page; one that the page or the browser broke, as failed."""
    found = list[Check]()
    try:
        for check in checks(view):
            found.append(check)
    except BrowserFault as fault:
        found.append(
            (f"what comes after '{found[-1][0] if found else 'the beginning'}' can be looked at: {fault}", False)
        )
    return found


def arrival(view: View) -> Checks:
    """Check that the page says hello, gets its data over the bridge, uses the host's theme and fits into the host."""
    yield "it is shown", view.is_shown("document.querySelector('.player')")
    hello = "host.received.filter(one => one.message.method === 'ui/initialize').map(one => one.message.params)"
    yield (
        "it says hello once, in the protocol of 2026-01-26",
        view.host_sees(
            f"{hello}.length === 1 && {hello}[0].protocolVersion === '2026-01-26' && host.bridge.getAppVersion().name"
        ),
    )
    yield (
        "its data come as a resource through the bridge",
        view.host_sees(f"{_READS}.some(one => one.params.uri.startsWith('plannerforge://view/') && one.answered)"),
    )
    yield "it has the theme of the host", _has_theme(view, view.theme)
    yield (
        "it reports its size until it settles",
        view.stands_still() and view.host_sees(f"host.sizes.length >= 1 && host.sizes.length <= {_MOST_SIZES}"),
    )
    yield (
        "it fits into its reported height",
        view.comes_true(
            "Math.abs(document.documentElement.scrollHeight - innerHeight) <= 1"
            " && document.body.getBoundingClientRect().height >= innerHeight - 1"
        ),
    )
    yield ("nothing of it is wider than the host", view.comes_true(_NO_WIDER))


def playing(view: View) -> Checks:
    """Check playback by keys, clicks on the slider and the chart."""
    yield "the road is drawn", view.comes_true(_DRAWN)
    view.clicks(".stage figcaption")
    view.frame.press("Home")
    view.frame.press(" ")
    begun = f"{_PLAYER}.firstStep"
    yield "space plays", view.comes_true(f"{_PLAYER}.playing && {_PLAYER}.step > {begun} + 3")
    yield (
        "the button says that it plays",
        view.comes_true("document.querySelector('.transport button').innerText === 'Pause'"),
    )
    view.frame.press(" ")
    yield "space pauses", view.comes_true(f"!{_PLAYER}.playing")
    paused = view.frame.value(f"{_PLAYER}.step")
    view.frame.press("ArrowRight")
    yield "an arrow goes a step on", view.comes_true(f"{_PLAYER}.step === {int(paused)} + 1")
    view.clicks(".scrub input", 0.75)
    share = f"({_PLAYER}.step - {begun}) / ({_PLAYER}.lastStep - {begun})"
    yield "a click on the slider goes there", view.comes_true(f"Math.abs({share} - 0.75) < 0.05")
    view.clicks(".chart canvas", 0.5)
    yield "a click on the chart goes there", view.comes_true(f"Math.abs({share} - 0.5) < 0.1")
    yield (
        "the clock tells the time",
        view.comes_true(f"{_CLOCK}.startsWith(({_PLAYER}.step * {_PLAYER}.stepS).toFixed(1) + ' s of')"),
    )


def looking(view: View) -> Checks:
    """Check that the view follows the ego, survives a change of the window, and uses the host's colours."""
    view.presses("0")
    view.presses("f")
    centred = (
        f"(player => {{ const pane = player.panes[0], state = {{}}; return player.follow"
        " && pane.ego.at(player.moment(pane, pane.ego), state)"
        f" && Math.hypot(pane.camera.x - state.x, pane.camera.y - state.y) < 0.1; }})({_PLAYER})"
    )
    yield "F follows the ego", view.comes_true(centred)
    view.frame.press("End")
    yield "it follows to the end", view.comes_true(centred)
    view.presses("0")
    yield "0 shows all and follows no more", view.comes_true(f"!{_PLAYER}.follow")
    yield "all that matters is in view", view.comes_true(_COVERS)
    width = view.page.value("document.getElementById('box').offsetWidth")
    view.page.value(f"document.getElementById('box').style.width = '{0.6 * width}px'")
    yield (
        "it is still in view in a window of 0.6 of the width",
        view.comes_true(f"innerWidth < {0.7 * width} && {_COVERS}"),
    )
    view.page.value("document.getElementById('box').style.width = ''")
    yield "and in the old one", view.comes_true(f"innerWidth > {0.9 * width} && {_COVERS}")
    other = {"light": "dark", "dark": "light"}[view.theme]
    before = view.frame.value(f"{_PLAYER}.colours.road")
    view.page.value(f"host.change({{ theme: '{other}' }})")
    yield (
        f"it turns {other} with the host",
        _has_theme(view, other) and view.comes_true(f"{_PLAYER}.colours.road !== {json.dumps(before)}"),
    )
    view.page.value(f"host.change({{ theme: '{view.theme}' }})")
    yield f"and {view.theme} again", _has_theme(view, view.theme)
    view.presses("t")
    yield f"T turns it {other}", _has_theme(view, other)
    view.presses("t")


def choosing(view: View, kind: str = "") -> Checks:
    """Check that a click on a road user, of a given kind if any, shows its data and reports it to the model."""
    view.frame.press("Home")
    view.presses("0+")
    found: Any = None
    for _ in range(8):
        view.comes_true(f"!{_PLAYER}.stale")
        found = view.frame.value(
            _TRACK.replace("PLAYER", _PLAYER).replace("WANTED", f"one.kind === '{kind}'" if kind else "true")
        )
        if found:
            break
        view.presses("-")
        view.frame.press("ArrowRight")
    yield f"there is a {kind or 'road user'} to click on", bool(found)
    if not found:
        return
    left, top, *_ = view.frame.box(".stage canvas")
    view.frame.move(left + found["x"], top + found["y"])
    yield ("the pointer names it", view.comes_true(f"!{_TIP}.hidden && {_TIP}.innerText.includes('{found['id']}')"))
    view.frame.click(left + found["x"], top + found["y"])
    picked = "document.querySelector('.picked').innerText"
    for what in (str(found["id"]), found["kind"].replace("_", " "), f"{found['speed']} m/s", "lanelet"):
        yield f"a click shows {what}", view.comes_true(f"{picked}.includes({json.dumps(what)})")
    yield (
        "the host learns what the user looks at",
        view.host_sees(
            f"host.told.at(-1)?.endsWith('selected: obstacle {found['id']}')"
            " && host.asked('ui/update-model-context').every(one => one.answered)"
        ),
    )
    view.pictured("chosen")
    view.frame.press("Escape")
    yield "escape selects nothing", view.comes_true(f"{picked}.includes('Click a vehicle')")


def driving(view: View) -> Checks:
    """Yield a run shows its figures, its moments and its plans."""
    yield "figures of the run are shown", view.comes_true("document.querySelector('.now').innerText.includes('gap')")
    view.clicks(".moments button")
    yield (
        "a click on an event goes there, and the host learns of it",
        view.host_sees("/^The user looks at run run_.* s$/.test(host.told.at(-1))"),
    )
    picture = f"{_PLAYER}.panes[0].canvas.toDataURL()"
    view.comes_true(f"!{_PLAYER}.stale")
    view.frame.value(f"window.withPlans = {picture}; undefined")
    view.presses("o")
    yield "O hides the plans", view.comes_true(f"!{_PLAYER}.plans && {picture} !== window.withPlans")
    view.presses("o")
    yield "O shows them again", view.comes_true(f"{_PLAYER}.plans && {picture} === window.withPlans")
    view.presses("c")
    yield (
        "C shows another chart",
        view.comes_true(f"{_PLAYER}.chartKind === 1 && document.querySelector('.chart select').selectedIndex === 1"),
    )


def filtering(view: View) -> Checks:
    """Yield the board hides and shows rows by keys and clicks."""
    rows = f"{_ROWS}.length"
    every = view.frame.value(rows)
    yield (
        "there is a row for each scenario and a cell for each run",
        every == view.frame.value(f"{_BOARD}.data.rows.length")
        and view.comes_true(f"{_CELLS}.length === {_BOARD}.data.runs.length"),
    )
    view.clicks(".board h1")
    view.presses("/")
    wanted = str(view.frame.value(f"{_BOARD}.data.rows[0].title"))
    view.presses(wanted)
    yield (
        "a search leaves the rows of its words",
        view.comes_true(
            f"{rows} === 1 && document.querySelector('.grid tbody th').innerText.startsWith({json.dumps(wanted)})"
        ),
    )
    view.frame.press("Escape")
    view.presses("r")
    yield "R shows all again", view.comes_true(f"{rows} === {every}")
    view.presses("x")
    yield (
        "X shows flips alone",
        view.comes_true(
            f"[...{_ROWS}].every(row => row.querySelector('.flip'))"
            f" && {rows} === new Set({_BOARD}.data.runs.filter(run => run.flip).map(run => run.row)).size"
        ),
    )
    view.presses("xg")
    yield "G shows a table", view.comes_true("document.querySelector('.wide tbody tr')")
    yield ("the table scrolls in itself", view.comes_true(_NO_WIDER))
    view.pictured("table")
    view.presses("g")
    view.clicks(".bar button")
    yield "a click on a bar shows its outcome", view.comes_true("document.querySelector('.board select').value !== ''")
    view.presses("r")
    yield "the window does not move", view.stands_still()


def opening(view: View) -> Checks:
    """Yield a run opens in the player, by a click and by a key, with data that the page asks the host for."""
    asked = view.page.value(f"{_READS}.length")
    view.clicks(".list .cell")
    yield "a click opens the run in the player", view.is_shown(f"{_PLAYER}.panes.length === 1")
    run = view.frame.value(f"{_PLAYER}.panes[0].drive.run_id")
    yield (
        "its data come through the bridge",
        view.host_sees(
            f"{_READS}.length === {asked} + 1 && {_READS}.at(-1).answered"
            f" && {_READS}.at(-1).params.uri === 'plannerforge://view/{run}'"
        ),
    )
    yield "the host learns which run", view.host_sees(f"host.told.at(-1)?.includes('{run}')")
    yield "the run is drawn", view.comes_true(_DRAWN)
    yield "the player begins where the window is seen", view.comes_true("scrollY === 0")
    view.frame.press("ArrowRight")
    yield "its keys go by", view.comes_true(f"{_PLAYER}.step === {_PLAYER}.firstStep + 1")
    view.frame.press("Escape")
    yield (
        "escape leads back to the board",
        view.comes_true(
            "document.querySelector('.board').offsetHeight > 0 && document.activeElement.classList.contains('cell')"
        ),
    )
    view.frame.press("ArrowRight")
    view.clicks(".board .side p button:last-of-type")
    yield "a run opens next to that of the first column", view.is_shown(f"{_PLAYER}.panes.length === 2")
    yield ("both fit", view.stands_still() and view.comes_true(_NO_WIDER))
    view.pictured("beside")
    view.frame.press("Escape")
    yield "and the board is back", view.comes_true("document.querySelector('.board').offsetHeight > 0")


def widening(view: View) -> Checks:
    """Check that the stage uses the available height in full screen."""
    stage = "document.querySelector('.stage canvas').clientHeight"
    before = view.frame.value(stage)
    view.page.value(
        "host.change({ displayMode: 'fullscreen', containerDimensions: { height: 1000, maxWidth: innerWidth } })"
    )
    yield "in full screen the stage is higher", view.comes_true(f"innerHeight === 1000 && {stage} > {before} + 50")
    view.pictured("fullscreen")
    view.page.value(
        "host.change({ displayMode: 'inline', containerDimensions: { maxHeight: 6000, maxWidth: innerWidth } })"
    )
    yield "and inline as before", view.comes_true(f"{stage} === {before}")


def appearing(view: View) -> Checks:
    """Check a window that the host hides until there is an answer: it must look as if it had never been hidden."""
    view.page.value("document.getElementById('box').style.display = 'none'")
    result = "host.sent.find(one => one.message.method === 'ui/notifications/tool-result').message.params"
    view.frame.value(f"window.before = {_PLAYER}; undefined")
    view.page.value(f"host.bridge.sendToolResult({result})")
    yield "another answer replaces the view", view.is_shown(f"{_PLAYER} !== window.before")
    near = f"{_PLAYER}.follow && {_PLAYER}.panes[0].camera.scale * FOLLOWED_WIDTH_M >= 0.5 * innerWidth"
    yield "the old view has no listener left", view.comes_true("window.before.ended.signal.aborted")
    view.page.value("document.getElementById('box').style.display = ''")
    yield (
        "what was hidden shows what it shows at first",
        view.comes_true(f"innerWidth > 0 && !{_PLAYER}.stale && {_DRAWN} && ({near} || {_COVERS})"),
    )


def refusing(view: View) -> Checks:
    """Check that answers without a view appear as text, and a later view is shown."""
    said = "document.body.innerText"
    yield "a refusal is shown", view.comes_true(f"{said}.includes('refused')")
    view.page.value("host.bridge.sendToolCancelled({ reason: 'by the user' })")
    yield "so is a call that was cancelled", view.comes_true(f"{said}.includes('cancelled')")
    view.page.value("host.bridge.sendToolResult({ content: [{ type: 'text', text: 'no view' }] })")
    yield "so is an answer without a view", view.comes_true(f"{said}.includes('no view')")
    gone = {"content": [], "_meta": {"plannerforge/view": "plannerforge://view/run_of_another_time"}}
    view.page.value(f"host.bridge.sendToolResult({json.dumps(gone)})")
    yield (
        "so is a view that is not there, in the words of the server",
        view.comes_true(f"{said}.includes('run_of_another_time')"),
    )


def ending(view: View, origins: tuple[str, ...]) -> Checks:
    """Check that the page answers its removal, and that no script failed and nothing was loaded from elsewhere."""
    gone = "host.bridge.teardownResource({}).then(() => { window.tornDown = true; })"
    with suppress(BrowserFault):
        view.page.value(gone)
    yield "it answers when it is taken down", view.host_sees("window.tornDown")
    refused = view.page.value("host.received.filter(one => one.message.error).map(one => one.message.error.message)")
    # A refusal by the server is an answer that the page shows, not a fault of the page.
    errors = [error for error in view.page.errors if not error.endswith(f"{origins[0]}/mcp")]
    faults = [*errors, *view.page.value("host.faults"), *refused]
    yield f"no script and no message failed{''.join(f'; {fault}' for fault in faults)}", not faults
    elsewhere = [url for url in view.page.requests if not url.startswith((*origins, "data:", "about:", "blob:"))]
    yield f"nothing came from elsewhere{''.join(f'; {url}' for url in elsewhere)}", not elsewhere


_SEEN = (
    "(({ camera, canvas }) => [...camera.toWorld(0, canvas.clientHeight, canvas.clientWidth, canvas.clientHeight),"
    f" ...camera.toWorld(canvas.clientWidth, 0, canvas.clientWidth, canvas.clientHeight)])({_PLAYER}.panes[0])"
)
"""The visible range: the lowest x and y, and the highest, in m."""
_COVERS = (
    "((seen, shown) => seen.every(Number.isFinite) && seen[0] <= shown[0] + 0.5 && seen[1] <= shown[1] + 0.5"
    f" && shown[2] - 0.5 <= seen[2] && shown[3] - 0.5 <= seen[3])({_SEEN}, {_PLAYER}.panes[0].scene.shown)"
)
"""Tests whether the visible range contains everything important."""


def _has_theme(view: View, theme: str) -> bool:
    parts = "getComputedStyle(document.body).backgroundColor.match(/\\d+/g).slice(0, 3)"
    is_bright = f"{parts}.reduce((sum, part) => sum + Number(part), 0) > 384"
    is_named = f"document.documentElement.dataset.theme === '{theme}'"
    return view.comes_true(f"{is_named} && ({is_bright}) === {json.dumps(theme == 'light')}")
