"""``make bench-peers FOLDER=FOLDER``: imports other people's CommonRoad, OpenDRIVE and Lanelet2 files.

The folder holds one folder for each repository that the user fetched. ``--part`` takes every other repository by name
(``tuned``) or the rest (``kept``). The product's own operations import every file as a map or a scenario. Faults go to
standard error, one per line.

Keys:

- ``commonroad``, ``opendrive``, ``lanelet2``, ``repositories``: how many were tried; ``accepted``: imported files.
- ``wrong_refusals``: refused files that a judge accepts. CommonRoad: commonroad-io reads the file, and CommonRoad's
  schema and its rule of one state per step hold. OpenDRIVE: netconvert makes a network for cars with its default
  settings. Lanelet2: a lanelet has two bounds.
- ``crashes``: files that ended in an error other than a refusal.
- ``lost_links``: links between roads, as sumolib reads the network, that the lanelets lack and that are not reported as
  too tight, and Lanelet2 lanelets that begin at another's end without following it. ``links``: all links.
  ``named_tight``: links reported as too tight for a lanelet.
- ``invalid_goals``: imported planning problems without a start, a time, or an existing lanelet.
- ``wrong_side``: roads that drive on the other side than the file says.
- ``asam_clean``: share of ``asam_exports`` exported scenarios in which ASAM's checker finds nothing, with ``--asam
  PROGRAM`` (asam-qc-opendrive, which needs its own environment).
"""

import argparse
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from plannerforge.engine.maps import convert_roads, read_map_file
from plannerforge.engine.network import build_road_network, read_net
from plannerforge.engine.scenarios import read_facts, write_opendrive
from plannerforge.schemas.artifacts import ForeignExportRequest
from plannerforge.schemas.errors import PlannerForgeError
from plannerforge.schemas.generation import ConvertMapRequest
from plannerforge.schemas.scenarios import ReadFactsRequest

from ...harness import Figures, drawn, existing, print_figures
from .judges import (
    asam_issues,
    bad_goals,
    commonroad_verdict,
    lanelet2_lanelets,
    net_verdict,
    netconvert_reads,
    rule_of,
    torn_joints,
)

KINDS: Mapping[str, bytes] = {".xml": b"<commonRoad", ".xodr": b"OpenDRIVE", ".osm": b"lanelet"}
"""File name endings, and a typical content of each format."""
NAMES = {".xml": "commonroad", ".xodr": "opendrive", ".osm": "lanelet2"}
EXPORTED = 60
"""Number of scenarios exported for ASAM's checker (chosen)."""


@dataclass
class _Tally:
    """Counts by key, and the faults in words."""

    counts: Counter[str] = field(default_factory=Counter)

    def fault(self, key: str, path: Path, what: str, count: int = 1) -> None:
        """Count a fault and tell it."""
        self.counts[key] += count
        sys.stderr.write(f"{key}: {path}: {what}\n")


def measure(folder: Path, scratch: Path, *, part: str, limit: int | None, asam: Path | None) -> Figures:
    """Import all files below a folder and judge the results."""
    repositories = sorted(one for one in folder.iterdir() if one.is_dir())
    chosen = {"tuned": repositories[::2], "kept": repositories[1::2], "all": repositories}[part]
    tally, scenarios = _Tally(), list[Path]()
    for ending in KINDS:
        found = {str(path): path for repository in chosen for path in _files(repository, ending)}
        for name in drawn(found, limit) if limit else sorted(found):
            path = found[name]
            tally.counts[NAMES[ending]] += 1
            with tempfile.TemporaryDirectory(dir=scratch) as own:
                if _tried(path, ending, Path(own), tally) and ending == ".xml":
                    scenarios.append(path)
    keys = (
        "wrong_refusals",
        "crashes",
        "lost_links",
        "invalid_goals",
        "wrong_side",
        "links",
        "named_tight",
        "accepted",
    )
    figures: dict[str, float | int | str] = {"repositories": len(chosen)}
    figures |= {key: tally.counts[key] for key in (*NAMES.values(), *keys)}
    return figures | (_asam(asam, scenarios, scratch, tally) if asam is not None else {})


def _files(repository: Path, ending: str) -> Iterator[Path]:
    for path in sorted(repository.rglob(f"*{ending}")):
        if path.is_file() and KINDS[ending] in path.read_bytes():
            yield path


def _quiet(share: float, message: str = "") -> None:
    """Ignore the progress."""


def _tried(path: Path, ending: str, scratch: Path, tally: _Tally) -> bool:
    """Import one file and judge it; return True if it was imported."""
    try:
        if ending == ".xml":
            _scenario(path, tally)
        else:
            _map(path, scratch, tally)
    except PlannerForgeError as refusal:
        if (reason := _accepted_by_judge(path, ending, scratch)) != "":
            tally.fault("wrong_refusals", path, f"{refusal.message} ({reason})")
        return False
    except Exception as error:  # noqa: BLE001 - that is what is measured
        tally.fault("crashes", path, f"{type(error).__name__}: {error}")
        return False
    tally.counts["accepted"] += 1
    return True


def _accepted_by_judge(path: Path, ending: str, scratch: Path) -> str:
    """Return which program accepts a refused file; empty if no program does."""
    if ending == ".xml":
        return "" if commonroad_verdict(path) else "commonroad-io and the schema accept it"
    try:
        if ending == ".xodr":
            return "netconvert reads it" if netconvert_reads(path, scratch) else ""
        return "it has lanelets" if lanelet2_lanelets(path) else ""
    except Exception:  # noqa: BLE001 - a judge that cannot read the file does not accept it
        return ""


def _scenario(path: Path, tally: _Tally) -> None:
    read_facts(ReadFactsRequest(path=path, net=None, keep=False), _quiet)
    if bad := bad_goals(path):
        tally.fault("invalid_goals", path, f"{bad} planning problems", bad)


def _map(path: Path, scratch: Path, tally: _Tally) -> None:
    made = Path(convert_roads(ConvertMapRequest(path=str(path), folder=str(scratch)), _quiet).path)
    read_map_file(made)
    if not made.name.endswith(".net.xml"):
        pairs, torn = torn_joints(made)
        tally.counts["links"] += pairs
        if torn:
            tally.fault("lost_links", path, f"{torn} of {pairs} joints", torn)
        return
    network = build_road_network(read_net(made), step_s=0.1, elapsed_s=0.0)
    lanes = {key: lanelet.lane_id for key, lanelet in network.lanelets.items()}
    following = {lanes[key]: {lanes[one] for one in lanelet.successors} for key, lanelet in network.lanelets.items()}
    verdict = net_verdict(made, following, rule_of(path))
    named = len(network.lost_connections) if network.dropped_lanes else 0
    tally.counts["links"] += verdict.links
    tally.counts["named_tight"] += min(named, verdict.lost)
    if verdict.lost > named:
        tally.fault("lost_links", path, f"{verdict.lost - named} of {verdict.links} links", verdict.lost - named)
    if verdict.wrong_side:
        tally.fault("wrong_side", path, f"{verdict.wrong_side} roads", verdict.wrong_side)


def _asam(program: Path, scenarios: Sequence[Path], scratch: Path, tally: _Tally) -> dict[str, float | int | str]:
    """Export scenarios, evenly from all that went in, and ask ASAM's checker."""
    count = min(EXPORTED, len(scenarios))
    clean = exported = 0
    for path in (scenarios[number * len(scenarios) // count] for number in range(count)):
        target = scratch / "export.xodr"
        request = ForeignExportRequest(scenario_path=str(path), target_path=str(target), roads=target.name)
        try:
            write_opendrive(request, _quiet)
        except PlannerForgeError:
            continue  # a scenario is refused if its lanelets have no area
        exported += 1
        issues = asam_issues(program, target, scratch)
        clean += not issues
        if issues:
            tally.fault("asam", path, ", ".join(f"{rule} {count}" for rule, count in Counter(issues).items()))
    return {"asam_clean": round(clean / max(exported, 1), 4), "asam_exports": exported}


def _main() -> int:
    """Read the command line, measure and print; return 1 if a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, required=True, help="folder of repositories with foreign files")
    parser.add_argument("--part", choices=("all", "tuned", "kept"), default="all", help="which repositories")
    parser.add_argument("--limit", type=int, help="only this many files of each format, always the same ones")
    parser.add_argument("--asam", type=Path, help="ASAM's program qc_opendrive")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        figures = measure(existing(given.folder), Path(scratch), part=given.part, limit=given.limit, asam=given.asam)
    print_figures("Foreign files", figures)
    goals = ("wrong_refusals", "crashes", "lost_links", "invalid_goals", "wrong_side")
    return 1 if any(figures[key] for key in goals) or figures.get("asam_clean", 1.0) != 1.0 else 0


if __name__ == "__main__":
    sys.exit(_main())
