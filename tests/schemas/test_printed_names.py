"""Names of measures as answers, tables and legends print them, taken as arguments."""

import pytest

from plannerforge.schemas.analysis.comparison import CompareResultsArguments
from plannerforge.schemas.measures import MEASURES, RunMetrics, metric_of_label
from plannerforge.schemas.results import _short_words


@pytest.mark.parametrize("measure", MEASURES, ids=lambda measure: measure.name)
def test_a_printed_name_means_its_measure(measure: object) -> None:
    names = {one.name: one for one in MEASURES}
    printed = (measure.name, _short_words(measure.name), measure.abbreviation)  # type: ignore[attr-defined]
    for text in filter(None, printed):
        assert _short_words(names[metric_of_label(text)].name) == _short_words(measure.name)  # type: ignore[attr-defined]


def test_compared_metrics_are_named_as_they_are_printed() -> None:
    stored = [one for one in MEASURES if one.name in RunMetrics.model_fields]
    for one in stored:
        arguments = CompareResultsArguments.model_validate({"metrics": [one.words.upper()]})
        assert arguments.metrics == [one.name]
    with pytest.raises(ValueError, match="metrics"):
        CompareResultsArguments.model_validate({"metrics": ["risk_scoer"]})
