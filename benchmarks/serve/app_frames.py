"""The player with many vehicles in a headless Chromium: its drawing speed during playback.

Keys: ``app_fps``: frames per second during playback with all vehicles in view; a screen shows at most 60.
``app_frame_ms``, ``app_frame_ms_95``: median and 95th percentile of the time of the page's scripts for a frame.
``app_follow_fps``: frames per second while the view follows the ego. ``app_vehicles``, ``app_page_mb``: number of
vehicles and size of the page.

A browser without a graphics card draws on the processor.
"""

from pathlib import Path
from typing import Any

import anyio
from mcp import Client

from plannerforge.engine.rendering import filled_page
from plannerforge.resources.templates import SCHEME
from plannerforge.server.assembly import create_server

from ..harness import Figures, LeftOut, ask, percentile_95, settings_for
from .bench import ServeBench
from .browser import Page, chromium, find_chromium

_CARS = 300
_DURATION_S = 20
_PLAYED_S = 8.0
_ALL, _FOLLOW = "0", "f"
"""Keys of the player: show everything, and follow the ego."""
_VIEWPORT = (1280, 800)
_WATCH = """
new Promise(done => {
  const asked = window.requestAnimationFrame, costs = [], begun = performance.now();
  let frames = 0;
  window.requestAnimationFrame = work => asked(now => {
    const before = performance.now();
    work(now);
    costs.push(performance.now() - before);
    frames += 1;
    const passed = performance.now() - begun;
    if (passed > SECONDS * 1000 && window.requestAnimationFrame !== asked) {
      window.requestAnimationFrame = asked;
      done({ fps: frames / passed * 1000, costs });
    }
  });
})
"""


def measure(bench: ServeBench) -> Figures:
    """Make a scenario, open it in the player, play, and watch the frames."""
    if find_chromium() is None:
        raise LeftOut("Chromium is not installed")
    folder = bench.folder("frames")
    page_file = folder / "player.html"
    vehicles = anyio.run(_write_player, folder / "workspace", page_file)
    with chromium() as browser:
        page = browser.open(page_file.as_uri(), *_VIEWPORT)
        page.wait_for("document.querySelector('.player')")
        whole, following = _played(page, _ALL), _played(page, _FOLLOW)
    costs = sorted(whole["costs"])
    return {
        "app_fps": round(whole["fps"], 1),
        "app_frame_ms": round(costs[len(costs) // 2], 2),
        "app_frame_ms_95": round(percentile_95(costs), 2),
        "app_vehicles": vehicles,
        "app_page_mb": round(page_file.stat().st_size / 1024**2, 2),
        "app_follow_fps": round(following["fps"], 1),
    }


async def _write_player(workspace: Path, file: Path) -> int:
    """Generate a scenario and write its player; return the number of its vehicles."""
    wanted = {"vehicles": [f"car={_CARS}..{_CARS}"], "density": "high", "duration_s": _DURATION_S, "seed": 1}
    async with Client(create_server(settings_for(workspace, workspace.parent, 1))) as client:
        (scenario,) = (await ask(client, "generate_scenarios", **wanted))["scenarios"]
        (data,) = (await client.read_resource(f"{SCHEME}view/{scenario['scenario_id']}")).contents
        file.write_text(filled_page("player", "frames", getattr(data, "text", "")), encoding="utf-8")
        return int(scenario["vehicles_realised"])


def _played(page: Page, first: str) -> Any:
    """Return the frame statistics of playback after a key."""
    page.press(first)
    page.press(" ")
    watched = page.value(_WATCH.replace("SECONDS", str(_PLAYED_S)))
    page.press(" ")
    return watched
