"""``make bench-maps``: maps from anywhere, the traffic on their roads, and scenarios by the thousand.

Each part is a module of this package with a function ``measure(bench: MapsBench) -> Figures``. The module explains its
keys and judges with code that shares nothing with the product. The main keys:

- ``online``: ``online_done`` (share of the requests that succeed as requested), ``online_refused_right`` (share of
  those that must be refused), ``faults_survived`` (faults of the services that are survived or reported),
  ``cache_same_bytes``.
- ``country``: ``country_cut_s`` (time for a site in a country of millions of nodes, once its index is built),
  ``country_memory_mb``.
- ``factory``: ``factory_ratio`` (executable scenarios per minute, ours over those of Scenario Factory 2.0).
- ``plan``: ``batch_per_min`` (scenarios of a plan with a server that is killed twice), ``batch_memory_slope_mb`` (per
  thousand scenarios), ``coverage_2way`` (share of the pairs that the maps allow).
- ``tags`` (``make bench-osm-tags``): ``tags_right`` (share of drawn crossings that match their tags or are reported not
  to), ``tags_held_right``, ``limits_right`` (of countries and kinds of road), ``town_over_60``.
- ``people``: ``walkers_feasible`` (share of the tracks on suitable lanelets). ``demand``: see there.
- ``formats``: ``opendrive_within_share`` (share of points on lanelet bounds within 0.1 m in the exported .xodr),
  ``opendrive_max_m``, ``openscenario_same_share`` (share of recorded poses that the exported .xosc has at the same
  time).

``--only`` takes keys and parts. A part that fails or is missing is named, and the exit status is then 1. ``--json``
prints only the last line.
"""

import argparse
import sys
from pathlib import Path

from ..harness import Parts, existing, part_options, shared_folder
from .bench import MapsBench

PARTS: Parts[MapsBench] = Parts(
    package=__package__ or "",
    keys={
        "online": ("online_done", "online_refused_right", "faults_survived", "cache_same_bytes"),
        "country": ("country_cut_s", "country_memory_mb"),
        "tags": ("tags_right", "tags_held_right", "limits_right", "town_over_60"),
        "people": ("walkers_feasible",),
        "demand": (),
        "formats": ("opendrive_within_share", "opendrive_max_m", "openscenario_same_share"),
        "factory": ("factory_ratio",),
        "plan": ("batch_per_min", "batch_memory_slope_mb", "coverage_2way"),
    },
)
"""The parts in the order of measurement, and the keys that each owes."""


def _bench(given: argparse.Namespace, scratch: Path) -> MapsBench:
    return MapsBench(existing(given.shared), scratch, given.workers, given.scenarios, given.minutes, given.limit)


def _main() -> int:
    """Read the command line, measure, print; the status."""
    parser = part_options(__doc__)
    parser.add_argument("--shared", type=Path, default=shared_folder(), help="folder with data/osm and corpora/dev")
    parser.add_argument("--workers", type=int, default=2, help="worker processes (default: 2)")
    parser.add_argument("--scenarios", type=int, default=2000, help="scenarios of the plan (default: 2000)")
    parser.add_argument(
        "--minutes", type=float, default=None, help="longest duration of the plan, after which the results so far count"
    )
    parser.add_argument("--limit", type=int, default=None, help="number of requests, maps and tracks (a sample)")
    return PARTS.run("Maps", parser, _bench)


if __name__ == "__main__":
    sys.exit(_main())
