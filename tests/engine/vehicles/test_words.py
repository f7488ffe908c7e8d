"""Words that languages have for the classes of road users."""

import pytest

from plannerforge.engine.vehicles import PEDESTRIAN, vehicle_class_of, vehicle_classes
from plannerforge.schemas.generation import GenerateScenariosArguments
from plannerforge.workflows.generation.specification import read_specification


@pytest.mark.parametrize("name", [*vehicle_classes(), PEDESTRIAN.name])
def test_a_class_means_itself_in_any_number_and_case(name: str) -> None:
    assert {vehicle_class_of(word) for word in (name, name.upper(), f"{name}s")} == {name}


@pytest.mark.parametrize(
    ("word", "meant"),
    [
        *(("vans", "delivery"), ("lorries", "truck"), ("cab", "taxi"), ("bike", "bicycle"), ("scooter", "moped")),
        *(("Sedan", "car"), ("fire engine", "emergency"), ("articulated lorry", "trailer"), ("dump truck", "truck")),
        *(("LKW", "truck"), ("Krankenwagen", "emergency"), ("vélo", "bicycle"), ("otobüs", "bus"), ("卡车", "truck")),
        *(("грузовик", "truck"), ("自転車", "bicycle"), ("pikipiki", "motorcycle"), ("taksówka", "taxi")),
        *(
            ("PKW", "car"),
            ("Wagen", "car"),
            ("vrachtwagen", "truck"),
            ("Feuerwehr", "emergency"),
            ("piéton", "pedestrian"),
        ),
        *(("furgoneta", "delivery"), ("camionnette", "delivery"), ("bromfiets", "moped"), ("машина", "car")),
        *(("트럭", "truck"), ("вантажівка", "truck"), ("کامیون", "truck"), ("xe tải", "truck")),
        *(("승용차", "car"), ("कार", "car"), ("ट्रक", "truck"), ("ট্রাক", "truck"), ("കാർ", "car"), ("ماشین", "car")),
        *(("hgv", "truck"), ("passenger", "car"), ("priorityVehicle", "emergency"), ("person", "pedestrian")),
    ],
)
def test_words_of_languages_and_of_the_field(word: str, meant: str) -> None:
    assert vehicle_class_of(word) == meant


@pytest.mark.parametrize(
    "word",
    ["spaceship", "", "not", "start", "bill", "wheel", "drive", "vehicle", "112", "compact", "टर्की", "차량", "운전"],
)
def test_a_word_that_mostly_means_something_else_is_not_a_road_user(word: str) -> None:
    assert vehicle_class_of(word) is None


def test_a_class_given_by_another_word_is_generated_and_reported() -> None:
    arguments = GenerateScenariosArguments(place="Musterstadt", vehicles=["van=2", "police car", "truck"])
    notes = read_specification(arguments).notes
    assert notes == ("'van' is read as delivery", "'police car' is read as emergency")
