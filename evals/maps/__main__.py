"""``make bench-maps``: maps from anywhere, who is on their roads, and scenarios by the thousand.

Each part is a module of this package with a function ``measure(bench: MapsBench) -> Figures``, which explains its keys
and judges by code apart from the product. The keys that count:

``online``: ``online_done`` (share of the requests done as asked), ``online_refused_right`` (of those to be refused),
``faults_survived`` (of the faults of the services, survived or told), ``cache_same_bytes``.
``country``: ``country_cut_s`` (a site out of a country of millions of nodes, its index built), ``country_memory_mb``.
``factory``: ``factory_ratio`` (executable scenarios a minute, ours over those of Scenario Factory 2.0).
``plan``: ``batch_per_min`` (scenarios of a plan that is killed twice), ``batch_memory_slope_mb`` (for each thousand of
them), ``coverage_2way`` (share of the pairs that the maps allow).
``people``: ``walkers_feasible`` (share of the tracks on ways for them). ``demand``: keys of its own.
``formats``: ``opendrive_within_share`` (of points on lanelet bounds, those within 0.1 m in the exported .xodr),
``opendrive_max_m``, ``openscenario_same_share`` (recorded poses that the exported .xosc has at the same time).

``--only`` takes keys and parts. A part that is not there is left out and named, one that fails too; then the status is
1. ``--json`` prints the last line alone.
"""

import argparse
import json
import sys
import tempfile
import traceback
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

from ..harness import Figures, existing, print_figures, shared_folder
from .bench import LeftOut, MapsBench

KEYS: Mapping[str, tuple[str, ...]] = {
    "online": ("online_done", "online_refused_right", "faults_survived", "cache_same_bytes"),
    "country": ("country_cut_s", "country_memory_mb"),
    "people": ("walkers_feasible",),
    "demand": (),
    "formats": ("opendrive_within_share", "opendrive_max_m", "openscenario_same_share"),
    "factory": ("factory_ratio",),
    "plan": ("batch_per_min", "batch_memory_slope_mb", "coverage_2way"),
}
"""The parts in the order in which they are measured, and the keys that each owes."""
Measure = Callable[[MapsBench], Figures]


def chosen_parts(only: Sequence[str]) -> tuple[str, ...]:
    """The parts that measure some keys, or are named themselves; all of them where nothing is named.

    Raises:
        ValueError: a word that is neither a part nor a key.
    """
    known = {*KEYS, *(key for keys in KEYS.values() for key in keys)}
    if unknown := sorted(set(only) - known):
        raise ValueError(f"unknown: {', '.join(unknown)}; valid are {', '.join(sorted(known))}")
    return tuple(part for part, keys in KEYS.items() if not only or {part, *keys} & set(only))


def measure_of(part: str) -> Measure | None:
    """The function of a part; None where its module is not there."""
    if find_spec(f"{__package__}.{part}") is None:
        return None
    measure: Measure = import_module(f"{__package__}.{part}").measure
    return measure


def measured(
    parts: Sequence[str], bench: MapsBench, find: Callable[[str], Measure | None] = measure_of
) -> tuple[dict[str, float | int | str], list[str]]:
    """The figures of some parts, and in words what is wrong: a part is not there, failed, or owes a key."""
    figures: dict[str, float | int | str] = {}
    faults: list[str] = []
    for part in parts:
        measure = find(part)
        if measure is None:
            faults.append(f"{part}: left out, it is not there yet")
            continue
        sys.stderr.write(f"{part} …\n")
        try:
            found = measure(bench)
        except LeftOut as reason:
            faults.append(f"{part}: left out: {reason}")
            continue
        except Exception as error:  # noqa: BLE001 - the boundary of a part: the others are measured all the same
            sys.stderr.write(traceback.format_exc())
            faults.append(f"{part}: failed: {error}")
            continue
        figures |= found
        faults += [f"{part}: {key} was not measured" for key in KEYS.get(part, ()) if key not in found]
    return figures, faults


def _main() -> int:
    """Read the command line, measure, print; the status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", default=[], metavar="KEY", help="only the parts of these keys")
    parser.add_argument("--shared", type=Path, default=shared_folder(), help="folder with data/osm and corpora/dev")
    parser.add_argument("--workers", type=int, default=2, help="worker processes (default: 2)")
    parser.add_argument("--scenarios", type=int, default=2000, help="of the plan (default: 2000)")
    parser.add_argument("--limit", type=int, default=None, help="only so many requests, maps, tracks: a sample")
    parser.add_argument("--json", action="store_true", help="print nothing but the figures as JSON")
    given = parser.parse_args()
    try:
        parts = chosen_parts(given.only)
    except ValueError as error:
        parser.error(str(error))
    with tempfile.TemporaryDirectory() as scratch:
        bench = MapsBench(existing(given.shared), Path(scratch), given.workers, given.scenarios, given.limit)
        figures, faults = measured(parts, bench)
    for fault in faults:
        sys.stderr.write(f"{fault}\n")
    if given.json:
        sys.stdout.write(json.dumps(figures) + "\n")
    else:
        print_figures("Maps", figures, more_rows=[("!", fault) for fault in faults])
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(_main())
