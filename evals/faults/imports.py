"""``make bench-import-crashes``: 30 kills at random moments of imports of real scenarios.

Keys: ``blows``, ``disagreements`` (database, files, catalogue and text index after each restart, and files that are
missing in the end). Needs the real scenarios: ``PLANNERFORGE_SHARED``, else ``../shared``.
"""

import random
import shutil
import sys
import tempfile
from pathlib import Path

from ..harness import print_figures, shared_folder
from .kill_test_import import kill_imports

KILLS, FILES, SEED = 30, 40, 20261121


def _measure(source: Path, scratch: Path) -> int:
    """Kill, print, and return the number of disagreements."""
    folder = scratch / "files"
    folder.mkdir()
    paths = sorted(source.glob("*.xml"))
    for path in paths[:: max(len(paths) // FILES, 1)]:
        shutil.copyfile(path, folder / path.name)
    chance = random.Random(SEED)  # noqa: S311 - moments, not secrets
    tally = kill_imports(scratch / "workspaces", folder, chance, KILLS)
    for fault in tally.faults:
        sys.stderr.write(f"{fault}\n")
    rows = [(f"killed: {what}", str(count)) for what, count in sorted(tally.kills.items())]
    figures = {"blows": tally.kills.total(), "disagreements": len(tally.faults)}
    print_figures("Imports that are killed", [*rows, ("disagreements", str(len(tally.faults)))], figures)
    return len(tally.faults)


if __name__ == "__main__":
    shared = shared_folder()
    if not (shared / "data/commonroad").is_dir():
        sys.exit("the real scenarios are not here; name their folder in PLANNERFORGE_SHARED")
    with tempfile.TemporaryDirectory() as name:
        sys.exit(1 if _measure(shared / "data/commonroad", Path(name)) else 0)
