"""``responsibility`` is another measure than ``prediction``, over the candidates of starter scenarios."""

import pytest

from benchmarks.planners.responsibility import Collected, collected_terms, starter_and_spread_files

EVERY = 3
"""Every third starter scenario and its first plan only: the whole is ``make bench-responsibility``."""


@pytest.fixture(scope="module")
def collected(tmp_path_factory: pytest.TempPathFactory) -> Collected:
    starter = list(starter_and_spread_files(None, 0, tmp_path_factory.mktemp("starter")))
    return collected_terms(starter[::EVERY], most_plans=1)


def test_the_rank_correlation_with_prediction_stays_under_0_8(collected: Collected) -> None:
    assert collected.scenarios >= 8
    assert collected.either.sum() > 1000
    assert 0.0 < collected.spearman() < 0.8
    assert collected.spearman_with_either() < 0.8


def test_a_term_that_is_the_other_one_again_would_be_seen(collected: Collected) -> None:
    copied = Collected(prediction=collected.prediction, responsibility=[2.0 * value for value in collected.prediction])
    assert copied.spearman() == pytest.approx(1.0)
