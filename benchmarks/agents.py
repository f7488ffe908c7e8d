"""``make bench-agent``: the ceiling of the tools, agents without a model, and an ideal agent's tokens.

Keys:

- ``oracle_TASK``: share of the corpus's requests that succeed if the ground truth is sent as calls; the workspace
  decides.
- ``oracle_e2e_made``: the same for generated conversations (``--conversations``).
- ``spoiled_first_try``, ``spoiled_after_refusal``: share of requests that succeed with calls as small models write
  them, at once and after at most two refusals.
- ``spoiled_unnoticed``: number of these that end wrongly without a refusal.
- ``regex_routing``, ``bm25_top1``, ``bm25_any5``: what keywords alone reach (paper: 0.455, 0.675 and 0.86).
- ``misbehaviours``: kinds of misbehaviour of models and servers that the agent survives in its tests.
- ``tokens_e2e``: mean tokens of an ideal agent for a conversation: prompt, tools, calls and answers, each counted once
  (o200k_base).
- ``tool_tokens``, ``essential_tokens``: tokens of the list of tools.

The bench reads the development corpora from the shared folder, or the packaged ones if there is no such folder. Rows,
tables and the report stay in ``--out``; the same command resumes an interrupted run.
"""

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

from rich.console import Console

from plannerforge.cli.tool_costs import tool_cost
from plannerforge.evals.corpora import TASKS, packaged_corpora
from plannerforge.evals.results.rates import rate_text
from plannerforge.evals.results.rows import Row
from plannerforge.evals.running import EvaluationOrder, rows_of, run_evaluation
from plannerforge.evals.scoring.tuning import MISSING_PLANNER
from plannerforge.evals.spoiled import MOST_REFUSALS
from plannerforge.prompts.composition import system_prompt
from plannerforge.server.assembly import offered_tools
from plannerforge.server.settings import Settings
from plannerforge.server.tokens import count_tokens

from .harness import Figures, print_figures, share, shared_folder

MISBEHAVIOURS: Mapping[str, tuple[str, ...]] = {
    "unknown tool": ("unknown_tool",),
    "wrong types": ("wrong_types",),
    "endless loop": ("again_and_again", "without_an_end_stop"),
    "empty answer": ("empty_answer",),
    "cut stream": ("cut_stream",),
    "refused connection": ("refused_connection",),
    "wrong JSON": ("not_json", "unreadable"),
    "huge output": ("huge_answer",),
    "two calls at once": ("two_calls_at_once",),
    "tool error": ("error_of_a_tool",),
    "server gone": ("server_that_ends",),
    "model gone in the middle": ("vanishes_midway",),
    "model silent": ("silent_model",),
    "interrupt": ("interrupt",),
    "thinking without an end": ("thinking",),
    "a call written as text": ("written_as_text", "stays_text"),
    "a claim that a call was made": ("claim",),
}
"""Kinds of misbehaviour, and words in the names of the tests for each."""


def main() -> None:
    """Measure, print the tables and the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--limit", type=int, help="only the first requests of each corpus")
    parser.add_argument("--workers", type=int, default=1, help="number of concurrent requests")
    parser.add_argument(
        "--conversations", type=int, default=100, help="number of generated conversations (0 for no conversations)"
    )
    parser.add_argument("--out", type=Path, help="folder for rows and reports (default: temporary)")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = given.out or Path(scratch)
        rows = _rows(_order(folder / "oracle", "oracle", "all", given.limit, given.workers))
        regex = _rows(_order(folder / "regex", "regex", "routing", given.limit, given.workers))
        bm25 = _rows(_order(folder / "bm25", "bm25", "selection", given.limit, given.workers))
        scripted = _rows(_order(folder / "scripted", "scripted", "all", given.limit, given.workers))
        made = _made(folder / "made", given.conversations, given.workers) if given.conversations else []
    figures: dict[str, float | int | str] = {}
    texts = []
    for task in TASKS:
        done = [row.score.done for row in rows if row.request.task == task]
        figures[f"oracle_{task}"] = share(done)
        texts.append((f"oracle_{task}", rate_text(sum(done), len(done))))
    if made:
        done = [row.score.done for row in made]
        figures["oracle_e2e_made"] = share(done)
        texts.append(("oracle_e2e_made", rate_text(sum(done), len(done))))
    for key, done in (
        ("regex_routing", [row.score.done for row in regex]),
        ("bm25_top1", _verdicts(bm25, "sat_top1")),
        ("bm25_any5", _verdicts(bm25, "sat_any5")),
    ):
        figures[key] = share(done)
        texts.append((key, rate_text(sum(done), len(done))))
    spoiled = spoiled_figures(scripted)
    figures |= spoiled
    texts += [(key, str(value)) for key, value in spoiled.items()]
    figures |= {"misbehaviours": _misbehaviours(), **tokens_of([row for row in rows if row.request.task == "e2e"])}
    texts += [(key, str(figures[key])) for key in ("misbehaviours", "tokens_e2e", "tool_tokens", "essential_tokens")]
    print_figures("agents", figures, texts)


def _order(folder: Path, agent: str, task: str, limit: int | None, workers: int) -> EvaluationOrder:
    """Return an evaluation over the development corpora, or over the packaged ones if there are none."""
    shared = shared_folder() / "corpora" / "dev"
    data = shared_folder() / "data" if shared.is_dir() else None
    return EvaluationOrder(
        task=task,
        agent=agent,
        condition="cp_icl_cot",
        corpus=shared if data else packaged_corpora(),
        out=folder,
        limit=limit,
        workers=workers,
        scenarios=data / "commonroad" if data else None,
        maps=data / "osm" if data else None,
    )


def _verdicts(rows: Sequence[Row], column: str) -> list[bool]:
    found = [row.score.columns.get(column) for row in rows]
    return [verdict for verdict in found if verdict is not None]


def _made(folder: Path, conversations: int, workers: int) -> Sequence[Row]:
    order = EvaluationOrder("e2e", "oracle", "cp_icl_cot", out=folder, workers=workers, conversations=conversations)
    return _rows(order)


def _rows(order: EvaluationOrder) -> Sequence[Row]:
    code = run_evaluation(order, Console(width=140, highlight=False))
    if code:
        sys.exit(code)
    return rows_of(order.folder)


def tokens_of(conversations: Sequence[Row]) -> Figures:
    """Count the tokens of conversations and of the list of tools, each text once."""
    full, essential = (
        sum(tool_cost(spec) for spec in offered_tools(Settings(tools=tools))) for tools in ("all", "essential")
    )
    prompt = count_tokens(system_prompt("session", "cp_icl_cot"))
    spoken = [
        row.answer_tokens
        + count_tokens(row.request.text)
        + sum(count_tokens(json.dumps(dict(call.arguments), ensure_ascii=False)) for call in row.attempt.calls)
        for row in conversations
    ]
    return {
        "tokens_e2e": round(prompt + full + statistics.fmean(spoken)) if spoken else 0,
        "tool_tokens": full,
        "essential_tokens": essential,
    }


def spoiled_figures(rows: Sequence[Row]) -> Figures:
    """Measure how the tools handle calls as small models write them, over the requests that can be done here.

    Routing is left out, because its verdicts concern the calls, not their results.
    """
    there = [
        row
        for row in rows
        if row.request.expect in ("ok", "empty")
        and row.request.task != "routing"
        and MISSING_PLANNER not in row.score.columns
    ]
    refusals = [sum(call.is_error for call in row.attempt.calls) for row in there]
    unnoticed = [
        row for row in there if not row.score.done and row.attempt.calls and not row.attempt.calls[-1].is_error
    ]
    for row in unnoticed:
        sys.stderr.write(f"wrong and unnoticed: {row.request_id}: {'; '.join(row.score.misses)}\n")
    pairs = list(zip(there, refusals, strict=True))
    return {
        "spoiled_requests": len(there),
        "spoiled_first_try": share(row.score.done and not count for row, count in pairs),
        "spoiled_after_refusal": share(row.score.done and count <= MOST_REFUSALS * _turns(row) for row, count in pairs),
        "spoiled_unnoticed": len(unnoticed),
    }


def _turns(row: Row) -> int:
    return max(len(row.request.turns), 1)


def _misbehaviours() -> int:
    """Return how many kinds have a test and pass all of theirs; 0 if the tests are not next to the package."""
    tests = Path(__file__).resolve().parents[2] / "tests" / "agent" / "test_misbehaviour.py"
    if not tests.is_file():
        return 0
    with tempfile.TemporaryDirectory() as scratch:
        told = Path(scratch) / "tests.xml"
        command = [
            sys.executable,
            "-m",
            "pytest",
            "-q",
            "-n0",
            "-p",
            "no:cacheprovider",
            f"--junitxml={told}",
            str(tests),
        ]
        subprocess.run(command, cwd=tests.parents[2], check=False, stdout=sys.stderr)
        cases = list(ElementTree.parse(told).iter("testcase"))  # noqa: S314 - written by the line above
    passed = {case.get("name", ""): not len(case) for case in cases}
    survived = 0
    for words in MISBEHAVIOURS.values():
        verdicts = [verdict for name, verdict in passed.items() if any(word in name for word in words)]
        survived += bool(verdicts) and all(verdicts)
    return survived


if __name__ == "__main__":
    main()
