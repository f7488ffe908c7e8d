"""Words that users have for vehicle classes and presets mean one thing each, in several languages."""

from collections import defaultdict

import pytest

from plannerforge.engine.tuning import changed_configuration, preset_configuration
from plannerforge.engine.vehicles import vehicle_classes
from plannerforge.schemas.errors import UnknownName
from plannerforge.schemas.generation import GenerateScenariosArguments
from plannerforge.schemas.vocabulary import preset_of, synonyms, vehicle_class_of
from plannerforge.workflows.generation.specification import read_specification


def test_every_word_means_one_thing() -> None:
    meanings = defaultdict(set)
    for word, meaning in synonyms():
        meanings[word].add(meaning)
    assert {word: found for word, found in meanings.items() if len(found) > 1} == {}


def test_every_class_of_a_request_has_its_words() -> None:
    assert {meant for word, _ in synonyms() if (meant := vehicle_class_of(word))} == {*vehicle_classes(), "pedestrian"}


@pytest.mark.parametrize(
    ("word", "meant"),
    [
        *(("van", "delivery"), ("Ambulance", "emergency"), ("police", "emergency"), ("LKW", "truck")),
        *(("camión", "truck"), ("грузовик", "truck"), ("卡车", "truck"), ("Fahrrad", "bicycle"), ("vélo", "bicycle")),
        *(("scooter", "moped"), ("cab", "taxi"), ("vans", "delivery"), ("spaceship", None), ("", None)),
    ],
)
def test_words_for_vehicles(word: str, meant: str | None) -> None:
    assert vehicle_class_of(word) == meant


@pytest.mark.parametrize(
    ("word", "meant"), [("komfort", "comfort"), ("Sportlich", "sporty"), ("舒适", "comfort"), ("plaid", None)]
)
def test_words_for_presets(word: str, meant: str | None) -> None:
    assert preset_of(word) == meant


def test_a_class_by_another_word_is_generated_and_said() -> None:
    arguments = GenerateScenariosArguments(place="Musterstadt", vehicles=["van=2", "police car", "truck"])
    notes = read_specification(arguments).notes
    assert notes == ("'van' is taken as delivery", "'police car' is taken as emergency")


def test_a_preset_by_another_word_is_said() -> None:
    made, notes = changed_configuration(preset_configuration("frenetix"), "komfort", [])
    assert made.preset == "Comfort"
    assert "'komfort' is taken as the preset Comfort" in notes
    with pytest.raises(UnknownName, match="there is no preset 'plaid'"):
        changed_configuration(made, "plaid", [])
