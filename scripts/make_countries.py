"""Make ``engine/maps/naming/country_names.json.gz``: what countries are called in all languages of the CLDR.

    python scripts/make_countries.py

The names are those of Unicode's Common Locale Data Repository as Babel brings it (the version is written into the
table). A name that several countries have is that of the country that more languages call so; one that as many
languages give to each is left out.
"""

import gzip
import json
from collections import Counter, defaultdict
from pathlib import Path

from babel import __version__, localedata
from iso3166 import countries_by_alpha2

from plannerforge.engine.maps.naming.places import fold

TARGET = Path(__file__).parent.parent / "engine" / "maps" / "naming" / "country_names.json.gz"
SHORTEST = 3
"""Letters of a name in ASCII: a shorter one is taken for a code."""


def names_by_code() -> dict[str, list[str]]:
    """Return the keys of all names by ISO 3166-1 alpha-3 code, both sorted."""
    counted: dict[str, Counter[str]] = defaultdict(Counter)
    for locale in sorted(localedata.locale_identifiers()):
        for territory, name in localedata.load(locale)["territories"].items():
            country = countries_by_alpha2.get(territory)
            key = fold(name)
            if country is not None and (len(key) >= SHORTEST or not key.isascii()):
                counted[key][country.alpha3] += 1
    names: dict[str, list[str]] = defaultdict(list)
    for key, countries in counted.items():
        (first, most), *others = countries.most_common(2)
        if not others or others[0][1] < most:
            names[first].append(key)
    return {code: sorted(names[code]) for code in sorted(names)}


def main() -> None:
    """Write the table."""
    table = {"source": f"CLDR by Babel {__version__}", "names": names_by_code()}
    text = json.dumps(table, ensure_ascii=False, separators=(",", ":"))
    TARGET.write_bytes(gzip.compress(text.encode(), 9, mtime=0))


if __name__ == "__main__":
    main()
