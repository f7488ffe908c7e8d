"""Write the table of legal speed limits from osm-legal-default-speeds' JSON of OpenStreetMap's wiki.

    python scripts/pack_legal_speeds.py legal_default_speeds.json

The JSON is generated from https://wiki.openstreetmap.org/wiki/Default_speed_limits (content CC BY-SA 2.0) by the
project https://github.com/westnordost/osm-legal-default-speeds. The table keeps the limits for all vehicles
(``maxspeed``, or else ``maxspeed:advisory``), their road types, its source, date and licence.
"""

import argparse
import gzip
import json
import re
from pathlib import Path

TARGET = Path(__file__).parent.parent / "engine" / "maps" / "road_tags" / "legal_speeds.json.gz"
KEPT = ("maxspeed", "maxspeed:advisory")
CORRECTED = {"FI": {"100": "80"}}
"""Limits of the table that the law has otherwise: Finland's Road Traffic Act (729/2018), section 100: 80 km/h outside
built-up areas."""


def packed(source: dict[str, dict[str, object]]) -> dict[str, object]:
    """Return the table: its source, the filters of its road types, and the rules of each country."""
    limits: dict[str, list[tuple[str, dict[str, str]]]] = {}
    for code, rules in source["speedLimitsByCountryCode"].items():
        kept = [(rule.get("name", ""), {k: v for k, v in rule["tags"].items() if k in KEPT}) for rule in rules]  # type: ignore[attr-defined]
        other = CORRECTED.get(code, {})
        limits[code] = [(name, {k: other.get(v, v) for k, v in tags.items()}) for name, tags in kept if tags]
    filters = source["roadTypesByName"]
    kinds: dict[str, tuple[str, str]] = {}
    waiting = [name for rules in limits.values() for name, _ in rules if name]
    while waiting:
        name = waiting.pop()
        if name in kinds or name in ("urban", "rural"):
            continue
        kind: dict[str, str] = filters.get(name, {})  # type: ignore[assignment]
        kinds[name] = kind.get("filter", ""), kind.get("fuzzyFilter", "")
        waiting += [part for text in kinds[name] for part in re.findall(r"\{([^}]*)\}", text)]
    meta = source["meta"]
    about = {key: meta[key] for key in ("source", "revisionId", "timestamp", "license", "licenseUrl")}
    return {"about": about, "kinds": dict(sorted(kinds.items())), "limits": dict(sorted(limits.items()))}


def main() -> None:
    """Read the JSON that the command line gives, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", type=Path)
    table = packed(json.loads(parser.parse_args().source.read_text(encoding="utf-8")))
    text = json.dumps(table, ensure_ascii=False, separators=(",", ":"))
    TARGET.write_bytes(gzip.compress(text.encode("utf-8"), mtime=0))


if __name__ == "__main__":
    main()
