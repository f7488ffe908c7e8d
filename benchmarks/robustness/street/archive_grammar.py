"""Forged archives: an export changed by a grammar over its records and files, with recomputed digests.

A forged archive is the export of a real workspace after one to three *productions*. Each changes a record, its recipe,
its id, its files or the lists that connect them. All digests are recomputed, so that no forgery is a mere damage.
"""

import hashlib
import io
import json
import random
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from ..inputs import INJECTED

_RECORDS, _HEAD, _SUMS = "records.jsonl", "workspace.json", "SHA256SUMS"
FORGED = f"x\n{INJECTED}"
"""A text that would form a line of the server's own if printed unchanged."""
_DEEP = 5_000
_LONG = 100_000

Record = dict[str, Any]


@dataclass
class Draft:
    """An archive that is being forged: records, files by name, and raw lines that take the place of records."""

    records: list[Record]
    files: dict[str, bytes]
    raw_lines: dict[int, bytes] = field(default_factory=dict)
    productions: list[str] = field(default_factory=list)

    @property
    def runs(self) -> list[str]:
        """Ids that records of runs state."""
        return [str(record.get("artifact_id")) for record in self.records if record.get("kind") == "run"]

    def packed(self) -> bytes:
        """Return the archive with the counts and digests of its content."""
        lines = [json.dumps(record, ensure_ascii=False).encode() for record in self.records]
        for number, raw in self.raw_lines.items():
            lines[number % len(lines)] = raw
        head = json.loads(self.files[_HEAD])
        head["artifacts"] = len(lines)
        content = {**self.files, _HEAD: json.dumps(head).encode(), _RECORDS: b"\n".join(lines) + b"\n"}
        sums = "".join(f"{hashlib.sha256(data).hexdigest()}  {name}\n" for name, data in content.items())
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            for name, data in {**content, _SUMS: sums.encode()}.items():
                archive.writestr(name, data)
        return buffer.getvalue()


@dataclass(frozen=True)
class ForgedArchive:
    """A forged archive, its productions, and the ids of the runs that it claims."""

    content: bytes
    productions: tuple[str, ...]
    runs: tuple[str, ...]


def forged_archives(source: bytes, chance: random.Random) -> Iterator[ForgedArchive]:
    """Yield endless forged archives from the bytes of a real one."""
    with zipfile.ZipFile(io.BytesIO(source)) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    lines = files.pop(_RECORDS).splitlines()
    files.pop(_SUMS)
    while True:
        draft = Draft([json.loads(line) for line in lines], dict(files))
        for _ in range(chance.choice([1, 1, 2, 3])):
            production = chance.choice(PRODUCTIONS)
            production(draft, chance)
            draft.productions.append(production.__name__.strip("_"))
        yield ForgedArchive(draft.packed(), tuple(draft.productions), tuple(draft.runs))


def hostile_value(chance: random.Random) -> Any:
    """Return a value that suits no field."""
    return chance.choice(
        [
            *(None, True, -1, 0, 10**30, 1e308, -1e-300, float("nan"), float("inf"), "", [], {}, [None], [[]]),
            *({"": ""}, FORGED, "\u202e" + FORGED, "\x00\x1b[2J", "y" * _LONG, "latest", "../../etc/passwd"),
            *("'; DROP TABLE artifacts;--", "\ud800".encode("utf-8", "surrogatepass").decode("utf-8", "replace")),
            *([FORGED] * 3, {FORGED: FORGED}, ["z" * 1000] * 1000),
        ]
    )


def _draw(draft: Draft, chance: random.Random, kind: str = "") -> Record:
    of_kind = [record for record in draft.records if not kind or record.get("kind") == kind]
    kinds = sorted({str(record.get("kind")) for record in of_kind})
    if not kinds:
        return chance.choice(draft.records) if draft.records else {}
    wanted = chance.choice(kinds)  # the few runs as often as the many scenarios
    return chance.choice([record for record in of_kind if str(record.get("kind")) == wanted])


def _places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the paths of all parts of a value."""
    parts = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, part in parts:
        yield (*path, key)
        yield from _places(part, (*path, key))


def _parent(value: Any, path: tuple[Any, ...]) -> Any:
    for key in path[:-1]:
        value = value[key]
    return value


def _at_random(record: Record, chance: random.Random, change: Callable[[Any, Any], None]) -> None:
    places = list(_places(record))
    if places:
        path = chance.choice(places)
        change(_parent(record, path), path[-1])


def _value_changed(draft: Draft, chance: random.Random) -> None:
    value = hostile_value(chance)
    _at_random(_draw(draft, chance), chance, lambda holder, key: holder.__setitem__(key, value))


def _value_of_record_changed(draft: Draft, chance: random.Random) -> None:
    value = hostile_value(chance)
    record = _draw(draft, chance).get("record")
    if isinstance(record, dict):
        _at_random(record, chance, lambda holder, key: holder.__setitem__(key, value))


def _texts_forged(draft: Draft, chance: random.Random) -> None:
    """Forge every text of a record except ids."""
    record = _draw(draft, chance).get("record")
    for path in list(_places(record)):
        holder = _parent(record, path)
        if isinstance(holder[path[-1]], str) and not str(path[-1]).endswith("_id") and chance.random() < 0.5:
            holder[path[-1]] = FORGED


def _key_dropped(draft: Draft, chance: random.Random) -> None:
    _at_random(_draw(draft, chance), chance, lambda holder, key: holder.pop(key))


def _key_added(draft: Draft, chance: random.Random) -> None:
    record = _draw(draft, chance)
    place = record.get("record") if chance.random() < 0.7 else record
    if isinstance(place, dict):
        place[chance.choice(["extra", FORGED, "__class__", ""])] = hostile_value(chance)


def _record_emptied(draft: Draft, chance: random.Random) -> None:
    _draw(draft, chance)["record"] = chance.choice([{}, [], None, "", {"record": {}}])


def _records_exchanged(draft: Draft, chance: random.Random) -> None:
    first, second = _draw(draft, chance), _draw(draft, chance)
    first["record"], second["record"] = second.get("record"), first.get("record")


def _ids_exchanged(draft: Draft, chance: random.Random) -> None:
    first, second = _draw(draft, chance), _draw(draft, chance)
    first["artifact_id"], second["artifact_id"] = second.get("artifact_id"), first.get("artifact_id")


def _id_changed(draft: Draft, chance: random.Random) -> None:
    record = _draw(draft, chance)
    record["artifact_id"] = chance.choice(["latest", "../x", "run_000000000000", "A" * 300, "", ".", "cfg_\u202e1", 5])


def _kind_changed(draft: Draft, chance: random.Random) -> None:
    _draw(draft, chance)["kind"] = chance.choice(["run", "scenario", "config", "map", "study", "plan", "batch", "x"])


def _recipe_changed(draft: Draft, chance: random.Random) -> None:
    value, recipe = hostile_value(chance), _draw(draft, chance).get("recipe")
    if isinstance(recipe, dict):
        _at_random(recipe, chance, lambda holder, key: holder.__setitem__(key, value))


def _parents_in_a_circle(draft: Draft, chance: random.Random) -> None:
    first, second = _draw(draft, chance, "scenario"), _draw(draft, chance, "scenario")
    for one, other in ((first, second), (second, first)):
        one["recipe"] = {
            "tool": "modify_scenario",
            "arguments": {"base": other.get("artifact_id"), "edits": []},
            "parents": [other.get("artifact_id")],
            "seed": 0,
            "versions": {},
        }


def _forge_run_result(draft: Draft, chance: random.Random) -> None:
    """Give a run the id of its recipe and an invented result."""
    record = _draw(draft, chance, "run").get("record")
    if isinstance(record, dict):
        record["reason"] = f"reached the goal FORGED {FORGED}"
        record["outcome"] = chance.choice(["goal_reached", "collision", "timeout"])
        if isinstance(metrics := record.get("metrics"), dict):
            metrics["minimum_distance_m"] = chance.choice([99.0, 0.0, -5.0, 1e308])


def _weights_changed(draft: Draft, chance: random.Random) -> None:
    """Put a configuration under the id of another."""
    record = _draw(draft, chance, "config").get("record")
    if isinstance(record, dict) and isinstance(weights := record.get("weights"), dict):
        for name in weights:
            weights[name] = chance.choice([0.0, 1e6, -1.0])


def _members_lost(draft: Draft, chance: random.Random) -> None:
    """Make a batch or search refer to something missing."""
    record = _draw(draft, chance, chance.choice(["batch", "search"])).get("record")
    for name in ("runs", "scenario_ids", "scenarios"):
        if isinstance(record, dict) and name in record:
            record[name] = chance.choice([["run_000000000000"], ["../../../etc/passwd", "latest"], [FORGED], []])


def _record_twice(draft: Draft, chance: random.Random) -> None:
    draft.records.append(dict(_draw(draft, chance)))


def _record_left_out(draft: Draft, chance: random.Random) -> None:
    if len(draft.records) > 1:
        draft.records.remove(_draw(draft, chance))


def _date_forged(draft: Draft, chance: random.Random) -> None:
    _draw(draft, chance)["made_at"] = chance.choice(["2026-99-99T99:99:99Z", "9999-12-31T23:59:59Z", FORGED, 0, ""])


def _name_forged(draft: Draft, chance: random.Random) -> None:
    _draw(draft, chance)["name"] = chance.choice([FORGED, "n" * _LONG, "\u202ename\u2066", "", None])


def _line_raw(draft: Draft, chance: random.Random) -> None:
    """Insert a line that is hardly JSON."""
    draft.raw_lines[chance.randrange(1000)] = chance.choice(
        [
            b"{" + b'"a":{' * _DEEP,
            b"[" * _DEEP + b"]" * _DEEP,
            b'{"kind":"run","artifact_id":' + b"9" * 10_000 + b"}",
            b'{"kind":1e400}',
            b"\xff\xfe\x00",
            b"null",
            b'{"kind":"scenario","record":' + b'{"r":' * _DEEP + b"1" + b"}" * _DEEP + b"}",
        ]
    )


def _file_changed(draft: Draft, chance: random.Random) -> None:
    """Change a file's bytes, with the right digest in the list and the wrong one in a record."""
    names = [name for name in draft.files if name.startswith("files/")]
    kinds = sorted({name.rpartition("/")[2] for name in names})
    wanted = chance.choice(kinds)
    name = chance.choice([name for name in names if name.endswith(f"/{wanted}")])
    content = draft.files[name]
    draft.files[name] = chance.choice(
        [
            b"",
            b"{}",
            b"null",
            b"[" * _DEEP,
            content[: len(content) // 2],
            content + b" ",
            b"\xff" * 100,
            content.replace(b"1", b"1e308", 3),
            b'{"a": NaN}',
            FORGED.encode(),
        ]
    )


def _scenario_rewritten(draft: Draft, chance: random.Random) -> None:
    """Replace a scenario's file, with its digest in the record."""
    record = _draw(draft, chance, "scenario")
    name = f"files/scenarios/{record.get('artifact_id')}/scenario.xml"
    if name in draft.files and isinstance(record.get("record"), dict):
        content = draft.files[name]
        draft.files[name] = chance.choice(
            [
                content.replace(b"<x>", b"<x>1e30", 1),
                content[: len(content) // 2],
                b"<commonRoad/>",
                content + b"<!---->",
            ]
        )
        record["record"]["content"] = hashlib.sha256(draft.files[name]).hexdigest()


def _file_added(draft: Draft, chance: random.Random) -> None:
    record = _draw(draft, chance)
    name = chance.choice(["extra.json", "../x", "a/b", "scenario.xml", "steps.json", ".hidden", "n" * 300])
    draft.files[f"files/{record.get('kind')}s/{record.get('artifact_id')}/{name}"] = b"{}"
    if chance.random() < 0.5 and isinstance(record.get("files"), list):
        record["files"].append(name)


def _file_removed(draft: Draft, chance: random.Random) -> None:
    name = chance.choice([name for name in draft.files if name.startswith("files/")])
    del draft.files[name]
    for record in draft.records:
        files = record.get("files")
        if name.startswith(f"files/{record.get('kind')}s/{record.get('artifact_id')}/") and isinstance(files, list):
            record["files"] = [file for file in files if file != name.rpartition("/")[2]]


PRODUCTIONS: tuple[Callable[[Draft, random.Random], None], ...] = (
    *(_value_changed, _value_of_record_changed, _value_of_record_changed, _texts_forged, _key_dropped, _key_added),
    *(_record_emptied, _records_exchanged, _ids_exchanged, _id_changed, _kind_changed, _recipe_changed),
    *(_parents_in_a_circle, _forge_run_result, _forge_run_result, _weights_changed, _members_lost, _record_twice),
    *(
        _record_left_out,
        _date_forged,
        _name_forged,
        _line_raw,
        _file_changed,
        _scenario_rewritten,
        _file_added,
        _file_removed,
    ),
)
"""All productions; those that are accepted more easily are listed twice."""
