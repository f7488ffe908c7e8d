"""The bench of statistics: its batches are what it says of them, and its figures can be wrong."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.analysis.nulls import drawn, measure
from benchmarks.harness import SeededBench
from plannerforge.engine.analysis.statistics import PairedShares


def success(records: tuple[object, ...]) -> float:
    return float(np.mean([getattr(record, "outcome") == "goal_reached" for record in records]))  # noqa: B009


def test_sides_of_null_batches_have_the_true_share_and_planted_ones_the_shift() -> None:
    for gain in (0.0, 1.4):
        batches = list(drawn(5, 60, gain))
        means = [np.mean([success(batch.sides[side]) for batch in batches]) for side in (0, 1)]
        assert means == pytest.approx(list(batches[0].truth), abs=0.03)
        assert (batches[0].truth[1] > batches[0].truth[0]) == (gain > 0)


def test_the_same_seed_draws_the_same_batches() -> None:
    assert next(drawn(7, 1, 0.0)) == next(drawn(7, 1, 0.0))
    assert next(drawn(7, 1, 0.0)) != next(drawn(8, 1, 0.0))


def test_a_comparison_that_sees_differences_everywhere_is_found_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = SeededBench(tmp_path, tmp_path, seed=3, limit=4)
    honest = measure(bench)
    assert honest["null_batches"] == 4
    assert float(honest["false_findings_rate"]) <= 0.25
    monkeypatch.setattr(
        "plannerforge.engine.analysis.comparison.paired_shares", lambda flips: PairedShares(0.5, 0.4, 0.6, 0.0001)
    )
    assert measure(bench)["false_findings_rate"] == 1.0
