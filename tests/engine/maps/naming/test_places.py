"""Spellings of places and countries."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plannerforge.engine.maps.naming.gazetteer import names_elsewhere
from plannerforge.engine.maps.naming.places import country_code, country_name, place_keys

STORED = ["Munich", "Nuremberg", "Moelln", "Carcarana", "SantBoideLlobregat", "Bilderstoeckchen", "Beijing", "US101"]


def same_place(wanted: str) -> list[str]:
    """The stored places that the wanted one may mean."""
    return [place for place in STORED if names_elsewhere(wanted) & place_keys(place)]


@pytest.mark.parametrize(
    ("typed", "stored"),
    [
        ("München", "Munich"),
        ("muc", "Munich"),
        ("Nürnberg", "Nuremberg"),
        ("Mölln", "Moelln"),
        ("molln", "Moelln"),
        ("Carcarañá", "Carcarana"),
        ("Sant Boi de Llobregat", "SantBoideLlobregat"),
        ("Bilderstöckchen", "Bilderstoeckchen"),
        ("Peking", "Beijing"),
        ("北京", "Beijing"),
        ("Μόναχο", "Munich"),
        ("Мюнхен", "Munich"),
        ("US 101", "US101"),
    ],
)
def test_other_spellings_mean_the_stored_place(typed: str, stored: str) -> None:
    assert same_place(typed) == [stored]


def test_a_decomposed_umlaut_is_the_same_letter() -> None:
    assert same_place("Mo\u0308lln") == ["Moelln"]


def test_another_place_is_not_mistaken() -> None:
    assert same_place("Bremen") == []


@given(st.text(max_size=40))
def test_any_text_has_keys_without_failing(text: str) -> None:
    assert all(key for key in place_keys(text))


@pytest.mark.parametrize(
    ("typed", "code"),
    [
        *(("DEU", "DEU"), ("deu", "DEU"), ("Germany", "DEU"), ("Österreich", "AUT"), ("uk", "GBR"), ("JPN", "JPN")),
        *(
            ("德国", "DEU"),
            ("Германия", "DEU"),
            ("日本", "JPN"),
            ("Albanien", "ALB"),
            ("Honduras", "HND"),
            ("fl", "LIE"),
        ),
        *(("США", "USA"), ("America", "USA"), ("Great Britain", "GBR"), ("Schottland", "GBR"), ("UAE", "ARE")),
        *(("Bundesrepublik Deutschland", "DEU"), ("GER", "DEU"), ("Korea", "KOR"), ("Zamunda", "ZAM")),
        *(("Shqipëria", "ALB"), ("Gambia", "GMB"), ("ZAM", "ZAM"), ("ALB", "ALB")),
    ],
)
def test_countries_by_code_or_name(typed: str, code: str) -> None:
    assert country_code(typed) == code


@pytest.mark.parametrize("typed", ["", "Atlantis", "12", "D3U", "van", "XQZ"])
def test_no_country(typed: str) -> None:
    assert country_code(typed) is None


@pytest.mark.parametrize(
    ("code", "name"),
    [("VEN", "Venezuela"), ("MDA", "Moldova"), ("KOR", "Korea, Republic of"), ("DEU", "Germany"), ("XYZ", "XYZ")],
)
def test_a_country_has_its_usual_name(code: str, name: str) -> None:
    assert country_name(code) == name
