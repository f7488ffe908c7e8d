"""The report: one HTML file with everything in it, readable on a phone, printable, without scripts.

Its sections are made from what was stored and computed, one function a kind of thing, words and figures only.
"""

import base64
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ...schemas.analysis.comparison import CompareResultsResult, Comparison
from ...schemas.errors import ResourceFailure, UnsafeInput
from ...schemas.rendering import RenderedImage, ReportImage, ReportRequest, ReportSection, ReportTable, ReportWritten
from ...schemas.results import AnalyzeResultsResult
from ...schemas.runs import BatchRecord, RunRecord
from ...schemas.scenarios import ScenarioFacts, ScenarioRecord
from ..execution import ProgressReporter
from ..workspace import Recipe, write_whole

_ORIGINS = {
    "generated": "Generated scenario",
    "modified": "Modified scenario",
    "imported": "Imported scenario",
    "starter": "Scenario of the starter catalogue",
}
_LARGEST_IMAGE_BYTES = 8_000_000
"""Four times the largest animation (chosen)."""
_MEDIA_TYPES = {b"\x89PNG\r\n\x1a\n": "image/png", b"GIF89a": "image/gif", b"GIF87a": "image/gif"}


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
    measured = ("distance (m)", "time to collision (s)", "jerk (m/s³)")
    table = ReportTable(
        caption="Time to collision and distance are the smallest of the run.",
        columns=("run", "scenario", "configuration", "outcome", "why", *measured),
        rows=tuple(_run_row(run) for run in runs),
    )
    return ReportSection(
        title=f"Planner runs: {batch.batch_id}",
        asked=f"{grid}, traffic {batch.traffic}, prediction {batch.prediction}",
        text=tuple(f"Lost: {cell.scenario_id} under {cell.config_id}: {cell.error}" for cell in batch.lost),
        tables=(table,),
        images=tuple(images),
    )


def comparison_section(result: CompareResultsResult) -> ReportSection:
    """Verdicts, tests and flips."""
    return ReportSection(
        title="Comparison",
        asked=" against ".join(side.label for side in result.sides),
        text=(*(comparison.verdict for comparison in result.comparisons), *result.notes),
        tables=tuple(table for comparison in result.comparisons for table in _comparison_tables(comparison)),
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
    given = [(key, value) for key, value in sorted(recipe.arguments.items()) if value not in (None, [], {}, "")]
    shown = ", ".join(f"{key} {json.dumps(value, ensure_ascii=False)}" for key, value in given if key != "map_content")
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


@dataclass(frozen=True)
class _Embedded:
    """A picture as it stands in the page."""

    data_uri: str
    caption: str
    alt_text: str
    width_px: int
    height_px: int


def write_report(request: ReportRequest, report: ProgressReporter) -> ReportWritten:
    """Write the page; pictures become data URIs, all text is escaped.

    Raises:
        ResourceFailure: a picture cannot be read, or the page not be written.
        UnsafeInput: a picture is no PNG or GIF, or larger than 8 MB.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    images: list[tuple[_Embedded, ...]] = []
    for number, section in enumerate(request.sections):
        images.append(tuple(_embed(image) for image in section.images))
        report(0.8 * (number + 1) / len(request.sections), f"section {section.title}")
    loader = PackageLoader("plannerforge.engine.rendering", "")
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    page = environment.get_template("report.html.j2").render(
        report=request, sections=list(zip(request.sections, images, strict=True))
    )
    content = page.encode()
    write_whole(Path(request.path), lambda partial: partial.write_bytes(content))
    report(1.0, "report written")
    return ReportWritten(
        path=request.path,
        size_bytes=len(page.encode()),
        sections=len(request.sections),
        images=sum(len(group) for group in images),
    )


def _embed(image: ReportImage) -> _Embedded:
    from PIL import Image

    path = Path(image.path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ResourceFailure(f"The picture {path.name} cannot be read: {error.strerror}") from error
    media_type = next((kind for start, kind in _MEDIA_TYPES.items() if content.startswith(start)), None)
    if media_type is None or len(content) > _LARGEST_IMAGE_BYTES:
        raise UnsafeInput(f"{path.name} is no PNG or GIF of at most {_LARGEST_IMAGE_BYTES:,} bytes")
    with Image.open(path) as opened:
        width, height = opened.size
    encoded = base64.b64encode(content).decode("ascii")
    return _Embedded(f"data:{media_type};base64,{encoded}", image.caption, image.alt_text, width, height)
