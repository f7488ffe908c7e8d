"""Sections of a report from what was stored and computed: one function a kind of thing, words and figures only."""

import json
from collections.abc import Iterable, Sequence

from plannerforge.engine.workspace.recipe import Recipe
from plannerforge.schemas.comparison import CompareResultsResult, Comparison
from plannerforge.schemas.rendering import RenderedImage, ReportImage, ReportSection, ReportTable
from plannerforge.schemas.results import AnalyzeResultsResult
from plannerforge.schemas.runs import BatchRecord, RunRecord
from plannerforge.schemas.scenarios import ScenarioFacts, ScenarioRecord

_ORIGINS = {
    "generated": "Generated scenario",
    "modified": "Modified scenario",
    "imported": "Imported scenario",
    "starter": "Scenario of the starter catalogue",
}


def scenario_section(record: ScenarioRecord, recipe: Recipe, images: Sequence[ReportImage]) -> ReportSection:
    """What a scenario shows, and how it was made."""
    facts = record.facts
    return ReportSection(
        title=f"{_ORIGINS[record.origin]}: {facts.scenario_id}",
        asked=_asked(recipe),
        text=(_in_words(facts),),
        tables=(ReportTable(columns=("fact", "value"), rows=tuple(_fact_rows(facts))),),
        images=tuple(images),
    )


def batch_section(batch: BatchRecord, runs: Sequence[RunRecord], images: Sequence[ReportImage]) -> ReportSection:
    """Every run of a batch with its outcome, the reason, and its figures."""
    names = ", ".join(dict.fromkeys(run.config_name for run in runs))
    grid = f"run {names} on {len(batch.scenarios)} scenarios"
    lost = tuple(f"Lost: {cell.scenario_id} under {cell.config_id}: {cell.error}" for cell in batch.lost)
    return ReportSection(
        title=f"Planner runs: {batch.batch_id}",
        asked=f"{grid}, traffic {batch.traffic}, prediction {batch.prediction}",
        text=lost,
        tables=(runs_table(runs),),
        images=tuple(images),
    )


def runs_table(runs: Iterable[RunRecord]) -> ReportTable:
    """Runs, one a row."""
    return ReportTable(
        caption="Time to collision and distance are the smallest of the run.",
        columns=(
            "run",
            "scenario",
            "configuration",
            "outcome",
            "why",
            "distance (m)",
            "time to collision (s)",
            "jerk (m/s³)",
        ),
        rows=tuple(_run_row(run) for run in runs),
    )


def comparison_section(result: CompareResultsResult) -> ReportSection:
    """Verdicts, tests and flips."""
    tables = [table for comparison in result.comparisons for table in _comparison_tables(comparison)]
    return ReportSection(
        title="Comparison",
        asked=" against ".join(side.label for side in result.sides),
        text=(*(comparison.verdict for comparison in result.comparisons), *result.notes),
        tables=tuple(tables),
    )


def analysis_section(result: AnalyzeResultsResult, images: Sequence[ReportImage]) -> ReportSection:
    """Findings with the runs behind them."""
    findings = [f"{finding.statement} Evidence: {', '.join(finding.run_ids)}." for finding in result.findings]
    suggestions = [finding.suggestion for finding in result.findings if finding.suggestion is not None]
    hints = [f"{hint.direction} {hint.weight} of {hint.config_id}: {hint.why}" for hint in suggestions]
    return ReportSection(
        title="Findings",
        asked=f"what {', '.join(result.results)} shows",
        text=result.notes,
        findings=(*findings, *(f"Suggested: {hint}" for hint in hints)),
        images=tuple(images),
    )


def report_image(image: RenderedImage, caption: str) -> ReportImage:
    """A drawn picture with its caption."""
    return ReportImage(path=image.path, caption=caption, alt_text=image.alt_text)


def _asked(recipe: Recipe) -> str:
    said = {
        key: value
        for key, value in recipe.arguments.items()
        if value not in (None, [], {}, "") and key != "map_content"
    }
    shown = ", ".join(f"{key} {json.dumps(value, ensure_ascii=False)}" for key, value in sorted(said.items()))
    return f"{recipe.tool}: {shown}" if shown else recipe.tool


def _in_words(facts: ScenarioFacts) -> str:
    counts = ", ".join(f"{count} {kind}" for kind, count in facts.participants.counts.items()) or "no traffic"
    features = ", ".join(name.replace("_", " ") for name in facts.features) or "no special feature"
    return (
        f"{facts.location.place} ({facts.location.country}): {counts} on {facts.roads.lanelets} lanelets for "
        f"{facts.horizon_steps * facts.step_s:g} s. Computed from the geometry: {features}."
    )


def _fact_rows(facts: ScenarioFacts) -> Iterable[tuple[str, str]]:
    ego = facts.ego
    if ego is not None:
        yield "ego's speed at the start", f"{ego.speed_mps:.1f} m/s"
        yield "lanes in the ego's direction", str(ego.lanes)
        yield "goal", ", ".join(form.replace("_", " ") for form in ego.goal_forms) or "none"
        yield "lanelets to the goal", " → ".join(map(str, ego.route)) or "no way on the lanelets"
    yield "posted limits on the map", ", ".join(f"{limit:g} km/h" for limit in facts.roads.limits_map_kmh) or "none"
    yield "traffic lights on the map", str(facts.roads.traffic_lights_map)
    yield "tags in the file", ", ".join(facts.tags) or "none"


def _run_row(run: RunRecord) -> tuple[str, ...]:
    metrics = run.metrics
    return (
        run.run_id,
        run.scenario_id,
        run.config_name,
        run.outcome.replace("_", " "),
        run.reason,
        _figure(None if metrics is None else metrics.minimum_distance_m),
        _figure(None if metrics is None else metrics.minimum_time_to_collision_s),
        _figure(None if metrics is None else metrics.maximum_jerk_mps3, 1),
    )


def _comparison_tables(comparison: Comparison) -> Iterable[ReportTable]:
    yield ReportTable(
        caption=f"{comparison.after} against {comparison.before}: the configurations differ in",
        columns=("weight", "before", "after"),
        rows=tuple((w.weight, _figure(w.before, 3), _figure(w.after, 3)) for w in comparison.weights),
    )
    yield ReportTable(
        caption="Paired by scenario: median before and after, shift with its 95 % interval, Wilcoxon's p",
        columns=("metric", "pairs", "before", "after", "shift", "p", "better"),
        rows=tuple(
            (
                f"{test.name} ({test.unit})" if test.unit else test.name,
                str(test.pairs),
                _figure(test.median_before),
                _figure(test.median_after),
                f"{_figure(test.shift)} [{_figure(test.low)}, {_figure(test.high)}]",
                _figure(test.p, 3),
                {"before": comparison.before, "after": comparison.after, None: "–"}[test.better],
            )
            for test in comparison.metrics
        ),
    )


def _figure(value: float | None, digits: int = 2) -> str:
    return "–" if value is None else f"{value:.{digits}f}"
