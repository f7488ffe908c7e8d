"""``make bench-robust``: all evidence of soundness, part by part, in one table.

Each part is a separate benchmark in its own process: ``hostile`` (``benchmarks.robustness``), ``growth``,
``symmetries``, ``fresh_generation``, ``fresh_modification`` and ``fresh_traffic`` (the ``--fresh`` of those benchmarks,
on every seed of ``--seeds``), ``drivable`` and ``kills``. The parts explain their keys; ``fresh_rear_hits`` counts hits
by followers that could have braked.

``--record FOLDER`` stores each part's result at once and does not repeat it with the same arguments, so an interrupted
run resumes. Inputs that broke something are kept there too.
"""

import argparse
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..harness import print_figures

_MAPS, _SCENARIOS, _APPROACHES = 140, 55, 100
"""For each seed: maps for generation (some are refused or name no site), scenarios to edit with four edits each, and
approaches of reactive traffic. Three seeds give at least 300 scenarios, 600 edits and 300 approaches.
"""


@dataclass(frozen=True)
class _Part:
    """A benchmark: its module and arguments, and its keys that count here, by the names that they have here."""

    module: str
    arguments: tuple[str, ...]
    keys: Mapping[str, str]


def _same(*names: str) -> dict[str, str]:
    return {name: name for name in names}


def parts(seeds: Sequence[int], inputs: int, record: Path) -> dict[str, _Part]:
    """Return all parts by name.

    Args:
        seeds: of fresh data, not used while the product was being changed.
        inputs: number of hostile inputs.
        record: folder for the hostile inputs that broke something.
    """
    fresh = ("--fresh", *map(str, seeds), "--count")
    hostile = (
        "hostile_inputs unexpected server_deaths loop_blocked_ms_max server_memory_mb_max outside_writes slowest_s "
        "late_refusals forged_lines oversized_answers outside_reads journal_faults"
    )
    edits = "fresh_edits fresh_T_ends fresh_physical_min fresh_handovers_smooth"
    return {
        "hostile": _Part(
            "robustness",
            ("--parts", "inputs", "--inputs", str(inputs), "--seed", str(seeds[0]), "--keep", str(record / "findings")),
            _same(*hostile.split()),
        ),
        "growth": _Part("growth", (), _same("growth_exponent_max")),
        "symmetries": _Part(
            "symmetries", ("--seed", str(seeds[0])), _same("metamorphic_cases", "metamorphic_failures", "relations")
        ),
        "fresh_generation": _Part(
            "generation",
            (*fresh, str(_MAPS)),
            _same("fresh_maps", "fresh_map_crashes", "fresh_scenarios", "fresh_executable"),
        ),
        "fresh_modification": _Part("modification", (*fresh, str(_SCENARIOS)), _same(*edits.split())),
        "fresh_traffic": _Part(
            "planners.reactive",
            (*fresh, str(_APPROACHES)),
            {"fresh_approaches": "fresh_approaches", "fresh_avoidable_rear_hits": "fresh_rear_hits"},
        ),
        "drivable": _Part("modification.drivable", (), _same("drivable_share")),
        "kills": _Part("faults.mixed_load", (), _same("kills", "broken_after_restart", "orphans")),
    }


def _measured(name: str, part: _Part, record: Path) -> dict[str, float | int | str]:
    """Return the result of a part, measured now or stored; empty if it failed."""
    kept, arguments = record / f"{name}.json", [part.module, *part.arguments]
    found = json.loads(kept.read_text(encoding="utf-8")) if kept.is_file() else {}
    if found.get("arguments") != arguments:
        sys.stderr.write(f"{name}: {' '.join(arguments)}\n")
        command = [sys.executable, "-m", f"{__package__}.{part.module}", *part.arguments]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            told = process.stdout.read() if process.stdout else ""
        sys.stdout.write(told)
        last = told.rstrip("\n").rpartition("\n")[2]
        if not last.startswith("{"):
            sys.stderr.write(f"{name} broke with {process.returncode} and printed no figures\n")
            return {}
        found = {"arguments": arguments, "figures": json.loads(last)}
        kept.write_text(json.dumps(found) + "\n", encoding="utf-8")
    said = found["figures"]
    return {here: said[there] for there, here in part.keys.items() if there in said}


def _main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--seeds", type=int, nargs="+", required=True, help="seeds of fresh data that were never run before"
    )
    parser.add_argument("--inputs", type=int, default=20_000, help="number of hostile inputs")
    parser.add_argument("--parts", nargs="+", metavar="PART", help="only these")
    parser.add_argument("--record", type=Path, default=Path("soundness"), help="folder for the parts' results")
    given = parser.parse_args()
    given.record.mkdir(parents=True, exist_ok=True)
    known = parts(given.seeds, given.inputs, given.record)
    wanted = given.parts or list(known)
    if unknown := [name for name in wanted if name not in known]:
        parser.error(f"unknown part {', '.join(unknown)}; valid parts are {', '.join(known)}")
    said = {name: _measured(name, known[name], given.record) for name in wanted}
    figures = {key: value for of_part in said.values() for key, value in of_part.items()}
    print_figures(f"Soundness, fresh data of the seeds {' '.join(map(str, given.seeds))}", figures)
    if broken := [name for name, of_part in said.items() if len(of_part) < len(known[name].keys)]:
        sys.exit(f"not measured: {', '.join(broken)}")


if __name__ == "__main__":
    _main()
