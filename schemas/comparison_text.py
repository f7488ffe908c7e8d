"""The compact text of a comparison."""

from plannerforge.schemas.comparison import CompareResultsResult, Comparison, Flip, MetricTest
from plannerforge.schemas.results_text import figure


def comparison_text(result: CompareResultsResult) -> str:
    """One block a comparison, the verdict first."""
    lines = [line for comparison in result.comparisons for line in _comparison(comparison)]
    return "\n".join([*lines, *(f"Note: {note}" for note in result.notes)])


def _comparison(found: Comparison) -> list[str]:
    test = found.success
    lines = [f"{found.after} against {found.before}: {found.verdict}"]
    interval = ""
    if test.difference is not None and test.low is not None and test.high is not None:
        low, high = 100 * test.low, 100 * test.high
        interval = f", difference {100 * test.difference:+.0f} points (95 %: {low:+.0f} to {high:+.0f})"
    lines.append(
        f"- {test.pairs} pairs: both reach the goal {test.both}, only before {test.only_before}, "
        f"only after {test.only_after}, neither {test.neither}{interval}; McNemar exact {_p(test.p, test.p_holm)}"
    )
    lines += _flips("to success", found.to_success, found.to_success_count)
    lines += _flips("to failure", found.to_failure, found.to_failure_count)
    lines += [_metric(metric) for metric in found.metrics]
    if found.weights:
        changes = ", ".join(f"{c.weight} {figure(c.before)} → {figure(c.after)}" for c in found.weights)
        lines.append(f"- weights changed: {changes}")
    if found.conditions:
        lines.append(f"- the sides also differ in {'; '.join(found.conditions)}")
    if found.unpaired or found.invalid_pairs:
        lines.append(
            f"- left out: {found.unpaired} runs without a partner, {found.invalid_pairs} pairs with an invalid run"
        )
    return lines


def _flips(title: str, flips: tuple[Flip, ...], count: int) -> list[str]:
    if not count:
        return []
    shown = "; ".join(
        f"{flip.scenario_id} {flip.before} → {flip.after} ({flip.before_run}, {flip.after_run})" for flip in flips
    )
    more = f" and {count - len(flips)} more" if count > len(flips) else ""
    return [f"- flipped {title} ({count}): {shown}{more}"]


def _metric(metric: MetricTest) -> str:
    over = "pairs that both reached the goal" if metric.basis == "both_reached_goal" else "valid pairs"
    if metric.pairs == 0:
        return f"- {metric.name}: defined on none of the {over}"
    interval = ""
    if metric.low is not None and metric.high is not None:
        interval = f" (95 %: {figure(metric.low)} to {figure(metric.high)})"
    better = f", better: {metric.better}" if metric.better else ""
    return (
        f"- {metric.name} [{metric.unit}]: median {figure(metric.median_before)} → {figure(metric.median_after)}, "
        f"shift {figure(metric.shift)}{interval}, effect {figure(metric.effect, 2)}, {_p(metric.p, metric.p_holm)}"
        f"{better} (n={metric.pairs} {over})"
    )


def _p(p: float | None, p_holm: float | None) -> str:
    if p is None:
        return "no test"
    return f"p={figure(p)}" if p_holm is None else f"p={figure(p)} (Holm {figure(p_holm)})"
