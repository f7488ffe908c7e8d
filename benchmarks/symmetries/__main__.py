"""``make bench-symmetries``: checks that the product says the same about an equivalent scenario.

Scenarios of the shared folder and generated ones are moved, turned, mirrored, renumbered and so on (``relations``).
Judges query the product before and after, and compare the answers by the law of the relation.

Keys: ``metamorphic_cases`` (comparisons of one judge under one relation on one file), ``metamorphic_failures`` (broken
laws, without the exceptions in ``docs/symmetries.md``), ``stated`` (cases with such an exception), ``relations``,
``files``; ``relation NAME`` and ``judge NAME`` count the failed cases of each.
"""

import argparse
import sys
import tempfile
import zipfile
from collections import Counter
from collections.abc import Iterable, Sequence
from concurrent.futures import as_completed
from importlib.resources import as_file
from importlib.resources import files as resources
from pathlib import Path

from plannerforge.engine.catalog import ARCHIVE

from ..harness import existing, print_figures, process_pool, scenario_files, shared_scenarios
from .cases import Case, measure, tasks


def _main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=shared_scenarios())
    parser.add_argument("--cases", type=int, default=3500, help="approximate number of comparisons")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--limit", type=int, help="only a sample of this many files")
    parser.add_argument("--generated", type=int, default=6, help="number of the package's scenarios")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--cheap", action="store_true", help="skip edits, planner runs and descriptions")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        files = [*scenario_files(existing(given.folder), given.limit), *_generated(Path(folder), given.generated)]
        cases = _measured(files, given.cases, given.seed, given.workers, dear=not given.cheap)
    failed = [case for case in cases if case.differences]
    figures: dict[str, float | int | str] = {
        "metamorphic_cases": len(cases),
        "metamorphic_failures": len(failed),
        "stated": sum(bool(case.stated) for case in cases),
        "relations": len({case.relation for case in cases}),
        "files": len({case.file for case in cases}),
        **_by("relation", (case.relation for case in cases), (case.relation for case in failed)),
        **_by("judge", (case.judge for case in cases), (case.judge for case in failed)),
    }
    print_figures(f"Symmetries, seed {given.seed}", figures)


def _measured(files: Sequence[Path], cases: int, seed: int, workers: int, *, dear: bool) -> list[Case]:
    work = list(tasks(files, cases, seed, dear=dear))
    found: list[Case] = []
    with process_pool(workers) as pool:
        jobs = [pool.submit(measure, task) for task in work]
        for number, job in enumerate(as_completed(jobs), start=1):
            found += (cases_of_file := job.result())
            for case in cases_of_file:
                if case.differences:
                    sys.stderr.write(f"{case.file} {case.relation} {case.judge}\n")
                    sys.stderr.writelines(f"    {difference}\n" for difference in case.differences)
            if number % 20 == 0:
                sys.stderr.write(f"{number} of {len(jobs)} files, {len(found)} cases\n")
    return sorted(found, key=lambda case: (case.file, case.relation, case.judge))


def _generated(folder: Path, count: int) -> list[Path]:
    """Return the smallest scenarios of the starter catalogue, which were generated from maps."""
    with as_file(resources("plannerforge.engine.catalog") / ARCHIVE) as path, zipfile.ZipFile(path) as archive:
        members = [one for one in archive.infolist() if one.filename.endswith(".xml") and ".net." not in one.filename]
        chosen = sorted(members, key=lambda one: (one.file_size, one.filename))[:count]
        return [Path(archive.extract(one, folder)) for one in chosen]


def _by(what: str, all_of: Iterable[str], failed: Iterable[str]) -> dict[str, str]:
    counted, broken = Counter(all_of), Counter(failed)
    return {f"{what} {name}": f"{broken[name]} of {count}" for name, count in sorted(counted.items())}


if __name__ == "__main__":
    _main()
