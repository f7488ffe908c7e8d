"""``responsibility`` is another measure than ``prediction``, over the candidates of starter scenarios."""

import pytest

from plannerforge.evals.planners.responsibility import Collected, collected_terms, scenario_files

EVERY = 3
"""Every third starter scenario and its first plan only: the whole is ``make bench-responsibility``."""


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Collected:
    starter = list(scenario_files(None, 0, tmp_path_factory.mktemp("starter")))
    return collected_terms(starter[::EVERY], most_plans=1)


def test_the_rank_correlation_with_prediction_stays_under_0_8(found: Collected) -> None:
    assert found.scenarios >= 8
    assert found.either.sum() > 1000
    assert 0.0 < found.spearman() < 0.8
    assert found.spearman_with_either() < 0.8


def test_a_term_that_is_the_other_one_again_would_be_seen(found: Collected) -> None:
    copied = Collected(prediction=found.prediction, responsibility=[2.0 * value for value in found.prediction])
    assert copied.spearman() == pytest.approx(1.0)
