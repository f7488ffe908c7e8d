"""Asks the corpora's questions about results, each with one call on stored runs.

The questions are every turn of ``corpora/dev/e2e.jsonl`` that analyses or compares, and every line of ``routing.jsonl``
about results (``_ROUTED`` states what each requests, read by hand). A question about one run is asked of a run that
collided, one that succeeded and one that missed its goal, if it fits each. A question about a batch is asked of forty
public scenarios, and a comparison of two configurations on all pairs or on one pair. It counts as answered if the
fields hold what it requests, as the raw rows have it, and the text shows the same figures.

``questions_answered`` is the share answered in all these cases, and ``questions`` is their number.
"""

import json
import math
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import anyio
from mcp import Client

from plannerforge.schemas.runs import RunRecord
from plannerforge.server.assembly import create_server

from ..harness import Figures, SeededBench, settings_for
from ..stated_figures import agrees, figures_in
from .public_runs import RawRuns, compared_batch, public_batch, public_server, raw_runs
from .recomputed import Costs, Pairs, correlation, goal, metric

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
"""By line: the subject of the question, and its requests."""
_DETAIL = {
    "cost_terms": "costs",
    "correlation": "findings",
    "recommendation": "findings",
    "ranking": "rows",
    "span": "timeline",
}
"""The detail that a client requests in addition to the summary, by the user's request."""
_SPAN = (2.0, 4.0)
_COMPARE_WORDS = {"cost": "cost", "distance": "distance", "ttc": "time", "safer": "safety"}


_METRICS = {"distance": "minimum_distance_m", "time": "minimum_time_to_collision_s", "cost": "mean_total_cost"}


@dataclass(frozen=True)
class GivenAnswer:
    """An answer: its fields and its text."""

    fields: Mapping[str, Any]
    text: str = ""

    def shows(self, *values: float) -> bool:
        """Return True if the text holds each of some values, rounded, as a number or in percent."""
        figures = figures_in(self.text)
        return all(any(agrees(one, value) or agrees(one, 100 * value) for one in figures) for value in values)

    def has(self, told: float | None, value: float | None) -> bool:
        """Return True if a field equals the recomputed value and the text shows it; None if there is no such value."""
        if told is None or value is None:
            return told is value
        return math.isclose(told, value, rel_tol=1e-6, abs_tol=1e-9) and self.shows(value)


@dataclass(frozen=True)
class Question:
    """A line, its subject (a run by its outcome, ``run`` any, ``batch``, ``pair``, ``batches``), and its requests."""

    line_id: str
    text: str
    about: str
    asks: tuple[str, ...]


def questions(corpora: Path) -> tuple[Question, ...]:
    """Return all questions about results of both files."""
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
    """Return the metrics that a comparison requests by name, always with the outcome and the verdict."""
    low = text.lower()
    return ("success", *(what for word, what in _COMPARE_WORDS.items() if word in low))


def measure(bench: SeededBench) -> Figures:
    """Return the keys above, over forty public scenarios or the bench's limit."""
    asked, faults = anyio.run(_measured, bench)
    for fault in faults:
        sys.stderr.write(f"{fault}\n")
    unanswered = {fault.partition(" ")[0] for fault in faults}
    return {"questions_answered": round(1 - len(unanswered) / asked, 4), "questions": asked}


async def _measured(bench: SeededBench) -> tuple[int, list[str]]:
    """Count the questions; for each unanswered one, return the line, the request and the beginning of the answer."""
    asked = questions(bench.shared / "corpora" / "dev")
    faults = []
    async with Client(create_server(settings_for(bench.folder("no_runs"), bench.shared, 1))) as client:
        for question in (one for one in asked if one.about == "nothing"):
            tool = "compare_results" if question.asks == ("compare",) else "analyze_results"
            answer = await client.call_tool(tool, {})
            if not answer.is_error or "run_planner" not in _text_of(answer):
                faults.append(f"{question.line_id} of no run: {_text_of(answer)[:200]}")
    async with public_server(bench) as client:
        two = await compared_batch(bench, client, await public_batch(bench, client))
        situations = Situations(raw_runs(bench, two))
        for question in (one for one in asked if one.about != "nothing"):
            for situation in situations.of(question):
                answer = await client.call_tool(situation.tool, situation.arguments)
                text = _text_of(answer)
                told = GivenAnswer(answer.structured_content or {}, text)
                lacking = [ask for ask in question.asks if answer.is_error or not situation.holds(ask, told)]
                if lacking:
                    faults.append(
                        f"{question.line_id} '{question.text}' {situation.arguments} lacks {lacking}:\n{text}\n"
                    )
    return len(asked), faults


def _text_of(answer: Any) -> str:
    return "\n".join(getattr(part, "text", "") for part in answer.content)


@dataclass(frozen=True)
class _Situation:
    """One call, and whether its answer holds what was requested."""

    tool: str
    arguments: dict[str, Any]
    holds: Callable[[str, GivenAnswer], bool]


class Situations:
    """The runs of a batch of two configurations, as subjects of questions."""

    def __init__(self, raw: RawRuns) -> None:
        self._raw = raw
        self._costs = Costs(raw)
        self._first, second = raw.batch.configs[:2]
        self._pairs = Pairs(raw, (self._first, second))

    def of(self, question: Question) -> list[_Situation]:
        """Return the calls by which a client asks the question."""
        if question.about == "pair":
            return [self._pair(before, after) for before, after in self._chosen_pairs()]
        if question.about == "batches":
            return [_Situation("compare_results", {"results": [self._raw.batch.batch_id]}, self._batches_are_right)]
        detail = next((_DETAIL[ask] for ask in question.asks if ask in _DETAIL), "summary")
        if question.about == "batch":
            of = {"results": [self._raw.batch.batch_id], "where": [f"config={self._first}"], "detail": detail}
            return [_Situation("analyze_results", of, self._batch_is_right)]
        return [self._run(record, detail) for record in self._chosen_runs(question.about)]

    def _chosen_runs(self, about: str) -> list[RunRecord]:
        """Return the first run of each outcome, or of the requested one."""
        first: dict[str, RunRecord] = {}
        for record in self._raw.valid:
            first.setdefault(record.outcome, record)
        return [record for outcome, record in first.items() if about in ("run", outcome)]

    def _chosen_pairs(self) -> list[tuple[RunRecord, RunRecord]]:
        """Return the first pair of each combination of outcomes."""
        first: dict[tuple[str, str], tuple[RunRecord, RunRecord]] = {}
        for before, after in self._pairs.pairs:
            first.setdefault((before.outcome, after.outcome), (before, after))
        return list(first.values())

    def _run(self, record: RunRecord, detail: str) -> _Situation:
        arguments: dict[str, Any] = {"results": [record.run_id], "detail": detail}
        if detail == "timeline":
            arguments["where"] = ["time_s={:g}..{:g}".format(*_SPAN)]
        return _Situation("analyze_results", arguments, lambda ask, told: self._run_is_right(record, ask, told))

    def _run_is_right(self, record: RunRecord, ask: str, told: GivenAnswer) -> bool:
        (row,) = told.fields["rows"]
        if (row["run_id"], row["outcome"]) != (record.run_id, record.outcome) or record.run_id not in told.text:
            return False
        hit, review = record.collision, told.fields["review"]
        if ask in ("outcome", "goal_reached", "collision", "duration"):
            return told.has(row["duration_s"], record.metrics.duration_s if record.metrics else None)
        if ask in ("ttc", "min_distance") and hit:
            return True  # it was 0: the collision says so
        if ask in _OF_RUNS:
            medians = {one["name"]: one["median"] for one in told.fields["metrics"]}
            return told.has(medians.get(_OF_RUNS[ask]), metric(record, _OF_RUNS[ask]))
        if ask in ("collision_partner", "failure_reason", "fault"):
            if hit is None or hit.obstacle_id is None:
                return bool(row["reason"])
            contact = review["contact"]
            named = contact["obstacle_id"] == hit.obstacle_id and told.shows(hit.obstacle_id)
            return named and (ask == "collision_partner" or contact["prevention"] is not None)
        if ask == "span":
            times = [step["time_s"] for step in told.fields["timeline"]]
            end = min(_SPAN[1], len(self._raw.steps[record.run_id].x_m) * record.step_s)
            costs = all(step["largest_cost"] in told.text for step in told.fields["timeline"])
            return bool(times) and _SPAN[0] <= min(times) and max(times) <= end and told.shows(*times) and costs
        return self._weights_are_right(ask, self._costs.terms(record), told)

    def _weights_are_right(self, ask: str, terms: Mapping[str, float], told: GivenAnswer) -> bool:
        if ask == "cost_terms":
            largest = max(terms, key=lambda term: terms[term])
            share = next(one["share"] for one in told.fields["costs"] if one["term"] == largest)
            return largest in told.text and told.has(share, terms[largest] / sum(terms.values()))
        if ask == "recommendation":
            suggested = [one["suggestion"] for one in told.fields["findings"] if one["suggestion"]]
            return all(one["weight"] in told.text and one["direction"] in told.text for one in suggested)
        raise ValueError(ask)

    def _batch_is_right(self, ask: str, told: GivenAnswer) -> bool:
        runs = [record for record in self._raw.valid if record.config_id == self._first]
        reached, failed = sum(map(goal, runs)), [record for record in runs if not goal(record)]
        if ask == "success_rate":
            rate = told.fields["success"]
            return told.has(rate["count"], reached) and told.has(rate["of"], len(runs))
        if ask == "failure_modes":
            counts = Counter(str(record.outcome) for record in failed)
            listed = {one["outcome"]: one["count"] for one in told.fields["outcomes"]}
            return all(name in told.text and told.has(listed.get(name), count) for name, count in counts.items())
        if ask == "correlation":
            listed = {one["feature"]: one["rho"] for one in told.fields["correlations"]}
            return all(told.has(listed.get(name), one[0]) for name, one in self._correlated().items())
        if ask == "ranking":
            names = [row["scenario_id"] for row in told.fields["rows"]]
            places = [told.text.find(name) for name in names]
            in_order = -1 not in places and places == sorted(places)
            return in_order and set(names[: len(failed)]) == {record.scenario_id for record in failed}
        return self._weights_are_right(ask, self._costs.means(runs), told)

    def _correlated(self) -> Mapping[str, Sequence[float]]:
        kept = tuple(record for record in self._raw.records if record.config_id == self._first)
        return correlation(RawRuns(self._raw.batch, kept, self._raw.steps, self._raw.facts, self._raw.files))

    def _pair(self, before: RunRecord, after: RunRecord) -> _Situation:
        of = {"results": [before.run_id, after.run_id]}
        return _Situation("compare_results", of, lambda ask, told: self._pair_is_right(before, after, ask, told))

    def _pair_is_right(self, before: RunRecord, after: RunRecord, ask: str, told: GivenAnswer) -> bool:
        (comparison,) = told.fields["comparisons"]
        if ask == "success":
            sides = [(one["run_id"], one["outcome"]) for one in comparison["single"]]
            named = all(one.run_id in told.text for one in (before, after))
            return named and sides == [(one.run_id, one.outcome) for one in (before, after)]
        if ask == "safety":
            return all(self._pair_is_right(before, after, other, told) for other in ("distance", "time"))
        values = [metric(one, _METRICS[ask]) for one in (before, after)]
        tested = {one["name"]: (one["median_before"], one["median_after"]) for one in comparison["metrics"]}
        if comparison["cost"] is not None:
            tested["mean_total_cost"] = (comparison["cost"]["before"], comparison["cost"]["after"])
        if None in values:
            return True
        return all(map(told.has, tested[_METRICS[ask]], values))

    def _batches_are_right(self, ask: str, told: GivenAnswer) -> bool:
        (comparison,) = told.fields["comparisons"]
        success, count = comparison["success"], self._pairs.count
        won, lost = count(before=False, after=True), count(before=True, after=False)
        if ask == "success":
            both, neither = (count(before=value, after=value) for value in (True, False))
            return (success["both"], success["neither"]) == (both, neither) and told.shows(
                both, *[neither] * (neither > 0)
            )
        if ask == "flips":
            told_counts = (comparison["to_success_count"], comparison["to_failure_count"])
            return told_counts == (won, lost) and told.shows(*(number for number in (won, lost) if number))
        wanted = ("distance", "time") if ask == "metrics" else (ask,)
        known = {one["name"] for one in comparison["metrics"]} | ({"mean_total_cost"} if comparison["cost"] else set())
        return {_METRICS.get(name, "risk_score") for name in wanted} <= known


_OF_RUNS = {
    "criticality": "risk_score",
    "jerk": "maximum_jerk_mps3",
    "ttc": "minimum_time_to_collision_s",
    "min_distance": "minimum_distance_m",
}
"""The metric of a run that answers the request."""
