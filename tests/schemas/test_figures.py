"""How numbers are written in answers."""

import pytest

from plannerforge.schemas.text import figure, measured, p_figure, p_in_words


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (0.0, "0"),
        (5e-324, "0"),
        (-3e-310, "0"),
        (1e-5, "0"),
        (-4e-4, "0"),
        (0.0123, "0.0123"),
        (1234.5, "1234"),
    ],
)
def test_a_value_below_the_resolution_of_its_quantity_is_0(value: float | None, text: str) -> None:
    assert measured(value) == text


def test_a_plain_figure_keeps_small_numbers_and_drops_denormal_ones() -> None:
    assert figure(1e-5) == "1e-05"
    assert figure(2.2e-308) == "0"


@pytest.mark.parametrize(
    ("p", "text"), [(None, "no test"), (0.0, "p<1e-12"), (1e-300, "p<1e-12"), (3e-11, "p=3e-11"), (1.0, "p=1")]
)
def test_no_p_value_is_0(p: float | None, text: str) -> None:
    assert p_in_words(p) == text


def test_a_bound_of_p_is_shown_without_its_name() -> None:
    assert (p_figure(0.0), p_figure(0.031)) == ("<1e-12", "0.031")
