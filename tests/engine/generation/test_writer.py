import math

import numpy as np
import pytest

from plannerforge.engine.generation.writer import first_yaw_rate_radps
from plannerforge.engine.vehicles.motion import Motion


@pytest.mark.parametrize(
    ("headings_rad", "rate_radps"),
    [((0.5, 0.5, 0.9), 0.0), ((0.1, 0.15), 0.5), ((math.pi - 0.01, -math.pi + 0.01), 0.2), ((1.0,), 0.0)],
    ids=["straight on", "turning left", "over the end of the circle", "there for one step"],
)
def test_an_ego_begins_with_the_yaw_rate_of_its_recording(headings_rad: tuple[float, ...], rate_radps: float) -> None:
    nothing = np.zeros(len(headings_rad))
    motion = Motion(np.zeros((len(headings_rad), 2)), np.array(headings_rad), nothing, nothing)
    assert first_yaw_rate_radps(motion) == pytest.approx(rate_radps)
