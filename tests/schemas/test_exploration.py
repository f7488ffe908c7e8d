"""Parameters of logical scenarios."""

import pytest

from plannerforge.schemas.exploration import Parameter


@pytest.mark.parametrize(
    ("name", "unit", "title"),
    [
        ("ego_speed_mps", "m/s", "ego speed (m/s)"),
        ("deceleration_mps2", "m/s²", "deceleration (m/s²)"),
        ("headway_s", "s", "headway (s)"),
        ("lanes", "", "lanes"),
        ("s", "s", "s (s)"),
        ("phase_s", "", "phase s"),
    ],
)
def test_a_title_states_the_unit_once(name: str, unit: str, title: str) -> None:
    assert Parameter(name=name, low=0.0, high=1.0, unit=unit).title == title


def test_a_stated_value_has_its_quantity_and_its_unit() -> None:
    assert Parameter(name="ego_speed_mps", low=0.0, high=30.0, unit="m/s").stated(13.888) == "ego speed 13.9 m/s"
