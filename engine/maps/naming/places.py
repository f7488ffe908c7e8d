"""Spellings of places and countries: case, accents, umlauts and scripts are reduced to one key.

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
"""Codes in common use that are not ISO codes: two of the International Olympic Committee, and Liechtenstein's
international vehicle registration code (United Nations), which addresses there use.
"""
_OTHER_NAMES = {"Korea": "KOR", "Shqipëria": "ALB", "Zamunda": "ZAM", "artificial": "ZAM", "invented": "ZAM"}
"""Names that no table resolves: ISO's names for both Koreas; OpenStreetMap's name of Albania, with an article that the
CLDR's lacks; and CommonRoad's own country for places outside all countries.
"""
VOWELLESS = re.compile(r"[\u0590-\u05ff\u0600-\u06ff]")
"""Hebrew and Arabic, which write hardly any vowels: many names have the same consonants."""
_UMLAUTS = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "ø": "oe", "å": "aa", "æ": "ae"})


def fold(text: str) -> str:
    """Return a text in lower-case letters and digits without accents."""
    plain = unicodedata.normalize("NFKD", text.casefold().replace("ß", "ss").replace("ø", "o").replace("æ", "ae"))
    return "".join(letter for letter in plain if letter.isalnum())


@cache
def _codes() -> dict[str, str]:
    """Return ISO 3166-1 alpha-3 codes by key of a code or name; ISO's names take precedence over the CLDR's."""
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
    """Return a text in Latin letters and digits, without accents or digraphs for umlauts."""
    folded = fold(text)
    if not folded.isascii():
        from anyascii import anyascii

        spoken = unicodedata.normalize("NFC", text).casefold().replace("ού", "ou").replace("ου", "ou")  # ELOT 743
        folded = fold(anyascii(spoken))
    return _without_digraphs(folded).replace("aa", "a")


@lru_cache(maxsize=50_000)
def place_keys(text: str) -> frozenset[str]:
    """Return all keys of a place's name; two spellings mean the same place if they share a key.

    ``Mölln``, ``Moelln`` and ``Molln`` share a key. Names in other languages are not included:
    :func:`~plannerforge.engine.maps.naming.gazetteer.names_elsewhere` returns those.
    """
    lowered = unicodedata.normalize("NFC", text).casefold()
    spellings = {fold(lowered), fold(lowered.translate(_UMLAUTS))}
    spellings |= {_without_digraphs(spelling) for spelling in spellings}
    if not VOWELLESS.search(text):
        spellings.add(latin(text))
    return frozenset(spelling for spelling in spellings if spelling)


def country_code(text: str) -> str | None:
    """Return the ISO 3166-1 alpha-3 code for a code or a name in any language of the CLDR; None for other texts.

    A text that begins with a sign, such as ``!BEL``, is no name: without the sign it would mean the opposite.
    """
    if not text.strip()[:1].isalnum():
        return None
    exact = fold(text)
    keys = (exact, fold(text.casefold().translate(_UMLAUTS)), _without_digraphs(exact))
    return next((code for key in keys if key and (code := _codes().get(key)) is not None), None)


def countries_spelt_like(text: str) -> list[str]:
    """Return ISO 3166-1 alpha-3 codes of countries with a similarly spelt name in any language, closest first.

    Misspelt codes do not count, since each code is one letter away from other codes.
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
"""Minimum length of a name that may be misspelt, and how many letters may be wrong, missing or swapped (chosen)."""


def country_name(code: str) -> str:
    """Return the English name of a country by its ISO 3166-1 alpha-3 code, or the code itself if no country has it.

    ISO's inverted names (``Moldova, Republic of``) are shortened unless two countries have the same short name.
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
