"""The compact text of an analysis: the same as its structured content, in lines that a model or a person reads."""

from collections.abc import Iterable

from plannerforge.schemas.results import AnalyzeResultsResult, Finding, Rate


def percent(share: float | None) -> str:
    """A share as a percentage without decimals; a dash where there is none."""
    return "–" if share is None else f"{100 * share:.0f} %"


def rate_text(rate: Rate) -> str:
    """``6/8 = 75 % (95 %: 41–93 %)``."""
    if rate.share is None or rate.low is None or rate.high is None:
        return f"{rate.count}/{rate.of}"
    return f"{rate.count}/{rate.of} = {percent(rate.share)} (95 %: {100 * rate.low:.0f}–{100 * rate.high:.0f} %)"


def figure(value: float | None, digits: int = 3) -> str:
    """A number with so many significant digits; a dash for None."""
    return "–" if value is None else f"{value:.{digits}g}"


def listed(ids: Iterable[str], most: int = 5) -> str:
    """The first ids, and how many more there are."""
    known = list(ids)
    more = f" +{len(known) - most}" if len(known) > most else ""
    return " ".join(known[:most]) + more


def analysis_text(result: AnalyzeResultsResult) -> str:
    """All sections that are there, one line an item."""
    lines = [] if result.runs == 1 else _rates(result)
    sections = (_rows, _groups, _metrics, _costs, _correlations, _timeline)
    for section in sections:
        lines += section(result)
    if result.findings:
        lines.append("Findings:")
        lines += [finding_text(finding) for finding in result.findings]
    lines += [f"Note: {note}" for note in result.notes]
    return "\n".join(lines)


def _rates(result: AnalyzeResultsResult) -> list[str]:
    valid = result.success.of
    lines = [f"{result.runs} runs ({valid} valid, {result.invalid_count} invalid): goal {rate_text(result.success)}"]
    lines += [
        f"- {item.outcome}: {rate_text(item.rate)} · {listed(item.run_ids, 3)}"
        for item in result.outcomes
        if item.outcome != "goal_reached"
    ]
    return lines + [
        f"- invalid, in no rate: {item.run_id} {item.scenario_id}: {item.reason}" for item in result.invalid
    ]


def finding_text(finding: Finding) -> str:
    """One finding in one line, with evidence and suggestion."""
    parts = [f"- [{finding.name}] {finding.statement}"]
    if finding.suggestion:
        wanted = finding.suggestion
        parts.append(f"Suggest: {wanted.direction} {wanted.weight} of {wanted.config_id} ({wanted.why}).")
    if finding.next_step:
        parts.append(f"Next: {finding.next_step}.")
    parts.append(f"Runs: {listed(finding.run_ids)}")
    return " ".join(parts)


def _groups(result: AnalyzeResultsResult) -> list[str]:
    def line(name: str, rate: Rate, outcomes: dict[str, int], invalid: int) -> str:
        failures = ", ".join(f"{key} {count}" for key, count in outcomes.items() if key != "goal_reached")
        parts = [f"- {name}: goal {rate_text(rate)}", failures, f"invalid {invalid}" if invalid else ""]
        return "; ".join(part for part in parts if part)

    found = [line(group.name, group.success, group.outcomes, group.invalid) for group in result.groups]
    return ["By group:", *found] if found else []


def _metrics(result: AnalyzeResultsResult) -> list[str]:
    if result.runs == 1:
        return ["Metrics: " + ", ".join(f"{i.name} {figure(i.median)} {i.unit}" for i in result.metrics)] * bool(
            result.metrics
        )
    found = [
        f"- {item.name}: median {figure(item.median)}, mean {figure(item.mean)}, "
        f"{figure(item.lowest)}–{figure(item.highest)} {item.unit} (n={item.n})"
        for item in result.metrics
    ]
    return ["Metrics of valid runs:", *found] if found else []


def _costs(result: AnalyzeResultsResult) -> list[str]:
    found = [
        f"- {item.config_name} {item.term}: {percent(item.share)} of the cost, {figure(item.mean_weighted)} a planning "
        f"step (n={item.runs})"
        for item in result.costs
    ]
    return ["Weighted cost terms of the chosen candidates:", *found] if found else []


def _correlations(result: AnalyzeResultsResult) -> list[str]:
    found = [
        f"- success × {item.feature}: ρ={item.rho:+.2f}, p={figure(item.p)}, Holm {figure(item.p_holm)} (n={item.n})"
        for item in result.correlations
    ]
    return ["Spearman correlations:", *found] if found else []


def _rows(result: AnalyzeResultsResult) -> list[str]:
    found = [
        f"- {row.run_id} {row.scenario_id} {row.config_name}: {row.outcome}, {figure(row.duration_s)} s, "
        f"gap {figure(row.minimum_distance_m)} m; {row.reason}"
        for row in result.rows
    ]
    return ["Runs:", *found] if found and result.runs > 1 else [line.removeprefix("- ") for line in found]


def _timeline(result: AnalyzeResultsResult) -> list[str]:
    found = []
    for step in result.timeline:
        gap = f", {step.gap_m:.2f} m to {step.obstacle_id}" if step.gap_m is not None else ""
        cost = f", {step.largest_cost} {percent(step.largest_cost_share)} of the cost" if step.largest_cost else ""
        found.append(f"- {step.time_s:.1f} s: {step.speed_mps:.1f} m/s, {step.acceleration_mps2:+.1f} m/s²{gap}{cost}")
    return ["Before the end:", *found] if found else []
