"""Make ``engine/maps/naming/road_words.json.gz``: how kinds of roads, directions and titles are abbreviated.

    python scripts/make_road_words.py LIBPOSTAL

The input is a checkout of libpostal (MIT License), whose ``resources/dictionaries`` hold them in 60 languages. Of their
lines the table keeps the words: a first one, and what is written for it. Its ``resources/numex`` hold the numbers of 41
languages, cardinal and ordinal, and Roman ones; the table keeps those up to 31, the most that dates in names have.
"""

import gzip
import json
import re
import sys
from collections import defaultdict
from pathlib import Path

from plannerforge.engine.maps.naming.places import latin

TARGET = Path(__file__).parent.parent / "engine" / "maps" / "naming" / "road_words.json.gz"
KINDS, OTHERS = ("street_types",), ("directionals", "personal_titles")
"""The dictionaries of kinds of roads, and those of other words that are abbreviated in their names."""
LARGEST = 31


def words_of(folder: Path, names: tuple[str, ...]) -> dict[str, list[str]]:
    """Return, by the first word of a line in plain Latin letters, all that is written for it; both sorted."""
    found: dict[str, set[str]] = defaultdict(set)
    for path in sorted(path for name in names for path in folder.glob(f"*/{name}.txt") if path.parent.name != "all"):
        for line in path.read_text(encoding="utf-8").splitlines():
            first, *others = line.split("|")
            word = latin(first)
            if word.isalpha() and len(first.split()) == 1:
                written = (latin(other) for other in others if len(other.split()) == 1)
                found[word].update(other for other in written if other.isalpha())
    return {word: sorted(found[word] - {word}) for word in sorted(found)}


_RULE = re.compile(r'name: "(?P<name>[^"]+)"\s+value: (?P<value>\d+)')


def numbers_of(folder: Path) -> dict[str, list[int]]:
    """Return, by a number's word in plain Latin letters, the values that languages give it; both sorted."""
    found: dict[str, set[int]] = defaultdict(set)
    for path in sorted(folder.glob("*.yaml")):
        for rule in _RULE.finditer(path.read_text(encoding="utf-8")):
            word, value = latin(rule["name"]), int(rule["value"])
            if word.isalpha() and 1 <= value <= LARGEST:
                found[word].add(value)
    return {word: sorted(found[word]) for word in sorted(found)}


def main(checkout: Path) -> None:
    """Write the table."""
    folder = checkout / "resources" / "dictionaries"
    table = {
        "source": "libpostal",
        "kinds": words_of(folder, KINDS),
        "others": words_of(folder, OTHERS),
        "numbers": numbers_of(checkout / "resources" / "numex"),
    }
    TARGET.write_bytes(gzip.compress(json.dumps(table, separators=(",", ":")).encode(), 9, mtime=0))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
