"""``make bench-serve``: the server by standard input and by HTTP, as clients meet it.

Each part is a module of this package with a function ``measure(bench: ServeBench) -> Figures``, which explains its
keys. The keys that count:

``latency``: ``memory_ms``, ``stdio_ms``, ``http_ms`` (medians of a call that reads a workspace with the starter
scenarios), ``start_ratio`` (process start to first answer, against a bare server of the SDK); goals: at most 1, 4, 8 ms
and 1.4. Beside them ``find_scenarios_ms``, ``describe_catalog_ms``, ``describe_scenario_ms``, in memory.
``http_load``: ``http_errors`` (answers that are neither right nor a stated limit), ``memory_slope_mb_per_h`` of the
server after its warm-up, ``slowest_share`` (calls of the client that got fewest, of an equal share).
``hostile``: ``hostile_inputs``, ``hostile_failures`` by HTTP.
``http_kills``: ``kills`` of a server by HTTP, ``lost`` of what clients were told that it is there.
``app_frames``: ``app_fps``, frames a second of the player with 300 vehicles in a browser without graphics card.
``app_bridge``: ``bridge_checks`` (what is held against the pages in the bridge that hosts of MCP Apps are built on),
``bridge_failed``.
``conformance``: ``conformance_2026``, ``conformance_2025``, ``conformance_all`` (checks that hold, of all),
``conformance_failed`` (those that do not, and those that were not made).
``install``: ``install_s`` (from nothing to the first answer in a host, from a wheel, packages from pip's cache).
``hosts``: ``hosts_passed`` (clients of others that find, modify, run, compare and draw); goal: at least 8.

What a killed worker, a cancelled call and a client that left cost is ``make bench-server`` (``workers.py``).

``--only`` takes keys and parts. A part that is not there is left out and named, one that fails too, and so is a check
of pages or of the official suite that does not hold; then the status is 1. ``--limit`` makes the load last so many
minutes. ``--json`` prints the last line alone.
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
"""The parts in the order in which they are measured, and the keys that each owes."""
_NONE = ("bridge_failed", "conformance_failed")
"""Keys that are a fault unless they are 0."""
_MINUTES = 10.0


def broken(figures: Figures) -> list[str]:
    """In words, what was measured and has to be none."""
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
    parser.add_argument("--clients", type=int, default=8, help="clients that load the server at once (default: 8)")
    parser.add_argument("--inputs", type=int, default=20_000, help="hostile inputs (default: 20000)")
    parser.add_argument("--kills", type=int, default=20, help="kills of the server (default: 20)")
    parser.add_argument("--node", default="", help="program of Node 22 or newer (default: one is fetched from PyPI)")
    parser.add_argument("--host", nargs="+", default=[], metavar="NAME", help="only these clients of others")
    parser.add_argument(
        "--hosts-folder", type=Path, help="where their environments are kept (default: the user's cache)"
    )
    parser.add_argument("--page", type=Path, help="the page that their table is written into")
    parser.add_argument("--pictures", type=Path, help="a folder for a picture of each page in the bridge")
    return PARTS.run("Serve", parser, _bench, broken)


if __name__ == "__main__":
    sys.exit(_main())
