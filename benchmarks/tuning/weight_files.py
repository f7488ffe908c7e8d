"""Checks that weight files come back byte for byte except for the changed numbers.

Synthetic files with the reference's names in any order, with comments, blank lines, indentations, quotes and line
endings of many kinds, are imported, some weights are configured, and the result is exported. The construction of the
file determines the expected result.

Keys: ``yaml_exact``: share of exact files; ``yaml_files``: their number.
"""

import random
from collections.abc import Mapping

import anyio
from mcp import Client

from plannerforge.engine.tuning import preset_configuration
from plannerforge.server.assembly import create_server

from ..harness import Figures, SeededBench, ask, settings_for, share

FILES = 60
"""Number of synthetic files (chosen)."""
_COMMENTS = ("", "", "  # keep", "   # was 0.3: too jerky", " # ü: \u2192")
_NUMBERS = ("0", "0.0", "0.20", "1", "5.0", "1e-1", ".5", "2.50", "+3.0")


def measure(bench: SeededBench) -> Figures:
    """Return the keys above; with a limit, of so many files."""
    return anyio.run(_measured, bench)


async def _measured(bench: SeededBench) -> Figures:
    choice = random.Random(bench.seed)  # noqa: S311 - no secret
    folder = bench.folder("weights")
    verdicts = []
    async with Client(create_server(settings_for(bench.scratch / "files", bench.scratch, 1))) as client:
        for number in range(bench.limit or FILES):
            text, changes, expected = _made(choice)
            path = folder / f"cost_{number}.yaml"
            path.write_bytes(text.encode())
            imported = await ask(client, "import_files", path=str(path))
            weights = [f"{name}={value}" for name, value in changes.items()]
            base = imported["items"][0]["artifact_id"]
            made = (await ask(client, "configure_planner", base=base, weights=weights))["config_id"]
            out = folder / f"out_{number}"
            written = await ask(client, "export_artifacts", ids=[made], formats=["yaml"], folder=str(out))
            verdicts.append((out / written["files"][0]["path"]).read_bytes() == expected.encode())
    return {"yaml_exact": share(verdicts), "yaml_files": len(verdicts)}


def _made(choice: random.Random) -> tuple[str, Mapping[str, str], str]:
    """Return a file, the changes, and the changed file; a changed number has its shortest form with a dot."""
    names = list(preset_configuration("frenetix").weights)
    choice.shuffle(names)
    changed = {name: choice.choice(("7.0", "0.35", "12.5")) for name in choice.sample(names, choice.randint(0, 4))}
    indent, end = choice.choice(("  ", "    ", " ")), choice.choice(("\n", "\n", "\r\n"))
    head = choice.choice(([], ["# our car", ""], ["---"]))
    before, after = [*head, "cost_weights:"], [*head, "cost_weights:"]
    for name in names:
        number, quote = choice.choice(_NUMBERS), choice.choice(("", "", "", "'", '"'))
        gap, comment = choice.choice((" ", "   ")), choice.choice(_COMMENTS)
        if choice.random() < 0.1:
            for lines in (before, after):
                lines.extend(["", f"{indent}# {name} comes next"])
        before.append(f"{indent}{name}:{gap}{quote}{number}{quote}{comment}")
        after.append(f"{indent}{name}:{gap}{quote}{changed.get(name, number)}{quote}{comment}")
    tail = choice.choice(([], ["external_cost_weights:", f"{indent}occ_pm: 0.0  # none"], ["# the end"]))
    last = choice.choice(("", end))
    return end.join([*before, *tail]) + last, changed, end.join([*after, *tail]) + last
