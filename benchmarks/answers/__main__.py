"""``make bench-answers``: checks that answers are true and complete, and measures their tokens.

Keys:

- ``cases``: questions sent; ``compared``: statements in answer fields that the judge compared with the files.
- ``false_statements``: false ones among these.
- ``contradictions``: fields that exclude each other or the text.
- ``figures_unknown``: figures of a text that no field holds.
- ``unanswered``: fields that an answer had to fill and show, and did not.
- ``places_understood``: share of the place spellings understood; the lower of the tuned and the held-out set.
- ``faults_told``: share of the calls with several faults that are refused with a mention of each one.
- ``answer_tokens_median``, ``answer_tokens_p95``: tokens of the answers to the calls of the dev corpora; ``*_before``
  and ``tokens_ratio`` compare with the recording of an earlier version.

``--record FILE`` only records answers of the corpora, with the code of ``--checkout`` if given (its server then runs in
its own process). ``--before FILE`` compares with such a recording.
"""

import argparse
import re
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import anyio
from mcp import Client

from plannerforge.evals.scoring.files import World
from plannerforge.tools.registry import TOOLS

from ..harness import Figures, drawn, print_figures, scenario_files, shared_scenarios
from .cases import Case, faulty_calls, sheet_of_catalogue, sheet_of_scenario
from .judge import GivenAnswer, judge, unanswered
from .places import measure_places
from .recording import Call, Recorded, answer_to, opened, read_recording, record, summary_of, written

_SCENARIOS = 12
"""Public scenarios for the sheets, always the same ones."""
_FAULTY_SCENARIO = "ZAM_Zip-1_6_T-1"


async def _measure(scenarios: int, every: int, before: Path | None, places: bool) -> None:
    told, missing = await _judge_answers(scenarios)
    faults = await _reported_faults()
    tokens = await _tokens(every, before)
    spelled: Figures = {}
    if places:
        worked, aside, count = measure_places()
        spelled = {"places_understood": round(min(worked, aside), 4), "place_spellings": count}
    print_figures("Answers", {**told, "unanswered": missing, **faults, **spelled, **tokens})


async def _judge_answers(scenarios: int) -> tuple[Figures, int]:
    """Return the judge's figures over all cases and the number of unanswered ones; print each miss to standard
    error.
    """
    files = drawn([path.stem for path in scenario_files(shared_scenarios(), None)], scenarios)
    compared = false = excluded = unknown = missing = count = 0
    with tempfile.TemporaryDirectory() as name:
        workspace = Path(name) / "workspace"
        async with opened(workspace, (shared_scenarios(),)) as client:
            for file in files:
                await _import(client, file)
            sheets = [*(sheet_of_scenario(file) for file in files), sheet_of_catalogue()]
            for case in [case for sheet in sheets for case in sheet]:
                answer = await answer_to(client, Call(case.tool, case.arguments))
                told = GivenAnswer(case.tool, case.arguments, answer.text, answer.structured, answer.is_error)
                verdict = judge(told, World(workspace))
                count, compared = count + 1, compared + verdict.compared
                false, excluded = false + len(verdict.false_statements), excluded + len(verdict.contradictions)
                unknown += len(verdict.unknown_figures)
                lacks = _missing_content(case, told)
                missing += len(lacks)
                for kind, words in (
                    ("FALSE", verdict.false_statements),
                    ("CONTRADICTION", verdict.contradictions),
                    ("UNKNOWN", verdict.unknown_figures),
                    ("UNANSWERED", lacks),
                ):
                    for word in words:
                        sys.stderr.write(f"{kind}: {case.tool} {dict(case.arguments)}: {word}\n")
    figures = {"cases": count, "compared": compared, "false_statements": false, "contradictions": excluded}
    return {**figures, "figures_unknown": unknown}, missing


_REFUSED = re.compile(r"^\[\w+\] ")
"""A refusal begins with its code."""


def _missing_content(case: Case, told: GivenAnswer) -> list[str]:
    """Return the missing content of an answer; a permitted refusal needs a code and a next call."""
    if told.is_error and case.may_refuse:
        is_whole = _REFUSED.match(told.text) and any(
            name in told.text for name in ("{", *(spec.name for spec in TOOLS))
        )
        return [] if is_whole else [f"no code or no next call: {told.text[:200]}"]
    return [*(["refused: " + told.text[:200]] if told.is_error else []), *unanswered(told, case.asks)]


async def _import(client: Client, name: str) -> None:
    path = next(shared_scenarios().rglob(f"{name}.xml"))
    answer = await answer_to(client, Call("import_files", {"path": str(path)}))
    if answer.is_error:
        sys.exit(f"{name} cannot be imported: {answer.text}")


async def _reported_faults() -> Figures:
    calls = faulty_calls()
    told_all = 0
    with tempfile.TemporaryDirectory() as name:
        async with opened(Path(name) / "workspace", (shared_scenarios(), Path(name))) as client:
            await _import(client, _FAULTY_SCENARIO)
            for call in calls:
                answer = await answer_to(client, Call(call.tool, call.arguments))
                silent = [word for word in call.words if word not in answer.text]
                told_all += answer.is_error and not silent
                if silent or not answer.is_error:
                    sys.stderr.write(
                        f"NOT REPORTED {silent}: {call.tool} {dict(call.arguments)}: {answer.text[:400]}\n"
                    )
    return {"faulty_calls": len(calls), "faults_told": round(told_all / len(calls), 4)}


async def _tokens(every: int, before: Path | None) -> Figures:
    with tempfile.TemporaryDirectory() as name:
        now = [answer async for answer in record(Path(name) / "workspace", every=every)]
    figures = _token_figures(now, "")
    if before is None:
        return figures
    earlier = read_recording(before)
    ratio = float(figures["answer_tokens_median"]) / float(_token_figures(earlier, "")["answer_tokens_median"])
    return {**figures, **_token_figures(earlier, "_before"), "tokens_ratio": round(ratio, 3)}


def _token_figures(answers: Sequence[Recorded], when: str) -> dict[str, float | int | str]:
    summary = summary_of(answers, "", "")
    return {
        f"answers{when}": summary.answers,
        f"answer_tokens_median{when}": summary.median,
        f"answer_tokens_p95{when}": summary.p95,
    }


async def _record(to: Path, checkout: Path | None, every: int) -> None:
    with tempfile.TemporaryDirectory() as name, to.open("w", encoding="utf-8") as stream:
        async for answer in record(Path(name) / "workspace", checkout=checkout, every=every):
            stream.write(written(answer) + "\n")
            stream.flush()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Whether answers are true and complete, and what they cost.")
    parser.add_argument("--scenarios", type=int, default=_SCENARIOS)
    parser.add_argument("--every", type=int, default=1, help="only every n-th line of the corpora")
    parser.add_argument("--before", type=Path, default=None, help="a recording of an earlier version")
    parser.add_argument("--record", type=Path, default=None, help="only write a recording")
    parser.add_argument("--checkout", type=Path, default=None, help="the checkout with the recorded server")
    parser.add_argument("--no-places", action="store_true")
    given = parser.parse_args()
    if given.record is not None:
        anyio.run(_record, given.record, given.checkout, given.every)
    else:
        anyio.run(_measure, given.scenarios, given.every, given.before, not given.no_places)
