"""What a stored run's figures may be."""

import pytest
from pydantic import ValidationError
from support.runs import metrics

from plannerforge.schemas.measures import RunMetrics


@pytest.mark.parametrize("value", [1e151, -1e300])
def test_a_figure_without_a_finite_square_is_refused(value: float) -> None:
    with pytest.raises(ValidationError):
        RunMetrics.model_validate(metrics().model_dump() | {"mean_squared_jerk": value})
