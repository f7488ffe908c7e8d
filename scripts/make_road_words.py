"""Write ``engine/maps/naming/road_words.json.gz``, the abbreviations in road names.

    python scripts/make_road_words.py LIBPOSTAL

The input is a checkout of libpostal (MIT License). From ``resources/dictionaries`` (60 languages), the table takes
each word with its abbreviations, and road types of several words (``state route``). From ``resources/numex`` (41
languages), it takes cardinal, ordinal and Roman numbers up to 31, the largest in a date. From
``resources/addresses`` (36 languages), it takes cardinal directions and the words between or before the two roads of a
crossing.

The table also has the numbers up to 99 that the CLDR spells out (rule-based number formats, Unicode License) as
cardinals and ordinals in about 80 languages, in every gender and case. ICU applies the rules: Debian's package
``python3-icu`` has its Python module.
"""

import gzip
import json
import re
import sys
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import yaml
from icu import Locale, RuleBasedNumberFormat, URBNFRuleSetTag

from plannerforge.engine.maps.naming.places import latin
from plannerforge.engine.maps.naming.spellings import words_of_name

TARGET = Path(__file__).parent.parent / "engine" / "maps" / "naming" / "road_words.json.gz"
KINDS, OTHERS = ("street_types",), ("directionals", "personal_titles")
"""The dictionaries of road types, and of other abbreviated words."""
TITLES = ("personal_titles", "personal_suffixes")
"""The dictionaries of the titles before and after a person's name."""
LARGEST = 31


def words_of(folder: Path, names: tuple[str, ...]) -> dict[str, list[str]]:
    """Return the abbreviations by the first word of a line, in plain Latin letters; both sorted."""
    found: dict[str, set[str]] = defaultdict(set)
    for path in sorted(path for name in names for path in folder.glob(f"*/{name}.txt") if path.parent.name != "all"):
        for line in path.read_text(encoding="utf-8").splitlines():
            first, *others = line.split("|")
            word = latin(first)
            if word.isalpha() and len(first.split()) == 1:
                written = (latin(other) for other in others if len(other.split()) == 1)
                found[word].update(other for other in written if other.isalpha())
    return {word: sorted(found[word] - {word}) for word in sorted(found)}


def titles_of(folder: Path) -> list[str]:
    """Return the titles of persons in one word with their abbreviations, in plain Latin letters; sorted."""
    return sorted({title for word, written in words_of(folder, TITLES).items() for title in (word, *written)})


def long_kinds_of(folder: Path) -> dict[str, list[str]]:
    """Return the abbreviations by a road type of several words, in plain Latin letters; both sorted."""
    found: dict[str, set[str]] = defaultdict(set)
    for path in sorted(folder.glob("*/street_types.txt")):
        for line in path.read_text(encoding="utf-8").splitlines():
            first, *others = (" ".join(filter(None, map(latin, re.split(r"[\s.]+", text)))) for text in line.split("|"))
            if " " in first:
                found[first].update(other for other in others if len(other) > 1)
    return {kind: sorted(found[kind] - {kind}) for kind in sorted(found)}


_RULE = re.compile(r'name: "(?P<name>[^"]+)"\s+value: (?P<value>\d+)')


def numbers_of(folder: Path) -> dict[str, list[int]]:
    """Return the values by a number's word, in plain Latin letters; both sorted."""
    found: dict[str, set[int]] = defaultdict(set)
    for path in sorted(folder.glob("*.yaml")):
        for rule in _RULE.finditer(path.read_text(encoding="utf-8")):
            word, value = latin(rule["name"]), int(rule["value"])
            if word.isalpha() and 1 <= value <= LARGEST:
                found[word].add(value)
    return {word: sorted(found[word]) for word in sorted(found)}


def ordinals_of(folder: Path) -> list[str]:
    """Return the suffixes of ordinal numbers in digits, in plain Latin letters; sorted.

    Single letters belong to house numbers (``12a``), except ``e``.
    """
    found: set[str] = set()
    for path in sorted(folder.glob("*.yaml")):
        for group in yaml.safe_load(path.read_text(encoding="utf-8")).get("ordinal_indicators") or []:
            found.update(latin(ending) for endings in group["suffixes"].values() for ending in endings)
    return sorted(ending for ending in found if ending.isalpha() and (len(ending) > 1 or ending == "e"))


LARGEST_SPELT = 99
_SHORTEST_SPELT = 5
"""Minimum letters of a number in one word: shorter words are abbreviations and names in other languages (chosen)."""


def spelt_numbers(known: set[str]) -> dict[str, list[str]]:
    """Return the words for each number in all languages, in plain Latin letters; both sorted.

    ``known``: words with a meaning of their own, which are left out.
    """
    found: dict[int, set[str]] = {value: set() for value in range(1, LARGEST_SPELT + 1)}
    for locale in Locale.getAvailableLocales():
        numbers = RuleBasedNumberFormat(URBNFRuleSetTag.SPELLOUT, Locale(locale))
        for kind in range(numbers.getNumberOfRuleSetNames()):
            numbers.setDefaultRuleSet(numbers.getRuleSetName(kind))
            for value, words in found.items():
                spelt = words_of_name(numbers.format(value).replace("\u00ad", ""))
                if all(map(str.isalpha, spelt)) and len("".join(spelt)) >= _SHORTEST_SPELT:
                    words.add(" ".join(spelt))
    return {str(value): sorted(words - known) for value, words in found.items()}


SUFFIXES = "concatenated_suffixes_separable"
DIRECTIONS = ("north", "south", "east", "west")
JOINING, CORNERS = (
    ("and", "x", "i", "ve", "con", "amb"),
    ("corner", "corner_of", "at_the_corner_of", "na_uglu", "na_rozi", "ugul_na"),
)
"""The entries of ``cross_streets`` between two roads, and those before both."""
_MEANS_AT = "a"
"""The Czech and Slovak word for "and", which means "at" in Catalan, French, Italian and Portuguese."""


def suffixes_of(folder: Path) -> dict[str, list[str]]:
    """Return the spellings by a road type that is the suffix of a name; both sorted."""
    found: dict[str, set[str]] = defaultdict(set)
    for path in sorted(folder.glob(f"*/{SUFFIXES}.txt")):
        for line in path.read_text(encoding="utf-8").splitlines():
            written = [latin(word) for word in line.split("|") if word.strip()]
            if written:
                found[written[0]].update(word for word in written if len(word) > 1)
    return {word: sorted(found[word]) for word in sorted(found)}


def addresses_of(folder: Path, part: str) -> dict[str, Counter[str]]:
    """Return the number of languages per spelling, by entry of a section of the address files."""
    found: dict[str, Counter[str]] = defaultdict(Counter)
    for path in sorted(folder.glob("*.yaml")):
        content: dict[str, Any] = yaml.safe_load(path.read_text(encoding="utf-8")).get(part) or {}
        for entry, value in content.items():
            if isinstance(value, dict) and "canonical" in value:
                found[entry].update({value["canonical"], value.get("abbreviated", value["canonical"])})
    return found


def directions_of(folder: Path) -> dict[str, list[str]]:
    """Return the words of each direction in all languages; a word of two directions gets the more frequent one.

    Words of three letters need several languages, because others are names and articles elsewhere.
    """
    counted: dict[str, Counter[str]] = defaultdict(Counter)
    for direction, words in addresses_of(folder, "cardinal_directions").items():
        for word, languages in words.items():
            if direction in DIRECTIONS and latin(word).isalpha() and len(word) > 2:
                counted[latin(word)][direction] += languages
    found: dict[str, list[str]] = defaultdict(list)
    for word, votes in sorted(counted.items()):
        (first, most), *others = votes.most_common(2)
        if (not others or others[0][1] < most) and (len(word) > 3 or most > 1):
            found[first].append(word)
    return {direction: found[direction] for direction in DIRECTIONS}


def crossings_of(folder: Path, entries: tuple[str, ...]) -> list[str]:
    """Return the spellings of some entries on crossings, sorted."""
    content = addresses_of(folder, "cross_streets")
    return sorted({word for entry in entries for word in content[entry] if any(map(str.isalpha, word))} - {_MEANS_AT})


def main(checkout: Path) -> None:
    """Write the table."""
    folder = checkout / "resources" / "dictionaries"
    kinds, others = words_of(folder, KINDS), words_of(folder, OTHERS)
    known = {spelling for words in (kinds, others) for word, written in words.items() for spelling in (word, *written)}
    table = {
        "source": "libpostal, CLDR",
        "kinds": kinds,
        "long_kinds": long_kinds_of(folder),
        "others": others,
        "titles": titles_of(folder),
        "numbers": numbers_of(checkout / "resources" / "numex"),
        "spelt_numbers": spelt_numbers(known),
        "ordinals": ordinals_of(checkout / "resources" / "numex"),
        "suffixes": suffixes_of(folder),
        "directions": directions_of(checkout / "resources" / "addresses"),
        "joining": crossings_of(checkout / "resources" / "addresses", JOINING),
        "corners": crossings_of(checkout / "resources" / "addresses", CORNERS),
    }
    text = json.dumps(table, ensure_ascii=False, separators=(",", ":"))
    TARGET.write_bytes(gzip.compress(text.encode(), 9, mtime=0))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
