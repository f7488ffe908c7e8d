"""Settlements by their names in any language, and countries by the CLDR's."""

import gzip
import json
from pathlib import Path

import pytest

from plannerforge.engine.maps.naming import gazetteer
from plannerforge.engine.maps.naming.gazetteer import names_elsewhere, settlements_called
from plannerforge.engine.maps.naming.places import country_code, place_keys


@pytest.mark.parametrize("typed", ["Прага", "布拉格", "prag", "PRAHA", "Πράγα"])
def test_a_city_is_known_by_its_names_in_other_languages(typed: str) -> None:
    largest = settlements_called(typed)[0]
    assert (largest.name, largest.country) == ("Prague", "CZE")
    assert names_elsewhere(typed) & place_keys("Praha")


@pytest.mark.parametrize("typed", ["Kreiselheim", "", "x" * 500, "\x00", '"name"', "latitude"])
def test_a_name_that_is_not_a_settlement_is_unknown(typed: str) -> None:
    assert settlements_called(typed) == ()


def test_of_several_settlements_of_a_name_the_largest_comes_first() -> None:
    found = settlements_called("Cambridge")
    assert {one.country for one in found} >= {"GBR", "USA", "CAN"}
    assert [one.population for one in found] == sorted((one.population for one in found), reverse=True)


def test_a_larger_settlement_reaches_further_and_its_outskirts_further_still() -> None:
    (small,), large = settlements_called("Titz"), settlements_called("München")[0]
    assert small.reach_m() < large.reach_m() < large.reach_m(wide=True)
    assert 1000 < small.reach_m() < 2000


def test_every_country_of_the_table_is_in_iso_3166() -> None:
    table = json.loads(gzip.decompress((Path(gazetteer.__file__).parent / "country_names.json.gz").read_bytes()))
    assert table["source"].startswith("CLDR")
    assert len(table["names"]) > 240
    assert all(country_code(code) == code for code in table["names"])


@pytest.mark.parametrize(
    ("typed", "code"),
    [
        ("Saksa", "DEU"),
        ("Ausztria", "AUT"),
        ("프랑스", "FRA"),
        ("Ấn Độ", "IND"),
        ("العراق", "IRQ"),
        ("Hiszpania", "ESP"),
    ],
)
def test_a_country_is_known_by_its_name_in_any_language(typed: str, code: str) -> None:
    assert country_code(typed) == code
