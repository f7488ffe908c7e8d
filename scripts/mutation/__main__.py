"""``make bench-mutation``: whether the tests notice when the code is changed.

Draws mutants of four parts of the engine, runs on each the tests that reach the changed line, the fastest first, and
prints ``mutants``, ``killed`` (a test failed), ``timed_out``, ``survived``, of them ``unreached`` (no test runs the
line), ``mutation_score`` (killed and timed out, of all) and ``of``, how many mutants there are to draw from. Survivors
are listed with their place and change. See docs/robustness.md.
"""

import dataclasses
import hashlib
import json
import subprocess
import sys
import time
from argparse import ArgumentParser, Namespace
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import accumulate
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from mutants import Mutant, sample

from benchmarks.harness import print_figures, share

CHECKOUT = Path(__file__).resolve().parent.parent.parent
RECORD = CHECKOUT / ".mutation" / "record.json"
PARTS = {
    "edits": ["engine/edits/*.py"],
    "criticality": ["engine/criticality.py"],
    "analysis": ["engine/analysis/*.py"],
    "funnel": [
        f"engine/catalog/{name}.py"
        for name in ("alternatives", "bm25", "constraints", "facets", "funnel", "ranking", "search", "tables", "words")
    ],
}
"""The files of each part; of the catalogue those that a search goes through."""
TESTS = [
    *("tests/engine/edits", "tests/engine/analysis", "tests/engine/catalog", "tests/engine/test_criticality.py"),
    *("tests/engine/test_time_to_collision.py", "tests/workflows/test_search_stages.py"),
]
"""Tests that run the parts in their own process: a worker of a server knows nothing of mutants."""
_LEAST_LIMIT_S = 10
"""The processor time a mutant has at least; it has three times what its tests take (chosen)."""
_CONTROLS = 10
"""So many of the mutants are tried without their change as well: their tests have to pass (chosen)."""


@dataclasses.dataclass(frozen=True, slots=True)
class Verdict:
    """What became of a mutant: ``killed``, ``timed_out``, ``survived`` or ``unreached``, after how long."""

    mutant: Mutant
    outcome: str
    seconds: float


class Server:
    """A process that tries mutants, one after the other."""

    def __init__(self, record: dict[str, Any], files: Sequence[str]) -> None:
        self._process = subprocess.Popen(
            [sys.executable, str(CHECKOUT / "scripts/mutation/trials.py"), "serve"],
            cwd=CHECKOUT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self._send({"modules": record["modules"], "mutated": [module_name(file) for file in files]})

    def outcome(self, mutant: Mutant, tests: Sequence[str], seconds: float) -> tuple[str, float]:
        """The outcome of a mutant and the seconds it took.

        Raises:
            RuntimeError: the process ended; it has said why.
        """
        limit_s = _LEAST_LIMIT_S + int(3 * seconds)
        self._send({"module": module_name(mutant.file), "source": mutant.source, "tests": tests, "limit_s": limit_s})
        answer = self._process.stdout and self._process.stdout.readline()
        if not answer:
            raise RuntimeError(f"no mutant can be tried any more: {mutant.file}:{mutant.line}")
        outcome, took_s = json.loads(answer)
        return outcome, took_s

    def end(self) -> None:
        """Let the process end."""
        if self._process.stdin:
            self._process.stdin.close()
        self._process.wait()

    def _send(self, message: object) -> None:
        if self._process.stdin:
            self._process.stdin.write(json.dumps(message) + "\n")
            self._process.stdin.flush()


def module_name(file: str) -> str:
    """``plannerforge.engine.edits.ego`` of ``engine/edits/ego.py``."""
    return ".".join(("plannerforge", *Path(file).with_suffix("").parts)).removesuffix(".__init__")


def files_of(parts: Sequence[str]) -> list[str]:
    """The files of some parts, relative to the checkout."""
    paths = (path for part in parts for pattern in PARTS[part] for path in CHECKOUT.glob(pattern))
    return sorted(str(path.relative_to(CHECKOUT)) for path in paths)


def recorded() -> dict[str, Any]:
    """The record of the tests (see ``trials.Record``), made anew where code or tests have changed since.

    Raises:
        RuntimeError: it cannot be made.
    """
    code = sorted(
        path
        for folder in ("engine", "schemas", "workflows", "tools", "tests")
        for path in (CHECKOUT / folder).rglob("*.py")
    )
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in code)).hexdigest()
    kept: dict[str, Any] = json.loads(RECORD.read_bytes()) if RECORD.exists() else {}
    if kept.get("digest") == digest:
        return kept
    say("recording which tests reach which lines")
    made = subprocess.run(
        [sys.executable, str(CHECKOUT / "scripts/mutation/trials.py"), "record"],
        cwd=CHECKOUT,
        input=json.dumps({"files": files_of(list(PARTS)), "tests": TESTS}) + "\n",
        stdout=subprocess.PIPE,
        text=True,
        check=False,
    )
    if made.returncode:
        raise RuntimeError("the tests could not be recorded")
    kept = json.loads(made.stdout) | {"digest": digest}
    RECORD.parent.mkdir(exist_ok=True)
    RECORD.write_text(json.dumps(kept), encoding="utf-8")
    return kept


def tests_of(mutant: Mutant, record: dict[str, Any], budget_s: float) -> tuple[list[str], float]:
    """The tests that reach a mutant, the fastest first, as many as take ``budget_s``, and the seconds they take."""
    reached, seconds = record["reached"][mutant.file], record["seconds"]
    tests = {test for line in mutant.lines for test in reached.get(str(line), [])}
    ordered = sorted(tests, key=lambda test: (seconds[test], test))
    taken = [total for total in accumulate(seconds[test] for test in ordered) if total <= budget_s]
    chosen = ordered[: max(len(taken), 1)]
    return chosen, sum(seconds[test] for test in chosen)


def tried(mutants: Sequence[Mutant], files: Sequence[str], record: dict[str, Any], options: Namespace) -> list[Verdict]:
    """What became of each mutant.

    Raises:
        RuntimeError: tests fail on code that is not changed.
    """
    idle: SimpleQueue[Server] = SimpleQueue()
    servers = [Server(record, files) for _ in range(options.workers)]
    for server in servers:
        idle.put(server)

    def attempt(mutant: Mutant) -> Verdict:
        tests, seconds = tests_of(mutant, record, options.budget_s)
        if not tests:
            return Verdict(mutant, "unreached", 0.0)
        server = idle.get()
        try:
            verdict = Verdict(mutant, *server.outcome(mutant, tests, seconds))
        finally:
            idle.put(server)
        where = f"{mutant.file}:{mutant.line}  {mutant.change}"
        say(f"{verdict.outcome:9} {verdict.seconds:5.1f} s  {len(tests):3} tests  {where:.140}")
        return verdict

    unchanged = [
        dataclasses.replace(
            mutant, source=(CHECKOUT / mutant.file).read_text(encoding="utf-8"), change="none (control)"
        )
        for mutant in mutants[:: max(len(mutants) // _CONTROLS, 1)]
    ]
    try:
        with ThreadPoolExecutor(options.workers) as threads:
            failed = [one.mutant for one in threads.map(attempt, unchanged) if one.outcome in ("killed", "timed_out")]
            if failed:
                places = ", ".join(f"{mutant.file}:{mutant.line}" for mutant in failed)
                raise RuntimeError(f"tests of {places} fail without any change, so that no mutant can be judged")
            return list(threads.map(attempt, mutants))
    finally:
        for server in servers:
            server.end()


def say(text: str) -> None:
    """Tell how far the work is."""
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()


def score_text(verdicts: Sequence[Verdict]) -> str:
    """The share of mutants that were noticed, and their number."""
    return f"{share(one.outcome in ('killed', 'timed_out') for one in verdicts):.3f} of {len(verdicts)}"


def main() -> None:
    """Draw, try, tell."""
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--mutants", type=int, default=500, help="how many are drawn")
    parser.add_argument("--seed", type=int, default=1, help="by which they are drawn")
    parser.add_argument("--workers", type=int, default=2, help="how many are tried at a time")
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument(
        "--budget-s", type=float, default=10.0, help="the recorded time of the tests that a mutant gets"
    )
    options = parser.parse_args()
    started, files, record = time.monotonic(), files_of(options.parts), recorded()
    mutants, of = sample(CHECKOUT, files, options.mutants, options.seed)
    verdicts = tried(mutants, files, record, options)
    counts = Counter(verdict.outcome for verdict in verdicts)
    for one in (verdict for verdict in verdicts if verdict.outcome in ("survived", "unreached")):
        print(f"{one.outcome} {one.mutant.file}:{one.mutant.line}  {one.mutant.kind}: {one.mutant.change}")  # noqa: T201
    figures = {
        "mutants": len(verdicts),
        "killed": counts["killed"],
        "timed_out": counts["timed_out"],
        "survived": counts["survived"] + counts["unreached"],
        "unreached": counts["unreached"],
        "mutation_score": share(one.outcome in ("killed", "timed_out") for one in verdicts),
        "of": of,
        "seed": options.seed,
        "minutes": round((time.monotonic() - started) / 60, 1),
    }
    kinds = sorted({one.mutant.kind for one in verdicts})
    print_figures(
        "Mutants that the tests notice",
        figures,
        more_rows=[
            *(
                (f"score, {part}", score_text([v for v in verdicts if v.mutant.file in files_of([part])]))
                for part in PARTS
            ),
            *((f"score, {kind}s", score_text([v for v in verdicts if v.mutant.kind == kind])) for kind in kinds),
        ],
    )


if __name__ == "__main__":
    main()
