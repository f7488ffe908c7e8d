"""Spellings of places and countries: case, accents, umlauts and scripts fold into one key.

Countries in other languages come from the CLDR (``scripts/make_countries.py``), settlements in other languages from
GeoNames (``gazetteer.py``).
"""

import gzip
import json
import re
import unicodedata
from functools import cache, lru_cache
from pathlib import Path

_COUNTRY_NAMES = Path(__file__).parent / "country_names.json.gz"
_OTHER_CODES = {"GER": "DEU", "UAE": "ARE", "FL": "LIE"}
"""Codes in common use that are not the ISO's: two of the International Olympic Committee, and Liechtenstein's
distinguishing sign of vehicles (United Nations), which addresses there have."""
_OTHER_NAMES = {"Korea": "KOR", "Shqipëria": "ALB", "Zamunda": "ZAM", "artificial": "ZAM", "invented": "ZAM"}
"""Names that no table settles: the ISO calls both Koreas so; OpenStreetMap's name of Albania has the article, which the
CLDR's has not; and CommonRoad's own country for places that are none."""
VOWELLESS = re.compile(r"[\u0590-\u05ff\u0600-\u06ff]")
"""Hebrew and Arabic, which write hardly any vowel: many names have the same consonants."""
_UMLAUTS = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "ø": "oe", "å": "aa", "æ": "ae"})


def fold(text: str) -> str:
    """Lower case, without accents, and only letters and digits."""
    plain = unicodedata.normalize("NFKD", text.casefold().replace("ß", "ss").replace("ø", "o").replace("æ", "ae"))
    return "".join(letter for letter in plain if letter.isalnum())


@cache
def _codes() -> dict[str, str]:
    """ISO 3166-1 alpha-3 by the key of a code or name; codes and the ISO's own names win over the CLDR's."""
    from iso3166 import countries

    codes: dict[str, str] = {}
    for country in countries:
        codes[fold(country.alpha2)] = codes[fold(country.alpha3)] = country.alpha3
    for text, code in {**_OTHER_CODES, **_OTHER_NAMES, "ZAM": "ZAM"}.items():
        codes.setdefault(fold(text), code)
    for country in countries:
        for text in (country.name, country.apolitical_name, country.name.split(",")[0]):
            codes.setdefault(fold(text.partition("(")[0]), country.alpha3)
    for code, keys in json.loads(gzip.decompress(_COUNTRY_NAMES.read_bytes()))["names"].items():
        for key in keys:
            codes.setdefault(key, code)
    return codes


@lru_cache(maxsize=50_000)
def latin(text: str) -> str:
    """A text as its sound is written in Latin letters and digits, without accents and digraphs for umlauts."""
    folded = fold(text)
    if not folded.isascii():
        from anyascii import anyascii

        spoken = unicodedata.normalize("NFC", text).casefold().replace("ού", "ou").replace("ου", "ou")  # ELOT 743
        folded = fold(anyascii(spoken))
    return _without_digraphs(folded).replace("aa", "a")


@lru_cache(maxsize=50_000)
def place_keys(text: str) -> frozenset[str]:
    """All keys that a place may be known by; two spellings mean the same place where they share one.

    ``Mölln``, ``Moelln`` and ``Molln`` share a key. What a place is called in another language is not among them:
    that is what :func:`~plannerforge.engine.maps.naming.gazetteer.names_elsewhere` knows.
    """
    lowered = unicodedata.normalize("NFC", text).casefold()
    spellings = {fold(lowered), fold(lowered.translate(_UMLAUTS))}
    spellings |= {_without_digraphs(spelling) for spelling in spellings}
    if not VOWELLESS.search(text):
        spellings.add(latin(text))
    return frozenset(spelling for spelling in spellings if spelling)


def country_code(text: str) -> str | None:
    """ISO 3166-1 alpha-3 of a code or of a name in any language of the CLDR; None for anything else."""
    exact = fold(text)
    keys = (exact, fold(text.casefold().translate(_UMLAUTS)), _without_digraphs(exact))
    return next((code for key in keys if key and (code := _codes().get(key)) is not None), None)


def countries_spelt_like(text: str) -> list[str]:
    """ISO 3166-1 alpha-3 codes of countries with a name, in any language, that is spelt nearly so; the nearest first.

    Codes are too short to be misspelt: each is one letter away from others.
    """
    from rapidfuzz import process
    from rapidfuzz.distance import OSA

    wanted = fold(text)
    if len(wanted) < _SHORTEST_NAME:
        return []
    names = [name for name in _codes() if len(name) >= _SHORTEST_NAME]
    found = process.extract(wanted, names, scorer=OSA.distance, score_cutoff=_MOST_MISSPELT)
    return list(dict.fromkeys(_codes()[name] for name, _, _ in found))


_SHORTEST_NAME, _MOST_MISSPELT = 4, 2
"""Letters of a name that may be misspelt, and how many of its letters may be wrong, left out or swapped (chosen)."""


def country_name(code: str) -> str:
    """Return the English name of a country by its ISO 3166-1 alpha-3 code, or the code itself if no country has it.

    The ISO's inverted names (``Moldova, Republic of``) are shortened unless two countries share the beginning.
    """
    from iso3166 import countries, countries_by_alpha3

    country = countries_by_alpha3.get(code)
    if country is None:
        return code
    short, _, rest = country.apolitical_name.partition(", ")
    is_shared = sum(one.apolitical_name.partition(", ")[0] == short for one in countries) > 1
    return short if rest.endswith((" of", " of the")) and not is_shared else country.apolitical_name


def _without_digraphs(spelling: str) -> str:
    return spelling.replace("ae", "a").replace("oe", "o").replace("ue", "u")
