"""The questions of the corpora about results, each asked of stored runs by one call.

Every turn of ``corpora/dev/e2e.jsonl`` that analyses or compares is asked, and every line of ``routing.jsonl`` that
is about results (what each of these asks for was read by hand: ``_ROUTED``). A question about one run is asked of a run
that collided, one that reached its goal and one that missed it, where it can be meant of all; a question about a batch
of forty public scenarios, a comparison of two configurations on them, of all pairs or of one. It is answered where the
text of the one call holds what is asked for, with the figures that the raw rows have.

Keys: ``questions_answered``: share of the questions that were answered in all of these, of ``questions``.
"""

import json
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import anyio

from plannerforge.schemas.runs import RunRecord

from ..harness import Figures, SeededBench
from .public_runs import RawRuns, compared_batch, public_batch, public_server, raw_runs
from .recomputed import Costs, Pairs, correlation, goal, metric
from .sentences import N, agrees

_ROUTED: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "rt-d-058": ("collision", ("collision_partner", "failure_reason")),
    "rt-d-059": ("run", ("span",)),
    "rt-d-060": ("run", ("goal_reached", "failure_reason")),
    "rt-d-061": ("run", ("outcome",)),
    "rt-d-062": ("collision", ("collision_partner", "fault")),
    "rt-d-063": ("goal_missed", ("failure_reason",)),
    "rt-d-064": ("goal_missed", ("failure_reason",)),
    "rt-d-065": ("batches", ("success", "metrics")),
    "rt-d-066": ("batch", ("success_rate", "failure_modes")),
    "rt-d-067": ("batches", ("flips",)),
    "rt-d-068": ("batch", ("failure_modes", "correlation")),
    "rt-d-069": ("batches", ("success",)),
    "rt-d-070": ("batches", ("success",)),
    "rt-d-071": ("batch", ("failure_modes", "correlation")),
    "rt-d-085": ("collision", ("failure_reason",)),
    "rt-d-086": ("batches", ("success", "flips")),
    "rt-d-089": ("batch", ("failure_modes",)),
    "rt-d-091": ("collision", ("failure_reason",)),
    "rt-d-092": ("batches", ("success", "metrics")),
    "rt-d-096": ("batches", ("success", "metrics")),
}
"""By line: what the question is about, and what it asks for."""
_DETAIL = {
    "cost_terms": "costs",
    "correlation": "findings",
    "recommendation": "findings",
    "ranking": "rows",
    "span": "timeline",
}
"""What else than the summary a client asks for, by what the user asks for."""
_SPAN = (2.0, 4.0)
_COMPARE_WORDS = {"cost": "cost", "distance": "distance", "ttc": "time", "safer": "safety"}


def _ending(record: RunRecord) -> str:
    """Return the words that an answer has for the outcome of a run."""
    return "reached the goal" if record.outcome == "goal_reached" else f"{record.outcome.replace('_', ' ')}: "


@dataclass(frozen=True)
class Question:
    """A line, what it is about (a run by its outcome, ``run`` any, ``batch``, ``pair``, ``batches``), what it asks."""

    line_id: str
    text: str
    about: str
    asks: tuple[str, ...]


def questions(corpora: Path) -> tuple[Question, ...]:
    """All questions about results of both files."""
    chained = [json.loads(line) for line in (corpora / "e2e.jsonl").read_text(encoding="utf-8").splitlines()]
    routed = [json.loads(line) for line in (corpora / "routing.jsonl").read_text(encoding="utf-8").splitlines()]
    found = [question for line in chained for question in _of_chain(line)]
    found += [Question(line["id"], line["text"], *_ROUTED[line["id"]]) for line in routed if line["id"] in _ROUTED]
    return tuple(found)


def _of_chain(line: Mapping[str, Any]) -> list[Question]:
    modes = {turn["turn"]: turn["truth"].get("mode", "single") for turn in line["turns"]}
    found = []
    for turn in line["turns"]:
        name, truth, text = f"{line['id']}-{turn['turn']}", turn["truth"], turn["text"]
        if turn["action"] == "analyse" and turn["expect"] == "ok":
            about = "batch" if modes.get(truth["about_turn"]) == "batch" else "run"
            found.append(Question(name, text, about, tuple(truth["asks"])))
        elif turn["action"] in ("analyse", "compare") and turn["expect"] == "refuse":
            found.append(Question(name, text, "nothing", (turn["action"],)))
        elif "compare" in turn["action"]:
            first = (truth.get("compare") or truth)["between_turns"][0]
            about = "batches" if modes.get(first) == "batch" else "pair"
            found.append(Question(name, text, about, _compared(text)))
    return found


def _compared(text: str) -> tuple[str, ...]:
    """What a comparison is asked for by name; the outcome and the verdict always."""
    low = text.lower()
    return ("success", *(what for word, what in _COMPARE_WORDS.items() if word in low))


def measure(bench: SeededBench) -> Figures:
    """The keys above, over forty public scenarios or the bench's limit."""
    asked, faults = anyio.run(_measured, bench)
    for fault in faults:
        sys.stderr.write(f"{fault}\n")
    unanswered = {fault.partition(" ")[0] for fault in faults}
    return {"questions_answered": round(1 - len(unanswered) / asked, 4), "questions": asked}


async def _measured(bench: SeededBench) -> tuple[int, list[str]]:
    """How many questions there are, and of those not answered: the line, what was asked, and the answer's beginning."""
    asked = questions(bench.shared / "corpora" / "dev")
    faults = []
    async with public_server(bench) as client:
        for question in (one for one in asked if one.about == "nothing"):
            tool = "compare_results" if question.asks == ("compare",) else "analyze_results"
            answer = await client.call_tool(tool, {})
            if not answer.is_error or "run_planner" not in _text_of(answer):
                faults.append(f"{question.line_id} of no run: {_text_of(answer)[:200]}")
        two = await compared_batch(bench, client, await public_batch(bench, client))
        situations = Situations(raw_runs(bench, two))
        for question in (one for one in asked if one.about != "nothing"):
            for situation in situations.of(question):
                answer = await client.call_tool(situation.tool, situation.arguments)
                text = _text_of(answer)
                lacking = [ask for ask in question.asks if not situation.holds(ask, text)]
                if lacking:
                    faults.append(
                        f"{question.line_id} '{question.text}' {situation.arguments} lacks {lacking}:\n{text}\n"
                    )
    return len(asked), faults


def _text_of(answer: Any) -> str:
    return "\n".join(getattr(part, "text", "") for part in answer.content)


@dataclass(frozen=True)
class _Situation:
    """One call, and whether an answer holds what is asked for."""

    tool: str
    arguments: dict[str, Any]
    holds: Callable[[str, str], bool]


class Situations:
    """The runs of a batch of two configurations, as what questions are about."""

    def __init__(self, raw: RawRuns) -> None:
        self._raw = raw
        self._costs = Costs(raw)
        self._first, second = raw.batch.configs[:2]
        self._pairs = Pairs(raw, (self._first, second))

    def of(self, question: Question) -> list[_Situation]:
        """The calls by which a client asks the question."""
        if question.about == "pair":
            return [self._pair(before, after) for before, after in self._chosen_pairs()]
        if question.about == "batches":
            return [_Situation("compare_results", {"results": [self._raw.batch.batch_id]}, self._batches_hold)]
        detail = next((_DETAIL[ask] for ask in question.asks if ask in _DETAIL), "summary")
        if question.about == "batch":
            of = {"results": [self._raw.batch.batch_id], "where": [f"config={self._first}"], "detail": detail}
            return [_Situation("analyze_results", of, self._batch_holds)]
        return [self._run(record, detail) for record in self._chosen_runs(question.about)]

    def _chosen_runs(self, about: str) -> list[RunRecord]:
        """The first run of each outcome, or of the one that is asked about."""
        first: dict[str, RunRecord] = {}
        for record in self._raw.valid:
            first.setdefault(record.outcome, record)
        return [record for outcome, record in first.items() if about in ("run", outcome)]

    def _chosen_pairs(self) -> list[tuple[RunRecord, RunRecord]]:
        """The first pair of each combination of outcomes."""
        first: dict[tuple[str, str], tuple[RunRecord, RunRecord]] = {}
        for before, after in self._pairs.pairs:
            first.setdefault((before.outcome, after.outcome), (before, after))
        return list(first.values())

    def _run(self, record: RunRecord, detail: str) -> _Situation:
        arguments: dict[str, Any] = {"results": [record.run_id], "detail": detail}
        if detail == "timeline":
            arguments["where"] = ["time_s={:g}..{:g}".format(*_SPAN)]
        return _Situation("analyze_results", arguments, lambda ask, text: self._run_holds(record, ask, text))

    def _run_holds(self, record: RunRecord, ask: str, text: str) -> bool:
        hit, ended = record.collision, _ending(record) in text
        figures: Mapping[str, Sequence[tuple[str, float | None]]] = {
            "duration": [(rf"(?:at|by|within) {N} s", record.metrics.duration_s if record.metrics else None)]
            if not hit
            else [],
            "criticality": [(rf"[Rr]isk score[^;]*?\) {N} of 5", metric(record, "risk score"))],
            "jerk": [(rf"jerk {N} m/s³", metric(record, "largest jerk"))],
            "ttc": [(rf"time to collision {N} s", metric(record, "time to collision"))] if not hit else [],
            "min_distance": [(rf"Closest: {N} m", metric(record, "minimum distance"))] if not hit else [],
        }
        if ask in figures:
            return ended and all(_told(pattern, value, text) for pattern, value in figures[ask])
        if ask in ("outcome", "goal_reached", "collision"):
            return ended and bool(re.search(rf"(?:at|by|within|after) {N} s", text))
        if ask == "collision_partner":
            return ended and (hit is None or hit.obstacle_id is None or f" {hit.obstacle_id} " in text)
        if ask in ("failure_reason", "fault"):
            return ended and (hit is None or "prevent" in text)
        if ask == "span":
            times = [float(time) for time in re.findall(rf"- {N} s: ", text)]
            end = len(self._raw.steps[record.run_id].x_m) * record.step_s
            return bool(times) and _SPAN[0] <= min(times) and max(times) <= min(_SPAN[1], end) and "of the cost" in text
        return self._weights_told(ask, self._costs.terms(record), text)

    def _weights_told(self, ask: str, terms: Mapping[str, float], text: str) -> bool:
        if ask == "cost_terms":
            largest = max(terms, key=lambda term: terms[term])
            return _told(rf" {largest}: {N} % of the cost", 100 * terms[largest] / sum(terms.values()), text)
        if ask == "recommendation":
            return ("Suggest: " in text and "untried" in text) or "No change of a weight" in text
        raise ValueError(ask)

    def _batch_holds(self, ask: str, text: str) -> bool:
        runs = [record for record in self._raw.valid if record.config_id == self._first]
        if ask == "success_rate":
            return f"goal {sum(map(goal, runs))}/{len(runs)}" in text
        if ask == "failure_modes":
            counts = {one.outcome: sum(other.outcome == one.outcome for other in runs) for one in runs if not goal(one)}
            return all(f"{outcome} {count} (" in text for outcome, count in counts.items())
        if ask == "correlation":
            return all(_told(rf"success × {name}: ρ={N}", one[0], text) for name, one in self._correlated().items())
        if ask == "ranking":
            named = re.findall(r"^- run_\w+ (\S+) .*?: (\w+)", text, re.MULTILINE)
            failed = {one.scenario_id for one in runs if not goal(one)}
            return "hardest first" in text and {name for name, _ in named[: len(failed)]} == failed
        return self._weights_told(ask, self._costs.means(runs), text)

    def _correlated(self) -> Mapping[str, Sequence[float]]:
        kept = tuple(record for record in self._raw.records if record.config_id == self._first)
        return correlation(RawRuns(self._raw.batch, kept, self._raw.steps, self._raw.facts, self._raw.files))

    def _pair(self, before: RunRecord, after: RunRecord) -> _Situation:
        of = {"results": [before.run_id, after.run_id]}
        return _Situation("compare_results", of, lambda ask, text: self._pair_holds(before, after, ask, text))

    def _pair_holds(self, before: RunRecord, after: RunRecord, ask: str, text: str) -> bool:
        names = {"distance": "minimum distance", "time": "time to collision", "cost": "mean total cost"}
        if ask == "success":
            return all(_ending(one) in text and one.run_id in text for one in (before, after))
        if ask == "safety":
            return all(self._pair_holds(before, after, other, text) for other in ("distance", "time"))
        first, second = metric(before, names[ask]), metric(after, names[ask])
        if first is None or second is None:
            return True
        told = re.search(rf"{names[ask]} {N}(?: → {N})?", text)
        return told is not None and agrees(told[1], first) and agrees(told[2] or told[1], second)

    def _batches_hold(self, ask: str, text: str) -> bool:
        both, neither = (self._pairs.count(before=value, after=value) for value in (True, False))
        won, lost = self._pairs.count(before=False, after=True), self._pairs.count(before=True, after=False)
        if ask == "success":
            told = "difference" in text or "success" in text.lower()
            return told and f"both reach the goal {both}" in text and (not neither or f"neither {neither}" in text)
        if ask == "flips":
            won_told = f"flipped to success ({won})" in text if won else "flipped to success" not in text
            return won_told and (f"flipped to failure ({lost})" in text if lost else "flipped to failure" not in text)
        if ask == "metrics":
            return all(self._batches_hold(other, text) for other in ("distance", "time"))
        return {"distance": "minimum distance", "time": "time to collision", "cost": "cost"}.get(ask, "risk") in text


def _told(pattern: str, value: float | None, text: str) -> bool:
    """Whether the figure of a pattern is a value; of none, that the text says so."""
    if value is None:
        return "none: " in text
    return any(agrees(shown, value) for shown in re.findall(pattern, text))
