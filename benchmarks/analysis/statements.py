"""Every figure in answers, findings and reports, recomputed from the raw rows by code of its own (``recomputed``).

Answers of ``analyze_results`` on all runs (summary, findings, costs, rows), on two configurations on forty scenarios
(by configuration), of ``compare_results`` on these, and the HTML report on them are read as text, as a person reads
them. Rules know what the figures of a sentence are of, and recompute them from records, steps and scenario files; a
figure that no rule knows counts as one that was not recomputed. It agrees where it is what rounds to the digits shown.
Taken from the answers on single runs are who hit whom, who would have prevented it and what it is laid to, which
``causes`` judges, which traffic rules they broke (``rules``), and the encounters that make a near miss. What is a name,
a constant of the sentence (``95 %``) or a stored sentence of a run is no figure.

Keys: ``statements_recomputed``: share of the figures that agree; ``figures``: how many there are;
``figures_unknown``: those that no rule knows.
"""

import html
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import anyio
from mcp import Client

from plannerforge.engine.rendering import MEASURED_CAPTION
from plannerforge.engine.workspace import Workspace
from plannerforge.evals.scoring.common import built_in
from plannerforge.schemas.planning import PlannerConfiguration

from ..harness import Figures, SeededBench, ask
from .public_runs import DEFAULT, RawRuns, compared_batch, public_batch, public_server, raw_runs
from .recomputed import goal
from .sentences import Judge, Tally, is_close


@dataclass(frozen=True)
class Told:
    """What is told of the runs of a batch, line by line, with the judge of it."""

    raw: RawRuns
    weights: Mapping[str, Mapping[str, float]]
    reviews: Mapping[str, Any]
    lines: tuple[str, ...]
    rules: Mapping[str, Mapping[str, Any]]


def measure(bench: SeededBench) -> Figures:
    """The keys above, over all public scenarios or the bench's limit."""
    tally = judged(anyio.run(collected, bench))
    for fault in (*tally.wrong, *tally.unknown):
        sys.stderr.write(f"{fault}\n")
    return {
        "statements_recomputed": round(tally.agreeing / tally.figures, 4) if tally.figures else 0.0,
        "figures": tally.figures,
        "figures_unknown": len(tally.unknown),
    }


def judged(told: Sequence[Told]) -> Tally:
    """All figures of all lines."""
    tally = Tally()
    for one in told:
        findings = len({line for line in one.lines if line.startswith("- [")})
        rules = Judge(one.raw, one.weights, one.reviews, findings, one.rules).rules()
        for line in one.lines:
            tally.read(line, rules)
    return tally


async def collected(bench: SeededBench) -> list[Told]:
    """The runs, and what the server says of them."""
    async with public_server(bench) as client:
        everything = await public_batch(bench, client)
        two = await compared_batch(bench, client, everything)
        whole, sample = raw_runs(bench, everything), raw_runs(bench, two)
        of_all = [await _text(client, "analyze_results", everything, detail=detail) for detail in _DETAILS]
        of_two = [
            await _text(client, "analyze_results", two, breakdown="config"),
            await _text(client, "analyze_results", two, detail="findings"),
            await _text(client, "analyze_results", two, detail="rules"),
            await _text(client, "compare_results", two),
            await _report(bench, client, two),
        ]
        broken = await _rules(client, sample)
        return [
            Told(raw, _weights(bench, raw), await _reviews(client, raw), lines_of("\n".join(texts), raw), rules)
            for raw, texts, rules in ((whole, of_all, {}), (sample, of_two, broken))
        ]


async def _text(client: Client, tool: str, batch_id: str, **arguments: str) -> str:
    answer = await client.call_tool(tool, {"results": [batch_id], **arguments})
    return "\n".join(getattr(part, "text", "") for part in answer.content)


async def _report(bench: SeededBench, client: Client, batch_id: str) -> str:
    folder = bench.folder("report")
    await ask(client, "export_artifacts", ids=[batch_id], formats=["html"], folder=str(folder))
    return page_text(next(folder.glob("*.html")).read_text(encoding="utf-8"))


_DETAILS = ("summary", "findings", "costs", "rows")


def _weights(bench: SeededBench, raw: RawRuns) -> dict[str, dict[str, float]]:
    """The weights of the configurations of a batch by id, and those of Frenetix' first preset as ``default``."""
    found = {"default": built_in(DEFAULT).weights}
    workspace = Workspace(bench.scratch / "public")
    for config_id in raw.batch.configs:
        configuration = workspace.get(config_id, "config").read(PlannerConfiguration)
        found[config_id] = configuration.weights | configuration.external_weights
    workspace.close()
    return found


async def _reviews(client: Client, raw: RawRuns) -> dict[str, Any]:
    """The moments of the runs that failed or came near, each as the answer on that run alone has them."""
    near = [one for one in raw.valid if not goal(one) or is_close(one)]
    return {one.run_id: (await ask(client, "analyze_results", results=[one.run_id]))["review"] for one in near}


async def _rules(client: Client, raw: RawRuns) -> dict[str, dict[str, Any]]:
    """What each run makes of the traffic rules, by run and rule, each as the answer on that run alone has it."""
    found: dict[str, dict[str, Any]] = {}
    for one in raw.valid:
        told = await ask(client, "analyze_results", results=[one.run_id], detail="rules")
        found[one.run_id] = {verdict["rule"]: verdict for verdict in told["rules"]}
    return found


def page_text(page: str) -> str:
    """What a report says of runs, a line each: paragraphs, findings, and the rows of its tables.

    Lines below a heading that names a run name it too. The table of a run's measures is left to ``measures``.
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


def lines_of(text: str, raw: RawRuns) -> tuple[str, ...]:
    """The lines of a text without the sentences that are stored with the runs."""
    for reason in sorted({one.reason for one in raw.records}, key=len, reverse=True):
        text = text.replace(reason, "")
    return tuple(text.splitlines())
