"""Names of places in benchmark ids: ASCII letters, whatever script the map is written in."""

import pytest

from plannerforge.engine.generation.site_network import plain_name


@pytest.mark.parametrize(
    ("place", "name"),
    [
        ("Krems an der Donau", "KremsAnDerDonau"),
        ("Köln", "Koeln"),
        ("Звёздный", "Zvezdnyi"),
        ("서울특별시", "Seoulteugbyeolsi"),
        ("!?", "Site"),
    ],
)
def test_a_place_is_spelled_in_ascii_letters(place: str, name: str) -> None:
    assert plain_name(place) == name
