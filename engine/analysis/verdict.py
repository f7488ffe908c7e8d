"""What the figures of a comparison allow to say, and what they do not."""

from collections.abc import Sequence

from plannerforge.engine.analysis.paired_tests import FEWEST_PAIRS
from plannerforge.schemas.comparison import MetricTest, SuccessTest

LEVEL = 0.05


def verdict(success: SuccessTest, metrics: Sequence[MetricTest]) -> str:
    """One or two sentences: success first, then the metrics that differ after Holm's adjustment."""
    return " ".join([_about_success(success), *_about_metrics(success, metrics)])


def _about_success(test: SuccessTest) -> str:
    if test.pairs == 0 or test.p is None:
        return "No valid pair: nothing can be compared."
    flips = test.only_before + test.only_after
    if test.pairs < FEWEST_PAIRS:
        same = "none flipped" if flips == 0 else f"{flips} flipped"
        plural = "pair" if test.pairs == 1 else "pairs"
        needed = f"at least {FEWEST_PAIRS} differing pairs are needed"
        return f"{test.pairs} {plural}, {same}: no test can be significant ({needed})."
    if flips == 0:
        return f"No difference in success: none of {test.pairs} pairs flipped."
    if flips < FEWEST_PAIRS:
        return (
            f"No difference in success can be shown: only {flips} of {test.pairs} pairs flipped, "
            f"and fewer than {FEWEST_PAIRS} flips never reach 5 %."
        )
    p = test.p if test.p_holm is None else test.p_holm
    side = "after" if test.only_after > test.only_before else "before"
    if p < LEVEL:
        return (
            f"'{side}' reaches the goal more often: {test.only_after} flips to success, {test.only_before} to failure."
        )
    return f"No difference in success shown ({test.only_after} flips to success, {test.only_before} to failure)."


def _about_metrics(success: SuccessTest, metrics: Sequence[MetricTest]) -> list[str]:
    differing = [test for test in metrics if test.p_holm is not None and test.p_holm < LEVEL]
    if differing:
        words = [
            f"{test.name} {'rises' if (test.shift or 0) > 0 else 'falls'} by {abs(test.shift or 0):.3g} {test.unit}"
            for test in differing
        ]
        return [f"Differs after Holm's adjustment: {'; '.join(words)}."]
    tested = [test for test in metrics if test.p is not None]
    return ["No metric differs significantly."] if tested and success.pairs >= FEWEST_PAIRS else []
