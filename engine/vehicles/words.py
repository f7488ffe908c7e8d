"""Words for the classes of road users in any language.

The words come from Unicode's CLDR, WordNet and WikDict's dictionaries (``scripts/make_vehicle_words.py``).
"""

import gzip
import json
import unicodedata
from functools import cache
from pathlib import Path
from types import MappingProxyType

_TABLE = Path(__file__).parent / "vehicle_words.json.gz"
_VOCABULARIES = MappingProxyType(
    {
        "passenger": "car",
        "motorcar": "car",
        "hgv": "truck",
        "hgvarticulated": "trailer",
        "goods": "delivery",
        "touristbus": "coach",
        "authority": "emergency",
        "emergencyvehicle": "emergency",
        "priorityvehicle": "emergency",
        "mofa": "moped",
        "cyclist": "bicycle",
        "person": "pedestrian",
        "foot": "pedestrian",
    }
)
"""Classes by their names in the field's vocabularies if these differ from ours: SUMO's vehicle classes and persons,
CommonRoad's types of obstacles, the means of transport of OSM's key ``access``.
"""
_VIRAMA = 9
"""Unicode's combining class of the marks that remove a consonant's vowel."""
_DETACHED = (("s", ""), ("ses", "s"), ("xes", "x"), ("ches", "ch"), ("shes", "sh"), ("men", "man"), ("ies", "y"))
"""Endings of English plurals and their replacements (WordNet's rules of detachment for nouns, morphy(7WN))."""


def vehicle_class_of(word: str) -> str | None:
    """Return the class of road user for a word in any language of the table, or None if there is none."""
    plain = plain_word(word)
    singular = (plain.removesuffix(ending) + other for ending, other in _DETACHED if plain.endswith(ending))
    known = _class_by_word()
    return next((known[spelling] for spelling in (plain, *singular) if spelling in known), None)


def plain_word(word: str) -> str:
    """Return a word in lower case, without accents, and only with its letters and digits.

    The vowel signs of scripts such as Devanagari and Thai are letters too: without them, a truck is a turkey in Hindi.
    """
    letters = unicodedata.normalize("NFKD", word.casefold())
    return "".join(letter for letter in letters if letter.isalnum() or _is_vowel_sign(letter))


def _is_vowel_sign(letter: str) -> bool:
    """Return whether a combining mark belongs to the spelling: accents and vowel points have other classes."""
    return unicodedata.category(letter) in ("Mn", "Mc") and unicodedata.combining(letter) in (0, _VIRAMA)


@cache
def _class_by_word() -> dict[str, str]:
    from .classes import PEDESTRIAN, vehicle_classes

    table = json.loads(gzip.decompress(_TABLE.read_bytes()))["words"]
    found = {word: name for name, words in table.items() for word in words}
    return found | dict(_VOCABULARIES) | {name: name for name in (*vehicle_classes(), PEDESTRIAN.name)}
