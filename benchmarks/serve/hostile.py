"""The hostile inputs of ``make bench-robust`` against an HTTP server.

Keys: ``hostile_inputs``, ``hostile_failures`` (laws broken by inputs, deaths of the server, writes outside its roots
and faults of its journal: docs/robustness.md), ``hostile_memory_mb`` (peak memory of the server's process),
``hostile_late_s`` (the slowest refusal).
"""

import itertools
import random
import sys
from pathlib import Path

import anyio

from ..harness import Figures, as_measured
from ..robustness.campaign import Campaign, Tally
from ..robustness.preparation import prepared
from ..robustness.server_process import plannerforge_server
from .bench import ServeBench

_SEED = 1
_MOST_LISTED = 20


def measure(bench: ServeBench) -> Figures:
    """Send the inputs and count what they broke; if interrupted, of those sent."""
    sent: list[Tally] = []
    try:
        anyio.run(_attack, bench.folder("hostile"), bench.inputs, sent)
    except KeyboardInterrupt:
        if not sent:
            raise
        sys.stderr.write("interrupted: the figures are of what was sent till now\n")
    (tally,) = sent
    for finding in tally.findings[:_MOST_LISTED]:
        sys.stderr.write(f"{finding.fault.law}: {finding.hostile.cause}: {finding.fault.details}\n")
    for text in (*tally.deaths, *tally.outside_writes, *tally.journal_faults)[:_MOST_LISTED]:
        sys.stderr.write(f"{text}\n")
    return as_measured(
        {
            "hostile_inputs": tally.inputs,
            "hostile_failures": tally.failures,
            "hostile_memory_mb": round(tally.memory_mb, 1) or None,  # looked at when the campaign has ended
            "hostile_late_s": round(tally.slowest_s, 2),
        }
    )


async def _attack(base: Path, count: int, sent: list[Tally]) -> None:
    ready = await prepared(base)
    campaign = Campaign(ready.folders, base, plannerforge_server(by_http=True))
    sent.append(campaign.tally)
    inputs = ready.inputs("all", random.Random(_SEED))  # noqa: S311 - hostile inputs, no secret
    await campaign.carry_out(itertools.islice(inputs, count))
