"""``make bench-serve``: the server over standard input and HTTP, from the clients' side.

Each part is a module of this package with a function ``measure(bench: ServeBench) -> Figures``. The module explains its
keys. The main keys:

- ``latency``: ``memory_ms``, ``stdio_ms``, ``http_ms`` (medians of a call that reads a workspace with the starter
  scenarios), ``start_ratio`` (process start to first answer, against a bare server of the SDK); goals: at most 1, 4, 8
  ms and 1.4. Also ``find_scenarios_ms``, ``describe_catalog_ms``, ``describe_scenario_ms``, in memory.
- ``http_load``: ``http_errors`` (answers that are neither right nor a stated limit), ``memory_slope_mb_per_h`` of the
  server after its warm-up, ``slowest_share`` (calls of the slowest client over an equal share).
- ``hostile``: ``hostile_inputs``, ``hostile_failures`` over HTTP.
- ``http_kills``: ``kills`` of an HTTP server, ``lost`` (artifacts reported to clients and then missing).
- ``app_frames``: ``app_fps``, the player's frames per second with 300 vehicles in a browser without a graphics card.
- ``app_bridge``: ``bridge_checks`` (checks of the pages in the bridge of MCP Apps hosts), ``bridge_failed``.
- ``conformance``: ``conformance_2026``, ``conformance_2025``, ``conformance_all`` (share of the checks that pass),
  ``conformance_failed`` (failed or missing checks).
- ``install``: ``install_s`` (from nothing to the first answer in a host, from a wheel, packages from pip's cache).
- ``hosts``: ``hosts_passed`` (other makers' clients that find, modify, run, compare and draw); goal: at least 8.

``make bench-server`` (``workers.py``) measures the cost of a killed worker, a cancelled call and a closed client.

``--only`` takes keys and parts. A part that fails or is missing is named, as is a failed check of pages or of the
official suite, and the exit status is then 1. ``--limit`` sets the duration of the load in minutes. ``--json`` prints
only the last line.
"""

import argparse
import sys
from pathlib import Path

from ..harness import Figures, Parts, part_options
from .bench import ServeBench

PARTS: Parts[ServeBench] = Parts(
    package=__package__ or "",
    keys={
        "latency": (
            *("memory_ms", "stdio_ms", "http_ms", "start_ratio"),
            *("find_scenarios_ms", "describe_catalog_ms", "describe_scenario_ms"),
        ),
        "http_load": ("http_errors", "http_edits", "http_runs", "memory_slope_mb_per_h", "slowest_share"),
        "hostile": ("hostile_inputs", "hostile_failures"),
        "http_kills": ("kills", "lost"),
        "app_frames": ("app_fps",),
        "app_bridge": ("bridge_checks", "bridge_failed"),
        "conformance": ("conformance_2026", "conformance_2025", "conformance_all", "conformance_failed"),
        "install": ("install_s",),
        "hosts": ("hosts_passed",),
    },
)
"""The parts in the order of measurement, and the keys that each owes."""
_NONE = ("bridge_failed", "conformance_failed")
"""Keys that must be 0."""
_MINUTES = 10.0


def broken(figures: Figures) -> list[str]:
    """Describe measured values that must be zero and are not."""
    return [f"{key} is {figures[key]}" for key in _NONE if figures.get(key)]


def _bench(given: argparse.Namespace, scratch: Path) -> ServeBench:
    return ServeBench(
        scratch,
        given.limit,
        given.clients,
        given.inputs,
        given.kills,
        given.node,
        tuple(given.host),
        given.hosts_folder,
        given.page,
        given.pictures,
    )


def _main() -> int:
    """Read the command line, measure, print; the status."""
    parser = part_options(__doc__)
    parser.add_argument("--limit", type=float, default=_MINUTES, help="minutes of load (default: 10)")
    parser.add_argument("--clients", type=int, default=8, help="number of concurrent clients (default: 8)")
    parser.add_argument("--inputs", type=int, default=20_000, help="hostile inputs (default: 20000)")
    parser.add_argument("--kills", type=int, default=20, help="kills of the server (default: 20)")
    parser.add_argument("--node", default="", help="a Node program, 22 or newer (default: fetched from PyPI)")
    parser.add_argument("--host", nargs="+", default=[], metavar="NAME", help="only these clients of other makers")
    parser.add_argument("--hosts-folder", type=Path, help="folder of their environments (default: the user's cache)")
    parser.add_argument("--page", type=Path, help="the page for their table")
    parser.add_argument("--pictures", type=Path, help="a folder for a picture of each page in the bridge")
    return PARTS.run("Serve", parser, _bench, broken)


if __name__ == "__main__":
    sys.exit(_main())
