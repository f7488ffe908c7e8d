"""``make bench-selection``: selection over real scenarios against ground truth, and its speed.

Keys:

- ``sat_all_funnel``, ``ids_exact``: slots of the ground truth, over all pages of the tool.
- ``empty_right``: unsatisfiable requests that return no match and name the right stage.
- ``sat_top1_spoiled``, ``sat_top1_spoiled_strict``: spoiled slots, with and without the fallback;
  ``sat_top1_spoiled_text``: with the request's text.
- ``bm25_top1``, ``refused_right``.
- ``search_median_ms_500``, ``search_median_ms_100k``: the tool's time for a client.
- ``import_per_s``, ``first_search_s``, ``first_search_new_workspace_s`` (which adds the starter catalogue),
  ``first_text_search_s``, ``warm_text_search_ms``.

``--fresh SEED`` draws requests from the vocabularies, alone and in combinations, ``--count`` for each seed, and
compares the answers with an independent reading of the files. Keys: ``seeds``, ``fresh_requests``, ``fresh_ids_exact``
and ``fresh_empty_right`` as above, ``fresh_empty`` (unsatisfiable requests).

The bench needs the real scenarios and the corpus in ``PLANNERFORGE_SHARED`` or ``../shared``.
"""

import argparse
import statistics
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import anyio
from mcp import Client
from rich.console import Console

from plannerforge.engine.catalog import entries_of
from plannerforge.engine.catalog.tables import facts_of
from plannerforge.engine.workspace import Database
from plannerforge.evals.ground_truth.selection import Request, read_requests
from plannerforge.evals.results.rates import rate_text
from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings

from ..harness import ask_to_the_end, existing, print_figures, scenario_files, share, shared_folder, shared_scenarios
from .fresh import Known, fresh_requests
from .pages import Answered, answer_all
from .quality import SEEDS, SelectionQuality
from .speed import measure_searches, measure_starts

SMALL = 500
LARGE = 100_000


async def _import_s(settings: Settings, folder: Path) -> float:
    """Return seconds to import all files into a new workspace."""
    async with Client(create_server(settings, start_folder=folder)) as client:
        started = time.perf_counter()
        await ask_to_the_end(client, "import_files", path=str(folder))
        return time.perf_counter() - started


def _measure(scratch: Path, seeds: range, largest: int) -> None:
    """Measure and print."""
    console, begun = Console(stderr=True), time.perf_counter()

    def tell(what: str) -> None:
        console.print(f"{time.perf_counter() - begun:5.0f} s  {what}")

    folder, workspace = existing(shared_scenarios()), scratch / "workspace"
    requests = read_requests(shared_folder() / "corpora/dev/selection.jsonl")
    settings = Settings(workspace=workspace, roots=(folder,), starter=False, warm_up=False, maps_online="offline")
    tell("importing")
    import_s = anyio.run(_import_s, settings, folder)
    database = Database(workspace / "workspace.sqlite")
    connection = database.connection()
    tell("all pages of every request")
    pages = anyio.run(_pages, settings, folder, requests)
    figures, rows = SelectionQuality(database, scratch / "index", requests, folder, tell).measure(seeds)
    added = connection.execute("SELECT count(*) FROM artifacts WHERE kind = 'scenario'").fetchone()[0]
    numbers = frozenset(row[0] for row in connection.execute("SELECT number FROM catalog_scenarios"))
    real = list(facts_of(connection, [entry.scenario_id for entry in entries_of(connection, numbers)]).values())
    medians = []
    for size in (SMALL, largest):
        tell(f"searching among {size:,}")
        medians.append(statistics.median(anyio.run(measure_searches, scratch / f"{size}", real, size, requests)))
    database.close()
    tell("starting servers")
    starts = anyio.run(measure_starts, sys.executable, workspace, scratch / "new")
    tell("done")
    found = _page_figures(pages)
    print_figures(
        "Selection",
        {
            **figures,
            **found,
            "search_median_ms_500": round(medians[0], 2),
            f"search_median_ms_{'100k' if largest == LARGE else largest}": round(medians[1], 2),
            "import_per_s": round(added / import_s, 2),
            "first_search_s": round(starts.first_search_s, 3),
            "first_search_new_workspace_s": round(starts.first_search_new_s, 3),
            "first_text_search_s": round(starts.first_text_search_s, 2),
            "warm_text_search_ms": round(starts.warm_text_search_ms, 1),
        },
        [
            *rows,
            *((key, str(value)) for key, value in found.items()),
            *(("differs from the corpus", answer.difference()) for answer in pages if not answer.is_exact),
            (f"search, median at {SMALL}", f"{medians[0]:.1f} ms"),
            (f"search, median at {largest:,}", f"{medians[1]:.1f} ms"),
            (f"import of {added} scenarios", f"{added / import_s:.1f} scenarios/s"),
            ("start to first search", f"{starts.first_search_s:.2f} s"),
            ("start to first search, new workspace", f"{starts.first_search_new_s:.2f} s"),
            ("start to first search by text", f"{starts.first_text_search_s:.2f} s"),
            ("search by text, warm", f"{starts.warm_text_search_ms:.0f} ms"),
        ],
    )


def _measure_fresh(scratch: Path, seeds: Sequence[int], count: int) -> None:
    """Import all files, ask, compare, print."""
    folder, workspace = existing(shared_scenarios()), scratch / "workspace"
    settings = Settings(workspace=workspace, roots=(folder,), starter=False, warm_up=False, maps_online="offline")
    anyio.run(_import_s, settings, folder)
    database = Database(workspace / "workspace.sqlite")
    files = {path.stem: path for path in scenario_files(folder, None)}
    facts = facts_of(database.connection(), list(files))
    database.close()
    known = [Known.of(files[key], facts[key]) for key in sorted(facts)]
    requests = [request for seed in seeds for request in fresh_requests(known, seed, count)]
    pages = anyio.run(_pages, settings, folder, requests)
    found, empty = _page_figures(pages), [answer for answer in pages if answer.request.expect == "empty"]
    exact = [answer.is_exact for answer in pages if answer.request.expect == "ok"]
    wrong = [answer for answer in pages if not (answer.is_exact if answer.facts else answer.is_rightly_empty)]
    print_figures(
        "Selection, requests drawn just now",
        {
            "seeds": " ".join(map(str, seeds)),
            "fresh_requests": len(pages),
            "fresh_empty": len(empty),
            "fresh_ids_exact": found["ids_exact"],
            "fresh_empty_right": found["empty_right"],
        },
        [
            ("files", str(len(facts))),
            ("ids exact", rate_text(sum(exact), len(exact))),
            ("empty right", rate_text(sum(answer.is_rightly_empty for answer in empty), len(empty))),
            *(("differs from the files", f"{answer.difference()}; {answer.asked}") for answer in wrong),
        ],
    )


async def _pages(settings: Settings, folder: Path, requests: Sequence[Request]) -> list[Answered]:
    async with Client(create_server(settings, start_folder=folder)) as client:
        return await answer_all(client, requests)


def _page_figures(pages: Sequence[Answered]) -> dict[str, float]:
    """Measure over all pages of the tool: matches if there should be some, and no match otherwise."""
    with_answer = [answer for answer in pages if answer.request.expect == "ok"]
    empty = [answer for answer in pages if answer.request.expect == "empty"]
    return {
        "sat_all_funnel": share(
            answer.facts and answer.facts.keys() <= answer.request.matching for answer in with_answer
        ),
        "ids_exact": share(answer.is_exact for answer in with_answer),
        "empty_right": share(answer.is_rightly_empty for answer in empty),
    }


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=SEEDS, help="rounds of spoiled slots")
    parser.add_argument("--first-seed", type=int, default=0, help="the seed of the first round")
    parser.add_argument("--largest", type=int, default=LARGE, help="entries of the large synthetic catalogue")
    parser.add_argument(
        "--fresh", type=int, nargs="+", metavar="SEED", help="use newly drawn requests from these seeds"
    )
    parser.add_argument("--count", type=int, default=300, help="with --fresh: requests of each seed")
    return parser.parse_args()


if __name__ == "__main__":
    asked = _arguments()
    with tempfile.TemporaryDirectory() as name:
        if asked.fresh is None:
            _measure(Path(name), range(asked.first_seed, asked.first_seed + asked.seeds), asked.largest)
        else:
            _measure_fresh(Path(name), asked.fresh, asked.count)
