import pytest

from plannerforge.engine.cosimulation.manoeuvres import required_gap_m


@pytest.mark.parametrize(("closing_mps", "gap_m"), [(-10.0, 0.0), (0.0, 0.0), (6.0, 9.9), (12.0, 25.8)])
def test_the_gap_that_is_needed_grows_with_the_speed_at_which_it_closes(closing_mps: float, gap_m: float) -> None:
    assert required_gap_m(closing_mps) == pytest.approx(gap_m)
