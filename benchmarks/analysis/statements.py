"""Recomputes the figures of answers, findings and reports from the raw rows, and compares fields with text.

The bench reads answers of ``analyze_results`` on all runs (summary, findings, costs, rows) and on two configurations on
forty scenarios (by configuration, findings, rules), and of ``compare_results`` on these. It compares the figures of
their fields with ``expected``, which recomputes them independently. The figures of their text, and of the HTML report
on the two configurations, must occur in these fields (``stated_figures``). No rule depends on the wording.

Keys:

- ``statements_recomputed``: share of the figures in fields that agree; ``figures``: their number.
- ``figures_unread``: figures that nothing recomputes.
- ``figures_in_text``: figures in texts; ``figures_unknown``: those that no field holds.
"""

import html
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import anyio
from mcp import Client

from plannerforge.engine.rendering.reports import MEASURED_CAPTION
from plannerforge.engine.workspace import Workspace
from plannerforge.evals.scoring.common import built_in
from plannerforge.schemas.planning import PlannerConfiguration

from ..harness import Figures, SeededBench, ask
from ..stated_figures import count_of, unknown_in_fields, unknown_in_text
from .expected import Expected, Tally, is_close
from .public_runs import DEFAULT, RawRuns, compared_batch, public_batch, public_server, raw_runs
from .recomputed import goal


@dataclass(frozen=True)
class GivenAnswer:
    """An answer: its text, its fields, and the arguments of the call."""

    tool: str
    asked: Mapping[str, Any]
    text: str
    fields: Mapping[str, Any]


@dataclass(frozen=True)
class OnRuns:
    """The statements about a batch's runs, and the data to recompute them."""

    raw: RawRuns
    weights: Mapping[str, Mapping[str, float]]
    reviews: Mapping[str, Any]
    rules: Mapping[str, Mapping[str, Any]]
    answers: tuple[GivenAnswer, ...]
    page: str = ""


def measure(bench: SeededBench) -> Figures:
    """Return the keys above, over all public scenarios or the bench's limit."""
    told = anyio.run(collected, bench)
    tally, (in_text, unknown) = judged(told), in_texts(told)
    for fault in (*tally.wrong, *(f"not recomputed: {place}" for place in tally.unread), *unknown):
        sys.stderr.write(f"{fault}\n")
    return {
        "statements_recomputed": round(tally.agreeing / tally.figures, 4) if tally.figures else 0.0,
        "figures": tally.figures,
        "figures_unread": len(tally.unread),
        "figures_in_text": in_text,
        "figures_unknown": len(unknown),
    }


def judged(told: Sequence[OnRuns]) -> Tally:
    """Compare the figures of all fields with the recomputed ones."""
    tally = Tally()
    for one in told:
        findings = max(len(answer.fields.get("findings", ())) for answer in one.answers)
        expected = Expected(one.raw, one.weights, one.reviews, one.rules, findings)
        for answer in one.answers:
            wanted = expected.comparison if answer.tool == "compare_results" else expected.analysis
            tally.hold(answer.fields, wanted(answer.fields), answer.tool)
    return tally


def in_texts(told: Sequence[OnRuns]) -> tuple[int, list[str]]:
    """Return the number of figures in the texts, and those that no field holds.

    A report may hold figures of any answer on its runs and of the stored runs.
    """
    count, unknown = 0, list[str]()
    for one in told:
        for answer in one.answers:
            count += count_of(answer.text, answer.fields, answer.asked)
            unknown += unknown_in_text(answer.text, answer.fields, answer.asked)
            unknown += unknown_in_fields(answer.fields, answer.asked)
        stored = [record.model_dump(include={"reason", "metrics"}) for record in one.raw.records]
        content = [*(answer.fields for answer in one.answers), one.reviews, one.weights, one.rules, stored]
        count += count_of(one.page, content)
        unknown += unknown_in_text(one.page, content)
    return count, unknown


async def collected(bench: SeededBench) -> list[OnRuns]:
    """Return the runs, and the server's statements about them."""
    async with public_server(bench) as client:
        everything = await public_batch(bench, client)
        two = await compared_batch(bench, client, everything)
        whole, sample = raw_runs(bench, everything), raw_runs(bench, two)
        of_all = [await _request_answer(client, "analyze_results", everything, detail=detail) for detail in _DETAILS]
        of_two = [
            await _request_answer(client, "analyze_results", two, breakdown="config"),
            await _request_answer(client, "analyze_results", two, detail="findings"),
            await _request_answer(client, "analyze_results", two, detail="rules"),
            await _request_answer(client, "compare_results", two),
        ]
        page, broken = await _report(bench, client, two), await _rules(client, sample)
        return [
            OnRuns(raw, _weights(bench, raw), await _reviews(client, raw), rules, tuple(answers), text)
            for raw, answers, rules, text in ((whole, of_all, {}, ""), (sample, of_two, broken, page))
        ]


async def _request_answer(client: Client, tool: str, batch_id: str, **arguments: str) -> GivenAnswer:
    asked = {"results": [batch_id], **arguments}
    answer = await client.call_tool(tool, asked)
    text = "\n".join(getattr(part, "text", "") for part in answer.content)
    return GivenAnswer(tool, asked, text, answer.structured_content or {})


async def _report(bench: SeededBench, client: Client, batch_id: str) -> str:
    folder = bench.folder("report")
    await ask(client, "export_artifacts", ids=[batch_id], formats=["html"], folder=str(folder))
    return page_text(next(folder.glob("*.html")).read_text(encoding="utf-8"))


_DETAILS = ("summary", "findings", "costs", "rows")


def _weights(bench: SeededBench, raw: RawRuns) -> dict[str, dict[str, float]]:
    """Return the weights of the configurations of a batch by id, and those of Frenetix' first preset as ``default``."""
    found = {"default": built_in(DEFAULT).weights}
    workspace = Workspace(bench.scratch / "public")
    for config_id in raw.batch.configs:
        configuration = workspace.get(config_id, "config").read(PlannerConfiguration)
        found[config_id] = configuration.weights | configuration.external_weights
    workspace.close()
    return found


async def _reviews(client: Client, raw: RawRuns) -> dict[str, Any]:
    """Return the events of runs that failed or came close, each as the answer on that run alone has them."""
    near = [one for one in raw.valid if not goal(one) or is_close(one)]
    return {one.run_id: (await ask(client, "analyze_results", results=[one.run_id]))["review"] for one in near}


async def _rules(client: Client, raw: RawRuns) -> dict[str, dict[str, Any]]:
    """Return each run's result for each traffic rule, as the answer on that run alone has it."""
    found: dict[str, dict[str, Any]] = {}
    for one in raw.valid:
        told = await ask(client, "analyze_results", results=[one.run_id], detail="rules")
        found[one.run_id] = {verdict["rule"]: verdict for verdict in told["rules"]}
    return found


def page_text(page: str) -> str:
    """Return a report's statements about runs, one per line: paragraphs, findings, and the rows of its tables.

    Lines below a heading that names a run also name it. ``measures`` judges the table of a run's measures.
    """
    body = page[page.index("<main>") : page.index("</main>")]
    body = re.sub(rf"<table>\s*<caption>{MEASURED_CAPTION}</caption>.*?</table>", "", body, flags=re.DOTALL)
    lines, run = list[str](), ""
    for tag, inner in re.findall(r"<(h2|li|p|tr)>(.*?)</\1>", body, re.DOTALL):
        if tag == "h2":
            run = next(iter(re.findall(r"run_\w+", inner)), "")
            continue
        text = " | ".join(re.findall(r"<td[^>]*>(.*?)</td>", inner, re.DOTALL)) if tag == "tr" else inner
        lines += [f"{text} {run}" if run and run not in text else text] if text else []
    return html.unescape("\n".join(lines))
