"""Parameters of logical scenarios."""

import pytest

from plannerforge.schemas.exploration import Evaluation, Parameter
from plannerforge.schemas.reviews import ContactKind


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


@pytest.mark.parametrize(
    ("contact", "drivers"),
    [("rear_end_by_ego", ("fsm",)), ("cut_in_by_ego", ("r157_careful", "fsm")), (None, ("r157_careful", "fsm"))],
)
def test_a_collision_is_avoided_by_drivers_that_prevent_it_from_both_starts(
    contact: ContactKind | None, drivers: tuple[str, ...]
) -> None:
    verdicts = (("r157_careful", "start"), ("fsm", "start"), ("fsm", "before_contact"), ("rss", "before_contact"))
    found = Evaluation.model_validate(
        {
            "outcome": "failed_avoidably",
            "reason": "",
            "contact": contact,
            "prevented_by": [{"driver": driver, "start": start} for driver, start in verdicts],
        }
    )
    assert found.avoided_by == drivers
