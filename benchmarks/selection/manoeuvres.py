"""``make bench-manoeuvres``: search and generation by manoeuvre, against an independent judge of the files.

``--count`` files are drawn from ``--folder`` with ``--seed``, and ``--made`` scenarios are generated on the built-in
maps; each request specifies a manoeuvre of others or of the ego. All files are searched for each manoeuvre. Pairs of
scenario and manoeuvre that the judge leaves open do not count.

Keys:

- ``scenarios``.
- ``manoeuvres_right``: share of right cases among the pairs that the search or the judge affirms and the generated
  scenarios; ``search_right`` and ``generated_right``: its two parts.
- ``found_true``: share of the pairs from the search that happen; ``happened_found``: share of the pairs that happen
  that the search returns.
- ``happened`` (pairs that happen), ``pairs`` (all decided), ``pairs_right``; ``open`` (share of all pairs that the
  judge leaves open).
- ``generated``, ``generated_open``, ``generated_refused``, ``generated_scripted``.
"""

import argparse
import random
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import anyio
from mcp import Client

from plannerforge.engine.workspace import Workspace
from plannerforge.evals.results.rates import rate_text
from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings

from ..harness import ask, ask_to_the_end, print_figures, scenario_files, share, shared_scenarios
from .manoeuvre_judge import EGO, OTHERS, Answer, Judge

PAGE = 50
_OTHERS_AT: dict[str, tuple[tuple[str, str], ...]] = {
    "cut_in": (("Neuland", "highway"), ("Neuland", "ramp")),
    "cut_out": (("Neuland", "highway"), ("Neuland", "ramp")),
    "merging": (("Neuland", "ramp"),),
    "overtaking": (("Neuland", "highway"),),
    "lead_brakes_hard": (("Neuland", "highway"), ("Quadratstadt", "urban"), ("Fahrhausen", "urban")),
    "crossing": (("Quadratstadt", "intersection"), ("Musterstadt", "signalised_intersection")),
    "oncoming_turns": (("Quadratstadt", "intersection"), ("Fahrhausen", "intersection")),
}
_EGO_AT: dict[str, tuple[str, str, str]] = {
    "left": ("Quadratstadt", "intersection", "ego_turns_left"),
    "right": ("Fahrhausen", "intersection", "ego_turns_right"),
    "unprotected_left": ("Quadratstadt", "intersection", "unprotected_left"),
    "lane_change": ("Neuland", "highway", "ego_changes_lane"),
    "u_turn": ("Kreiselheim", "roundabout", "ego_turns_back"),
}
"""Built-in maps and types of sites with a manoeuvre, and its feature."""
_CLASSES = ("", ":car", ":truck", ":bus", ":motorcycle")


@dataclass
class _Tally:
    """The results and the faults."""

    pairs: list[bool] = field(default_factory=list)
    said: list[bool] = field(default_factory=list)
    named: list[bool] = field(default_factory=list)
    happened: list[bool] = field(default_factory=list)
    left_open: int = 0
    generated: list[bool] = field(default_factory=list)
    generated_open: int = 0
    refused: int = 0
    scripted: int = 0
    wrong: list[str] = field(default_factory=list)

    def compare(self, scenario: str, truth: dict[str, Answer], named: set[str]) -> None:
        """Add the results of the judge and the searches for a scenario."""
        for manoeuvre, answer in truth.items():
            if answer is Answer.OPEN:
                self.left_open += 1
                continue
            happens, found = answer is Answer.YES, manoeuvre in named
            self.pairs.append(happens == found)
            if happens:
                self.happened.append(found)
            if found:
                self.named.append(happens)
            if happens or found:
                self.said.append(happens and found)
            if happens != found:
                self.wrong.append(f"{scenario}: {manoeuvre} {'is not found' if happens else 'does not happen'}")


@dataclass(frozen=True)
class _Request:
    """One generation: the arguments of the tool, and the feature that its scenario must have."""

    arguments: dict[str, Any]
    feature: str


def requests_of(count: int, seed: int) -> Iterator[_Request]:
    """Draw requests: three of four ask for a manoeuvre of others, the rest for one of the ego."""
    choice = random.Random(seed)  # noqa: S311 - reproducible, not secret
    for number in range(count):
        drawn: dict[str, Any] = {"seed": choice.randrange(10**6), "duration_s": choice.choice([12, 15, 20])}
        drawn["density"] = choice.choice(["low", "medium", "high"])
        if number % 4:
            name = OTHERS[(number - number // 4 - 1) % len(OTHERS)]
            place, kind = choice.choice(_OTHERS_AT[name])
            wish = f"others={name}{choice.choice(_CLASSES)}"
            yield _Request({**drawn, "place": place, "scenario_type": kind, "conditions": [wish]}, name)
        else:
            turn = choice.choice(sorted(_EGO_AT))
            place, kind, feature = _EGO_AT[turn]
            yield _Request({**drawn, "place": place, "scenario_type": kind, "goal": f"through:{turn}"}, feature)


async def _measure(scratch: Path, files: Sequence[Path], requests: Sequence[_Request]) -> _Tally:
    folder, workspace = scratch / "files", scratch / "workspace"
    folder.mkdir()
    for path in files:
        shutil.copyfile(path, folder / path.name)
    tally, made = _Tally(), dict[str, str]()
    settings = Settings(workspace=workspace, roots=(folder,), starter=False, warm_up=False, maps_online="offline")
    async with Client(create_server(settings, start_folder=folder)) as client:
        await ask_to_the_end(client, "import_files", path=str(folder))
        for request in requests:
            result = await client.call_tool("generate_scenarios", request.arguments)
            if result.is_error or result.structured_content is None:
                tally.refused += 1
                sys.stderr.write(f"refused: {request.arguments}: {str(result.content)[:300]}\n")
                continue
            (one,) = result.structured_content["scenarios"]
            made[one["scenario_id"]] = request.feature
            tally.scripted += "scripted" in one.get("others", "")
        named = {name: await _found(client, name) for name in (*OTHERS, *EGO)}
        everything = await _found(client, None)
    store = Workspace(workspace)
    for scenario in sorted(everything):
        if "#" in scenario:  # another planning problem of a file
            continue
        truth = dict(Judge(store.file("scenario", scenario, "scenario.xml")).answers())
        tally.compare(scenario, truth, {name for name, ids in named.items() if scenario in ids})
        if scenario in made:
            answer = truth[made[scenario]]
            if answer is Answer.OPEN:
                tally.generated_open += 1
            else:
                tally.generated.append(answer is Answer.YES)
    store.close()
    return tally


async def _found(client: Client, feature: str | None) -> set[str]:
    """Return the ids that a search by a feature names, on all pages; all there are without one."""
    found: set[str] = set()
    wish = {} if feature is None else {"features": [feature]}
    while True:
        page = await ask(client, "find_scenarios", **wish, limit=PAGE, offset=len(found))
        found |= {match["scenario_id"] for match in page["matches"]}
        if len(page["matches"]) < PAGE:
            return found


def main() -> None:
    """Draw, import, generate, search, judge, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=None, help="source of the files (default: the shared ones)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=130)
    parser.add_argument("--made", type=int, default=40)
    options = parser.parse_args()
    generated = options.made
    choice = random.Random(options.seed)  # noqa: S311 - reproducible, not secret
    files = scenario_files(options.folder or shared_scenarios(), None)
    files = choice.sample(files, min(options.count, len(files)))
    with tempfile.TemporaryDirectory() as scratch:
        tally = anyio.run(_measure, Path(scratch), files, list(requests_of(generated, options.seed)))
    counts = Counter(text.partition(": ")[2] for text in tally.wrong)
    every = len(tally.pairs) + tally.left_open
    print_figures(
        "Manoeuvres",
        {
            "seed": options.seed,
            "scenarios": len(files) + generated - tally.refused,
            "manoeuvres_right": share([*tally.said, *tally.generated]),
            "search_right": share(tally.said),
            "found_true": share(tally.named),
            "happened_found": share(tally.happened),
            "happened": len(tally.happened),
            "pairs": len(tally.pairs),
            "pairs_right": share(tally.pairs),
            "open": round(tally.left_open / max(every, 1), 3),
            "generated": generated - tally.refused,
            "generated_right": share(tally.generated),
            "generated_open": tally.generated_open,
            "generated_refused": tally.refused,
            "generated_scripted": tally.scripted,
        },
        [
            ("search", rate_text(sum(tally.said), len(tally.said))),
            ("generation", rate_text(sum(tally.generated), len(tally.generated))),
            *((what, str(count)) for what, count in sorted(counts.items())),
            *(("wrong", text) for text in tally.wrong),
        ],
    )


if __name__ == "__main__":
    main()
