"""``make bench-hostile``: hostile inputs, and a server exposed to strangers.

``--parts`` selects parts; the default is all of them.

``inputs``: hostile inputs against a real server over stdio (``--http``: over HTTP). Keys:

- ``hostile_inputs``; ``unexpected`` (answers with ``[unexpected]``).
- ``server_deaths``: the server died, hung or had to be ended for its memory.
- ``loop_blocked_ms_max``: the longest wait for a cheap call during an input, minus the same call on the idle server,
  without the time in which the machine gave the server no core.
- ``server_memory_mb_max`` (VmHWM of the server's process); ``outside_writes``; ``outside_reads``.
- ``slowest_s`` (the slowest refusal); ``late_refusals`` (after more than 5 s, or not within 60 s).
- ``forged_lines`` (an injected text on a line by itself); ``oversized_answers`` (over 20,000 characters).
- ``unadvised_refusals`` (without a next step).
- ``journal_faults``: callers' texts in the journal over 200 characters or with control characters, or a journal that
  others may read.
- ``minutes``; and the keys of :mod:`citations`.

``stranger``, ``archives``, ``answers``, ``secrets``, ``kills``: modules of :mod:`.street`, which explain their keys.
The main ones with their goals: ``honest_answered`` (1.0), ``honest_p95_ratio`` (at most 2), ``memory_over_bound_mb``
(0), ``descriptors_left`` (0), ``log_lines_per_s`` (at most 5), ``archives_right`` (1.0), ``tools_broken_after`` (0),
``bad_answers_kept`` (0), ``secrets_seen`` (0), ``killed`` (at least 50), ``lost`` (0). ``unexpected`` and
``forged_lines`` are sums over all parts.
"""

import argparse
import itertools
import random
import sys
import tempfile
import time
from collections import Counter
from importlib import import_module
from pathlib import Path

import anyio

from ..harness import Figures, print_figures
from .campaign import Campaign
from .citations import driven_citations
from .inputs import read_kept
from .preparation import prepared
from .server_process import plannerforge_server
from .street.bench import StreetBench

PARTS = ("inputs", "stranger", "archives", "answers", "secrets", "kills")
_SUMMED = ("unexpected", "forged_lines")
"""Keys that several parts have."""


def main() -> None:
    """Read the command line and measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS, metavar="PART", help="only these")
    parser.add_argument("--minutes", type=float, default=20.0, help="minutes of the stranger's visit (default: 20)")
    parser.add_argument("--archives", type=int, default=500, help="forged archives (default: 500)")
    parser.add_argument("--answers", type=int, default=2_000, help="forged answers (default: 2000)")
    parser.add_argument("--kills", type=int, default=50, help="kills in the part kills (default: 50)")
    parser.add_argument("--inputs", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kind", choices=("args", "files", "holes", "all", "citations"), default="all")
    parser.add_argument("--http", action="store_true", help="use the server over HTTP")
    parser.add_argument("--keep", type=Path, help="folder for the inputs that broke something")
    parser.add_argument("--replay", type=Path, nargs="*", help="stored inputs to repeat, each alone")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if arguments.kind == "citations":
            print_figures("Words of others", anyio.run(driven_citations, Path(folder)))
        elif arguments.replay:
            anyio.run(_replay, Path(folder), arguments)
        else:
            _measure_parts(Path(folder), arguments)


def _measure_parts(base: Path, arguments: argparse.Namespace) -> None:
    """Measure the chosen parts one after the other, and print the figures of all."""
    began, figures, rows = time.monotonic(), dict[str, float | int | str](), list[tuple[str, str]]()
    bench = StreetBench(
        base / "street", arguments.seed, arguments.minutes, arguments.archives, arguments.answers, arguments.kills
    )
    for part in arguments.parts:
        sys.stderr.write(f"{part} …\n")
        if part == "inputs":
            found, more = anyio.run(_measure, base, arguments)
            rows += more
        else:
            found = import_module(f"{__package__}.street.{part}").measure(bench)
        figures |= merged(figures, found)
    figures["minutes"] = round((time.monotonic() - began) / 60, 1)
    print_figures("Robustness", figures, more_rows=rows)


def merged(figures: Figures, found: Figures) -> dict[str, float | int | str]:
    """Return the figures of two parts, with common counts added."""
    both = {key: int(figures[key]) + int(found[key]) for key in _SUMMED if key in figures and key in found}
    return {**figures, **found, **both}


async def _replay(base: Path, arguments: argparse.Namespace) -> None:
    paths: list[Path] = arguments.replay
    ready = await prepared(base)
    campaign = Campaign(ready.folders, base, plannerforge_server(by_http=arguments.http))
    for path, faults in zip(paths, await campaign.alone([read_kept(path) for path in paths]), strict=True):
        said = "; ".join(f"{fault.law}: {fault.details}" for fault in faults) or "nothing"
        sys.stdout.write(f"{path.name}: {said}\n")


async def _measure(base: Path, arguments: argparse.Namespace) -> tuple[Figures, list[tuple[str, str]]]:
    ready = await prepared(base)
    campaign = Campaign(ready.folders, base, plannerforge_server(by_http=arguments.http))
    chance = random.Random(arguments.seed)  # noqa: S311 - hostile inputs, no secret
    inputs = itertools.islice(ready.inputs(arguments.kind, chance), arguments.inputs)
    tally = campaign.tally
    await campaign.carry_out(inputs, keep_in=arguments.keep)
    for (law, cause), count in sorted(Counter((each.fault.law, each.hostile.cause) for each in tally.findings).items()):
        sys.stderr.write(f"{law}: {cause}: {count}\n")
    citations = await driven_citations(base / "citations")
    figures: dict[str, float | int | str] = {
        "hostile_inputs": tally.inputs,
        "unexpected": tally.count("unexpected"),
        "server_deaths": len(tally.deaths),
        "loop_blocked_ms_max": round(tally.blocked_ms, 1),
        "server_memory_mb_max": round(tally.memory_mb, 1),
        "outside_writes": len(tally.outside_writes),
        "slowest_s": round(tally.slowest_s, 2),
        "late_refusals": tally.count("late"),
        "forged_lines": tally.count("forged"),
        "oversized_answers": tally.count("oversized"),
        "unadvised_refusals": tally.count("unadvised"),
        "outside_reads": tally.count("outside_read"),
        "journal_faults": len(tally.journal_faults),
        **citations,
    }
    rows = [
        ("calls", str(tally.calls)),
        ("answers by code", ", ".join(f"{code} {count}" for code, count in tally.answers.most_common())),
        ("a cheap call on the idle server", f"{tally.idle_ping_ms:.1f} ms"),
        ("calls that blocked", str(tally.count("blocked"))),
        ("suspects that were not sent again", str(tally.left_out)),
        *(("in the journal", text) for text in tally.journal_faults[:10]),
        *(("written outside", text) for text in tally.outside_writes[:10]),
    ]
    return figures, rows


if __name__ == "__main__":
    main()
