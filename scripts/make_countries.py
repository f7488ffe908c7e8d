"""Write ``engine/maps/naming/country_names.json.gz``, the names of countries in all languages.

    python scripts/make_countries.py NODE_MODULES WORDNET

The names come from Unicode's Common Locale Data Repository (CLDR) in Babel; the table contains its version.
``NODE_MODULES`` holds the CLDR's packages ``cldr-localenames-full`` and ``cldr-subdivisions-full``, which add short
names, variants and the countries of the United Kingdom. Official names and their translations come from Debian's
iso-codes in pycountry. ``WORDNET`` is the folder ``dict`` of WordNet 3, which adds synonyms of English names.

If several countries share a name, the one with more languages gets it; equal ones are left out. WordNet counts only for
names that no other source has.
"""

import gettext
import gzip
import json
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pycountry
from babel import __version__, localedata
from iso3166 import countries, countries_by_alpha2

from plannerforge.engine.maps.naming.places import fold

TARGET = Path(__file__).parent.parent / "engine" / "maps" / "naming" / "country_names.json.gz"
SHORTEST = 3
"""The fewest letters of an ASCII name; shorter ones could be codes."""
PARTS = dict.fromkeys(("gbeng", "gbnir", "gbsct", "gbwls", "gbgbn"), "GBR")
"""The countries of the United Kingdom and Great Britain, by their codes of ISO 3166-2 in the CLDR."""
_NOUN_OF_PLACE = 15
"""WordNet's file of place names (lexnames(5WN))."""


def names_of_cldr(folder: Path) -> Iterator[tuple[str, str]]:
    """Yield the names of each language, with their ISO 3166-1 alpha-3 codes."""
    for locale in sorted(localedata.locale_identifiers()):
        for territory, name in localedata.load(locale)["territories"].items():
            if territory in countries_by_alpha2 and _is_long(name):
                yield name, countries_by_alpha2[territory].alpha3
    for path in sorted(folder.glob("cldr-localenames-full/main/*/territories.json")):
        (content,) = json.loads(path.read_text(encoding="utf-8"))["main"].values()
        for key, name in content["localeDisplayNames"]["territories"].items():
            territory, short, _ = key.partition("-alt-")
            in_english = path.parent.name == "en"
            if short and territory in countries_by_alpha2 and (in_english or _is_long(name, SHORTEST + 1)):
                yield name, countries_by_alpha2[territory].alpha3
    for path in sorted(folder.glob("cldr-subdivisions-full/subdivisions/**/*.json")):
        for code, name in _leaves(json.loads(path.read_text(encoding="utf-8"))):
            if code in PARTS and _is_long(name):
                yield name, PARTS[code]


def names_of_iso() -> Iterator[tuple[str, str]]:
    """Yield the names of iso-codes in English and in each language, with their ISO 3166-1 alpha-3 codes."""
    languages = sorted(path.name for path in Path(pycountry.LOCALES_DIR).iterdir())
    translations = [
        gettext.translation("iso3166-1", pycountry.LOCALES_DIR, languages=[language], fallback=True)
        for language in languages
    ]
    for country in pycountry.countries:
        for key in ("name", "official_name", "common_name"):
            name = getattr(country, key, None)
            if name is not None:
                found = {name, *(translation.gettext(name) for translation in translations)}
                yield from ((one, country.alpha_3) for one in sorted(found) if _is_long(one))


def names_of_wordnet(folder: Path) -> Iterator[tuple[str, str]]:
    """Yield the English synonyms of country names, with their ISO 3166-1 alpha-3 codes."""
    codes = {fold(name): country.alpha3 for country in countries for name in (country.name, country.apolitical_name)}
    for line in (folder / "data.noun").read_text(encoding="utf-8").splitlines():
        fields = line.split()
        if not line.startswith(" ") and int(fields[1]) == _NOUN_OF_PLACE:
            names = [name.replace("_", " ") for name in fields[4 : 4 + 2 * int(fields[3], 16) : 2]]
            found = {codes[fold(name)] for name in names if fold(name) in codes}
            if len(found) == 1:
                yield from ((name, *found) for name in names if _is_long(name))


def names_by_code(folder: Path, wordnet: Path) -> dict[str, list[str]]:
    """Return the keys of all names by ISO 3166-1 alpha-3 code, both sorted."""
    counted: dict[str, Counter[str]] = defaultdict(Counter)
    for name, code in (*names_of_cldr(folder), *names_of_iso()):
        counted[fold(name)][code] += 1
    for name, code in names_of_wordnet(wordnet):
        if fold(name) not in counted:
            counted[fold(name)][code] += 1
    names: dict[str, list[str]] = defaultdict(list)
    for key, codes in counted.items():
        (first, most), *others = codes.most_common(2)
        if not others or others[0][1] < most:
            names[first].append(key)
    return {code: sorted(names[code]) for code in sorted(names)}


def _is_long(name: str, shortest: int = SHORTEST) -> bool:
    key = fold(name)
    return len(key) >= shortest or (bool(key) and not key.isascii())


def _leaves(texts: dict[str, Any]) -> Iterator[tuple[str, str]]:
    for key, value in texts.items():
        if isinstance(value, dict):
            yield from _leaves(value)
        else:
            yield key, value


def main() -> None:
    """Write the table."""
    folder, wordnet = map(Path, sys.argv[1:3])
    source = f"CLDR by Babel {__version__}, iso-codes by pycountry {pycountry.__version__}, WordNet 3"
    table = {"source": source, "names": names_by_code(folder, wordnet)}
    text = json.dumps(table, ensure_ascii=False, separators=(",", ":"))
    TARGET.write_bytes(gzip.compress(text.encode(), 9, mtime=0))


if __name__ == "__main__":
    main()
