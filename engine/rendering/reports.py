"""The report: one self-contained HTML file, readable on a phone, printable, without scripts.

Its sections come from stored and computed results, with one function per kind of artifact, as text and figures only.
"""

import base64
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ...schemas.analysis.comparison import CompareResultsResult, Comparison
from ...schemas.errors import ResourceFailure, UnsafeInput
from ...schemas.measures import MeasuredValue, RunMetrics, measure_named, metric_words
from ...schemas.rendering import RenderedImage, ReportImage, ReportRequest, ReportSection, ReportTable, ReportWritten
from ...schemas.results import AnalyzeResultsResult, CollisionCauses, Group, Rate, figure, measured_figure
from ...schemas.reviews import CollisionCause, kind_in_words
from ...schemas.runs import BatchRecord, RunRecord, ending, excesses_in_words
from ...schemas.scenarios import ScenarioFacts, ScenarioRecord
from ...schemas.text import REFERENCE_DRIVERS_DO, counted, shown_name
from ..execution import ProgressReporter
from ..workspace import Recipe, write_whole
from .words import words_used

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
    """Return a section on a scenario's content and origin."""
    facts = record.facts
    return ReportSection(
        title=f"{_ORIGINS[record.origin]}: {facts.scenario_id}",
        asked=_describe_request(recipe),
        text=(_describe_facts(facts),),
        tables=(ReportTable(columns=("fact", "value"), rows=tuple(_fact_rows(facts))),),
        images=tuple(images),
    )


_BEHAVIOUR = {
    "recorded": "recorded traffic: the others follow their recordings and cannot react",
    "reactive": "reactive traffic: the others are simulated and react",
}


def overview_section(
    batch: BatchRecord, names: Mapping[str, str], result: AnalyzeResultsResult, comparison: CompareResultsResult | None
) -> ReportSection:
    """Return a summary of tests, results, causes and the next step, for readers who did not run the tests.

    Args:
        names: The names of the configurations, by id.
        result: The analysis of the whole batch, with a breakdown by configuration.
    """
    count = len(batch.scenarios)
    configurations = f"{len(names)} configuration{'' if len(names) == 1 else 's'} ({'; '.join(names.values())})"
    tested = (
        f"{configurations} on {count} scenario{'' if count == 1 else 's'}, {result.runs} runs; "
        f"{_BEHAVIOUR[batch.traffic]}; {batch.prediction.replace('_', ' ')} prediction"
        f"{'' if batch.world.is_perfect else f'; world {batch.world.in_words()}'}."
    )
    rows = [
        ("What was tested", tested),
        ("Results", f"{_describe_success(result)}{_describe_failures(result)}.{_by_any_motion(result)}"),
        *_configuration_rows(result),
        *((f"{one.after} against {one.before}", _verdict(one).partition(". ")[0]) for one in _compared(comparison)),
        ("Next step", f"{_describe_next_step(result, names)}."),
    ]
    tables = [ReportTable(columns=("question", "answer"), rows=tuple(rows))]
    return ReportSection(
        title=f"In short: {batch.batch_id}", tables=(*tables, *([_by_configuration(result)] if result.groups else []))
    )


def _configuration_rows(result: AnalyzeResultsResult) -> Iterable[tuple[str, str]]:
    """Yield the statements on a configuration's runs, separately for each configuration if there are several."""
    for own in [result] if result.success is not None else result.groups:
        of = f", {own.name}" if isinstance(own, Group) else ""
        if own.trivial is not None:
            yield f"Goals reached without driving{of}", own.trivial.in_words()
        if own.beyond_vehicle is not None:
            yield f"Motions beyond the vehicle's limits{of}", own.beyond_vehicle.in_words()
        yield f"Who caused the collisions{of}", causes_in_words(own.causes)
        if own.causes is not None and own.causes.laid_to:
            yield f"Attributed causes of the collisions{of}", _describe_attribution(own.causes)


def _compared(comparison: CompareResultsResult | None) -> tuple[Comparison, ...]:
    return comparison.comparisons if comparison is not None else ()


def _verdict(comparison: Comparison) -> str:
    """Return the verdict with the metrics' names in words."""
    words = {name: metric_words(name) for name in sorted(RunMetrics.model_fields, key=len, reverse=True)}
    return re.sub("|".join(map(re.escape, words)), lambda found: words[found[0]], comparison.verdict)


def _describe_success(result: AnalyzeResultsResult) -> str:
    """Return the share of runs that reached the goal, for each configuration separately."""
    if result.success is not None:
        return f"{_reached(result.success)} reached the goal"
    return "; ".join(
        f"{group.name}: {_reached(group.success)} reached the goal{_describe_other_outcomes(group)}"
        for group in result.groups
    )


def _describe_other_outcomes(group: Group) -> str:
    """Return the outcomes of the runs that did not reach the goal, as the end of a sentence; may be empty."""
    failed = [f"{count} {key.replace('_', ' ')}" for key, count in group.outcomes.items() if key != "goal_reached"]
    return f"; other outcomes: {', '.join(failed)}" if failed else ""


def _reached(rate: Rate) -> str:
    if rate.share is None or rate.low is None or rate.high is None:
        return "0 runs (all problems are invalid)"
    interval = f"95% interval {100 * rate.low:.0f} to {100 * rate.high:.0f}%"
    return f"{rate.count} of {rate.of} valid runs ({100 * rate.share:.0f}%, {interval})"


def _describe_failures(result: AnalyzeResultsResult) -> str:
    failed = [
        f"{one.count} {one.outcome.replace('_', ' ')}" for one in result.outcomes if one.outcome != "goal_reached"
    ]
    invalid = [f"{result.invalid_count} invalid, which count in no rate"] if result.invalid_count else []
    return f"; other outcomes: {', '.join(failed)}" * bool(failed) + "".join(f"; {one}" for one in invalid)


def _by_any_motion(result: AnalyzeResultsResult) -> str:
    """Return a sentence with the rate by the paper's rule; empty if no motion to the goal was refused."""
    rate = result.by_any_motion
    return "" if rate is None else f" By the paper's rule, which accepts any motion: {_reached(rate)}."


def causes_in_words(causes: CollisionCauses | None) -> str:
    """Return a sentence on who caused the collisions, according to the reference drivers."""
    if causes is None:
        return "There was no collision with a known course."
    none = len(causes.not_preventable)
    kinds = ", ".join(f"{count} {kind_in_words(kind)}" for kind, count in causes.kinds.items())
    others = f"; in {causes.from_behind} another hit the ego from behind" if causes.from_behind else ""
    recorded = (
        ", on a recorded motion that does not react to the ego"
        if causes.from_behind and causes.recorded_traffic
        else ""
    )
    edge = ", including the road's edge" if "road_boundary" in causes.kinds else ""
    sample = f"; a random {causes.looked_at} of them were judged" if causes.is_sample else ""
    own = causes.laid_to.get("ego", 0)
    prevented = sum(one.preventable is True and one.laid_to != "ego" for one in causes.evidence)
    made = f" The ego alone caused {own}." if own else ""
    learn = f", so the planner could have avoided {'it' if prevented == 1 else 'these'}" if prevented else ""
    left = causes.success_without
    runs = "this run" if none == 1 else "these runs"
    without = f" Without {runs}, {_reached(left)} reached the goal." if none and left is not None else ""
    rest = f"the other {none}" if none < causes.judged else "it" if none == 1 else f"these {none}"
    unpreventable = (
        f" No reference driver prevents {rest} ({REFERENCE_DRIVERS_DO}){others}{recorded}.{without}" if none else ""
    )
    judged = (
        f" A reference driver in the ego's place prevents {prevented} of {counted(causes.judged, 'judged collision')}"
        f"{learn}."
        if causes.judged
        else ""
    )
    return f"{counted(causes.collisions, 'collision')}{edge} ({kinds}{sample}).{judged}{made}{unpreventable}"


def _describe_attribution(causes: CollisionCauses) -> str:
    """Return text on how many collisions are attributed to each cause."""
    phrases: dict[CollisionCause, str] = {
        "ego": "to the ego itself",
        "recording": "to recorded traffic that does not react",
        "perception": "to the sensors",
        "prediction": "to the prediction",
        "planning": "to the plan",
        "neither": "to neither side",
    }
    return f"{', '.join(f'{count} {phrases[cause]}' for cause, count in causes.laid_to.items())}."


def _describe_next_step(result: AnalyzeResultsResult, names: Mapping[str, str]) -> str:
    """Return the analysis's next step, and the first changes that the findings suggest, tried or not."""
    given = result.answer().next_step
    hints = [one.suggestion for one in result.findings if one.suggestion is not None][:_SHOWN_HINTS]
    parts = [
        f"{hint.direction} {hint.weight} of {names.get(hint.config_id, hint.config_id)} ({hint.why}; "
        f"{'untried so far' if hint.tried is None else hint.tried.in_words()})"
        for hint in hints
    ]
    return "; ".join([*([given] if given else []), *parts]) or "no failure suggests a change"


_SHOWN_HINTS = 2
"""Most suggested changes in the overview; the findings list all (chosen)."""


def _by_configuration(result: AnalyzeResultsResult) -> ReportTable:
    def row(group: Group) -> tuple[str, ...]:
        rate = group.success
        known = rate.share is not None and rate.low is not None and rate.high is not None
        return (
            group.name,
            str(rate.of),
            f"{rate.count} ({100 * (rate.share or 0):.0f}%)" if known else "–",
            f"{100 * (rate.low or 0):.0f} to {100 * (rate.high or 0):.0f}%" if known else "–",
            ", ".join(
                f"{key.replace('_', ' ')} {count}" for key, count in group.outcomes.items() if key != "goal_reached"
            )
            or "none",
            str(group.invalid),
        )

    return ReportTable(
        caption="By configuration",
        columns=("configuration", "valid runs", "goal reached", "95% interval", "failures", "invalid"),
        rows=tuple(row(group) for group in result.groups),
    )


def rules_section(result: AnalyzeResultsResult) -> ReportSection:
    """Return a section on how many runs broke each traffic rule, by configuration.

    It also lists the rules that applied to no run.
    """
    several = len({one.config_id for one in result.rule_shares}) > 1
    applicable = [one for one in result.rule_shares if one.violated.of]
    absent = dict.fromkeys(f"{one.rule} {one.name}" for one in result.rule_shares)
    for one in applicable:
        absent.pop(f"{one.rule} {one.name}", None)
    table = ReportTable(
        caption="Runs that broke a rule, out of the runs to which it applies",
        columns=("rule", *(["configuration"] if several else []), "broken in", "95% interval", "worst excess", "run"),
        rows=tuple(
            (
                f"{one.rule} {one.name}",
                *([one.config_name] if several else []),
                f"{one.violated.count} of {one.violated.of}",
                f"{100 * (one.violated.low or 0):.0f} to {100 * (one.violated.high or 0):.0f}%",
                "–" if one.worst is None else f"{figure(one.worst)} {one.unit}",
                one.run_ids[0] if one.run_ids else "–",
            )
            for one in sorted(applicable, key=lambda one: one.rule)
        ),
    )
    none = [f"These rules applied to no run: {', '.join(absent)}."] if absent else []
    return ReportSection(
        title="Traffic rules",
        asked="which traffic rules the runs broke, and by how much",
        text=(*none, *result.notes),
        tables=(table,),
    )


def run_section(
    record: RunRecord, analysis: AnalyzeResultsResult, measures: Sequence[MeasuredValue] = ()
) -> ReportSection:
    """Return a section on one run: outcome, nearness to others, largest motions, and broken traffic rules."""
    review, sentences = analysis.review, list[str]()
    if review is not None:
        near = [review.nearness_in_words()] if review.contact is None and review.closest is not None else []
        sentences = [*near, review.motion_in_words()]
    broken = [verdict.in_words() for verdict in analysis.rules if verdict.violated]
    sentences += [f"Traffic rules broken: {'; '.join(broken)}."] if broken else []
    sentences += [f"Also: {excesses_in_words(record.beyond_vehicle)}."] if record.beyond_vehicle else []
    return ReportSection(
        title=f"One run in detail: {record.run_id}",
        asked=f"{record.config_name} on {record.scenario_id}",
        text=(f"Ending: {ending(record.outcome, record.reason, review)}.", *filter(None, sentences)),
        tables=(_measured(measures),) if measures else (),
    )


MEASURED_CAPTION = "Measures of the run; terms are explained at the end"


def _measured(measures: Sequence[MeasuredValue]) -> ReportTable:
    """Return a row per measure: its name, its value (or why it is missing), the road user and the time."""

    def row(one: MeasuredValue) -> tuple[str, ...]:
        known = measure_named(one.name)
        words = metric_words(one.name).partition(" (")[0]
        name = words if known is None or not known.abbreviation else f"{words} ({known.abbreviation})"
        value = f"not available: {one.why}" if one.value is None else measured_figure(one)
        moment = "–" if one.time_s is None else f"{one.time_s:.1f} s"
        return name, f"{value} ({one.note})" if one.note else value, one.partner or "–", moment

    return ReportTable(
        caption=MEASURED_CAPTION,
        columns=("measure", "value", "other", "when"),
        rows=tuple(row(one) for one in measures),
    )


def batch_section(batch: BatchRecord, runs: Sequence[RunRecord]) -> ReportSection:
    """Return a section on every run of a batch with its outcome, the reason and its figures, failures first."""
    measured = ("distance (m)", "time to collision (s)", "jerk (m/s³)")
    order = {"goal_reached": 1, "invalid": 2}
    table = ReportTable(
        caption="Failures first. Time to collision and distance are the smallest of the run, jerk the largest.",
        columns=("run", "scenario", "configuration", "outcome", "why", *measured),
        rows=tuple(_run_row(run) for run in sorted(runs, key=lambda run: order.get(run.outcome, 0))),
    )
    return ReportSection(
        title=f"All runs of {batch.batch_id}",
        text=tuple(f"Lost: {cell.scenario_id} under {cell.config_id}: {cell.error}" for cell in batch.lost),
        tables=(table,),
    )


def comparison_section(result: CompareResultsResult) -> ReportSection:
    """Return a section with verdicts, tests and flips."""
    return ReportSection(
        title="Comparison",
        asked=" against ".join(side.label for side in result.sides),
        text=(*(f"{one.after} against {one.before}: {_verdict(one)}" for one in result.comparisons), *result.notes),
        tables=tuple(table for comparison in result.comparisons for table in _comparison_tables(comparison)),
    )


def analysis_section(result: AnalyzeResultsResult) -> ReportSection:
    """Return a section with findings and the runs that they are based on."""
    findings, hints = list[str](), list[str]()
    for finding in result.findings:
        else_ = f" Alternative explanation: {finding.alternatives}." if finding.alternatives else ""
        findings.append(f"{finding.statement}{else_} Evidence: {', '.join(finding.run_ids)}.")
        hint = finding.suggestion
        if hint is not None:
            tried = "untried" if hint.tried is None else hint.tried.in_words()
            hints.append(f"Suggested: {hint.direction} {hint.weight} of {hint.config_id}: {hint.why}; {tried}.")
    return ReportSection(
        title="Findings",
        asked=f"what {', '.join(result.results)} shows",
        text=result.notes,
        findings=(*findings, *hints),
    )


def report_image(image: RenderedImage, caption: str) -> ReportImage:
    """Return a drawn picture with its caption."""
    return ReportImage(path=image.path, caption=caption, alt_text=image.alt_text)


def _describe_request(recipe: Recipe) -> str:
    given = [(key, value) for key, value in sorted(recipe.arguments.items()) if value not in (None, [], {}, "")]
    shown = ", ".join(f"{key} {json.dumps(value, ensure_ascii=False)}" for key, value in given if key != "map_content")
    return f"{recipe.tool}: {shown}" if shown else recipe.tool


def _describe_facts(facts: ScenarioFacts) -> str:
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
        yield "lanelets to the goal", " → ".join(map(str, ego.route)) or "no route on the lanelets"
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
    shared = [one for one in comparison.weights if one.before is not None and one.after is not None]
    if shared:
        yield ReportTable(
            caption=f"{comparison.after} against {comparison.before}: the configurations differ in",
            columns=("weight", "before", "after"),
            rows=tuple((one.weight, _figure(one.before, 3), _figure(one.after, 3)) for one in shared),
        )
    flips = (*comparison.to_success, *comparison.to_failure)
    if flips:
        yield ReportTable(
            caption=f"Scenarios that only one side solves: {comparison.to_success_count} to success, "
            f"{comparison.to_failure_count} to failure",
            columns=("scenario", "before", "after", "why"),
            rows=tuple(
                (flip.scenario_id, flip.before.replace("_", " "), flip.after.replace("_", " "), flip.why or "–")
                for flip in flips
            ),
        )
    yield ReportTable(
        caption="Paired by scenario: median before and after, shift with its 95% interval, Wilcoxon's p. A side is "
        "better only if p after Holm's adjustment is below 0.05 and the shift exceeds the resolution.",
        columns=("metric", "pairs", "before", "after", "shift", "p", "p after Holm", "better"),
        rows=tuple(
            (
                f"{metric_words(test.name)} ({test.unit})" if test.unit else metric_words(test.name),
                str(test.pairs),
                _figure(test.median_before),
                _figure(test.median_after),
                f"{_figure(test.shift)} [{_figure(test.low)}, {_figure(test.high)}]",
                _p_value(test.p),
                _p_value(test.p_holm),
                {"before": comparison.before, "after": comparison.after, None: "–"}[test.better],
            )
            for test in comparison.metrics
        ),
    )


def _figure(value: float | None, digits: int = 2) -> str:
    return "–" if value is None else f"{round(value, digits) + 0.0:.{digits}f}"  # + 0.0: no minus sign before a zero


_LEAST_P = 0.001


def _p_value(p: float | None) -> str:
    return f"<{_LEAST_P:g}" if p is not None and p < _LEAST_P else _figure(p, 3)


@dataclass(frozen=True)
class _Embedded:
    """A picture as embedded in the page."""

    data_uri: str
    caption: str
    alt_text: str
    width_px: int
    height_px: int


def write_report(request: ReportRequest, report: ProgressReporter) -> ReportWritten:
    """Write the page; pictures become data URIs, and all text is escaped.

    Raises:
        ResourceFailure: A picture cannot be read, or the page cannot be written.
        UnsafeInput: A picture is not a PNG or GIF, or larger than 8 MB.
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
        report=request, sections=list(zip(request.sections, images, strict=True)), words=words_used(request.sections)
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
        raise ResourceFailure(f"The picture {shown_name(path.name)} cannot be read: {error.strerror}") from error
    media_type = next((kind for start, kind in _MEDIA_TYPES.items() if content.startswith(start)), None)
    if media_type is None or len(content) > _LARGEST_IMAGE_BYTES:
        raise UnsafeInput(f"{shown_name(path.name)} is not a PNG or GIF of at most {_LARGEST_IMAGE_BYTES:,} bytes")
    with Image.open(path) as opened:
        width, height = opened.size
    encoded = base64.b64encode(content).decode("ascii")
    return _Embedded(f"data:{media_type};base64,{encoded}", image.caption, image.alt_text, width, height)
