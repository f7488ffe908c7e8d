"""The pages of views in the bridge of MCP Apps hosts, with clicks and keys in a headless Chromium.

Keys:

- ``bridge_views``: pages shown (a generated scenario, a recorded one, one with pedestrians, a run, a board, a refusal;
  each in two widths, dark and light).
- ``bridge_checks``: checks made; ``bridge_failed``: failed checks, each listed on standard error.
- ``bridge_read_ms``: median time from the tool's answer to the view's data, both at the bridge; ``bridge_made_ms``: the
  longest, for a view that did not exist before (-1 if no view was read).
- ``bridge_version`` of ``@modelcontextprotocol/ext-apps``.

``AppBridge`` with its ``PostMessageTransport`` comes from npm, as does the client that connects the host's page to a
real PlannerForge server over HTTP; both have pinned versions and are bundled by esbuild. A host of protocol revision
2026-07-28 shows the light pages, one of 2025-11-25 the dark ones. The page runs in a sandbox of another origin with the
policy of the specification (``serving.py``); ``checks.py`` holds the checks.

``--pictures FOLDER`` keeps a picture of each page; ``--node`` selects an installed Node 20 or newer.
"""

import json
import shutil
import statistics
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import anyio
from mcp import Client

from ...faults.http_process import http_client, http_process
from ...harness import Figures, LeftOut, ask, ask_to_the_end, shared_scenarios
from ..bench import ServeBench
from ..browser import Browser, BrowserFault, Frame, Page, chromium, find_chromium
from ..node import node_in
from . import checks
from .checks import Check, View
from .serving import Host, host

BRIDGE = "2.0.4"
_PACKAGES = (
    f"@modelcontextprotocol/ext-apps@{BRIDGE}",
    "@modelcontextprotocol/client@2.4.0",
    "@modelcontextprotocol/core@2.4.0",
    "@modelcontextprotocol/server@2.4.0",
    "zod@4.6.7",
    "esbuild@0.28.2",
)
_RECORDED = "USA_Lanker-1_1_T-1"
_OTHERS = ("USA_US101-3_3_T-1", "DEU_Lohmar-13_1_T-1")
"""Public recordings: one to view, two more for a board."""
_WIDTHS, _HEIGHT = (1280, 420), 2600
"""A full-width window and a side bar, so high that all of a page is in view (chosen)."""
_MODES = {"light": "auto", "dark": "legacy"}
"""How the client of each theme's host finds the protocol's revision."""


@dataclass(frozen=True)
class Case:
    """A tool call and its page.

    Args:
        name: of the case.
        tool: the called tool.
        input: its arguments.
        kind: of the road user to click on; empty for any.
    """

    name: str
    tool: str
    input: Mapping[str, Any]
    kind: str = ""


def measure(bench: ServeBench) -> Figures:
    """Fetch the bridge, serve, show each page, click."""
    if find_chromium() is None:
        raise LeftOut("Chromium is not installed")
    folder = bench.folder("bridge")
    script = bundle(folder, bench.node)
    counted, failed, read_ms = 0, list[str](), list[float]()
    with http_process(folder) as server:
        cases = anyio.run(prepared, folder, server.url)
        with shown_host(script, server.url) as served, chromium() as browser:
            for case in cases:
                for width in _WIDTHS:
                    for theme in _MODES:
                        where = f"{case.name} {width} {theme}"
                        found, took_ms = looked_at(browser, served, case, width, theme, bench.pictures)
                        counted += len(found)
                        read_ms += took_ms
                        failed += [f"{where}: {words}" for words, holds in found if not holds]
                        sys.stderr.write(f"{where}: {len(found)} checks\n")
    for line in failed:
        sys.stderr.write(f"does not hold: {line}\n")
    return {
        "bridge_views": len(cases) * len(_WIDTHS) * len(_MODES),
        "bridge_checks": counted,
        "bridge_failed": len(failed),
        "bridge_read_ms": round(statistics.median(read_ms or [-1.0])),
        "bridge_made_ms": round(max(read_ms, default=-1.0)),
        "bridge_version": BRIDGE,
    }


def bundle(folder: Path, named_node: str) -> bytes:
    """Return the host's script, bundled with its npm packages.

    Raises:
        LeftOut: Node or the packages are not available.
    """
    node, place = node_in(folder / "node", named_node), folder / "packages"
    packages = node.install(place, _PACKAGES, "the bridge", scripts=False)
    (place / "host.js").write_bytes(part("host.js"))
    bundled = place / "bundled.js"
    command = [str(packages / ".bin" / "esbuild"), "host.js", "--bundle", "--format=esm", f"--outfile={bundled}"]
    node.run([*command, "--log-level=error"], place)
    return bundled.read_bytes()


async def prepared(folder: Path, server_url: str) -> list[Case]:
    """Create and run the viewed artifacts, so that the host's calls find them."""
    async with http_client(server_url) as client:
        recorded, *others = await recordings(client, folder)
        generated: dict[str, Any] = {"vehicles": ["truck=2"], "density": "high", "seed": 1}
        people: dict[str, Any] = {"vehicles": ["pedestrian=10"], "seed": 1}
        for wanted in (generated, people):
            await ask(client, "generate_scenarios", **wanted)
        run = {"scenarios": [recorded], "configs": ["frenetix:Default"]}
        batch = {"scenarios": [recorded, *others], "configs": ["frenetix:Default", "frenetix:Safety"]}
        for grid in (run, batch):
            await ask_to_the_end(client, "run_planner", wait_s=0, **grid)
    return [
        Case("generated", "generate_scenarios", generated),
        Case("recorded", "describe_scenario", {"scenario_id": recorded}),
        Case("people", "generate_scenarios", people, "pedestrian"),
        Case("run", "run_planner", run),
        Case("board", "run_planner", batch),
        Case("refusal", "describe_scenario", {"scenario_id": "ZAM_Nowhere-1_1_T-1"}),
    ]


async def recordings(client: Client, folder: Path) -> list[str]:
    """Return three public recordings, imported from a readable folder, or starter scenarios if there are none.

    A plain checkout, as in CI, has no public scenarios.
    """
    if not shared_scenarios().is_dir():
        sys.stderr.write("no public recordings: starter scenarios stand in for them\n")
        found = await ask(client, "find_scenarios", limit=1 + len(_OTHERS))
        return [match["scenario_id"] for match in found["matches"]]
    for name in (_RECORDED, *_OTHERS):
        shutil.copy(shared_scenarios() / f"{name}.xml", folder)
        await ask(client, "import_files", path=str(folder / f"{name}.xml"))
    return [_RECORDED, *_OTHERS]


@contextmanager
def shown_host(script: bytes, server_url: str = "", more: Mapping[str, bytes] | None = None) -> Iterator[Host]:
    """Provide the host with a script, before a server or with files of its own."""
    with host(
        {"host.html": part("host.html"), "host.js": script, **(more or {})}, part("sandbox.html"), server_url
    ) as found:
        yield found


def looked_at(
    browser: Browser,
    served: Host,
    case: Case,
    width: int,
    theme: str,
    pictures: Path | None = None,
    *,
    patience_s: float = 4.0,
) -> tuple[list[Check], list[float]]:
    """Return all checks on the page of a call, and the times from the tool's answer to the data.

    A page that is not shown at all is looked at no further.
    """
    page = browser.open(served.url, width, _HEIGHT, theme)

    def keep(name: str) -> None:
        if pictures is not None:
            pictures.mkdir(parents=True, exist_ok=True)
            (pictures / f"{case.name}-{width}-{theme}-{name}.png").write_bytes(page.picture())

    try:
        page.wait_for("window.host")
        page.value(f"host.connect('{_MODES[theme]}')")
        try:
            view = View(page, shown(page, served, case, theme), theme, keep, patience_s)
        except BrowserFault as fault:
            return [(f"it is shown: {fault}{''.join(f'; {error}' for error in page.errors)}", False)], []
        first, *others = _checks(case)
        found = checks.held(first, view)
        if found[0][1]:
            found += [check for checking in others for check in checks.held(checking, view)]
        view.pictured("end")
        origins = tuple(url.rpartition("/")[0] for url in (served.url, served.sandbox))
        found += checks.held(lambda one: checks.ending(one, origins), view)
        took = page.value("host.readMs()")
        return found, [float(one) for one in took]
    finally:
        page.close()


def shown(page: Page, served: Host, case: Case, theme: str) -> Frame:
    """Return the page of a call, in the bridge."""
    modes = ["inline", "fullscreen"]
    context = {"theme": theme, "displayMode": modes[0], "availableDisplayModes": modes, "locale": "en-GB"}
    told = ", ".join(json.dumps(one) for one in (case.tool, case.input, context, served.sandbox))
    page.value(f"host.show({told})")
    return page.frame(2)


def part(name: str) -> bytes:
    """Return a file of the host."""
    return files(__package__).joinpath(name).read_bytes()


def _checks(case: Case) -> list[Any]:
    """Return the checks of a case's page, in order."""
    if case.name == "board":
        return [checks.arrival, checks.filtering, checks.opening]
    if case.name == "refusal":
        return [checks.refusing]
    look = [checks.arrival, checks.playing, checks.looking, lambda view: checks.choosing(view, case.kind)]
    return [*look, *([checks.driving] if case.name == "run" else []), checks.widening, checks.appearing]
