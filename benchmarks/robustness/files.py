"""Hostile files: real scenarios, maps, networks and weight files, mutated by bytes, by nodes and by numbers.

Each is sent alone (``import_files`` of the file, then a call that uses the stored artifact), and some are sent together
in folders. Others were never valid: bombs, links, FIFOs and names that forge lines.
"""

import bz2
import copy
import gzip
import io
import zipfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from lxml import etree

from . import texts
from .inputs import INJECTED, MADE, ROOT, Call, Chance, HostileInput, PlacedFile

_MOST_BYTES = 3_000_000
"""Larger mutants are truncated, because they would only be slow to write (chosen)."""
_USED_AFTERWARDS = 0.12
"""Share of the stored mutants that are drawn, edited or run in addition to described (chosen)."""
_FOLDER_OF = 12
"""Number of mutants in a folder (chosen)."""
_NUMBERS = (
    *("NaN", "nan", "inf", "-inf", "1e300", "-1e300", "-4.5", "1e9", "1e26", "100000000000000000000000000", "0", "-1"),
    *(
        "1e-30",
        "10000000",
        "9" * 5000,
        "",
        " ",
        "1,5",
        "0x10",
        "1e7",
        "-0",
        "true",
        "2147483648",
        "9223372036854775808",
    ),
    *("1e-300", "0.1e", "٣", "5e8", "100000001"),
)
_TEXTS = (
    *("", "x" * 300, "x" * 100_000, f"a\n{INJECTED}", f"a&#10;{INJECTED}", f"b\u2028{INJECTED}\u2028[ok]", "\u202eabc"),
    *(
        "../../x",
        "/etc/passwd",
        "a\x85b",
        "<b>",
        "é" * 200,
        "DEU_" + "x" * 250 + "-1_1_T-1",
        "%s",
        "{}",
        "C-",
        "ZAM_../x",
    ),
)


@dataclass(frozen=True)
class Seed:
    """A sound file: its ending, which says the kind, and its content."""

    ending: str
    content: bytes


def hostile_files(seeds: Mapping[str, list[Seed]], chance: Chance) -> Iterator[HostileInput]:
    """Yield endless inputs from one source of chance."""
    number = 0
    while True:
        number += 1
        ending = chance.choices(list(seeds), weights=[6 if ending == ".xml" else 2 for ending in seeds])[0]
        if number % 40 == 0:
            yield _together(seeds, chance, number)
            continue
        seed = chance.choice(seeds[ending])
        content, how = mutated(seed, chance)
        folder = f"in{number}"
        name = f"f{number}{ending}" if chance.random() < 0.95 else _hostile_name(chance, ending)
        if ending == ".zip":
            calls: tuple[Call, ...] = (Call(f"{ROOT}/{folder}/{name}", {}, "archive"),)
            yield HostileInput("files", f"{ending}: {how}", calls, (PlacedFile(f"{folder}/{name}", content),))
            continue
        arguments: dict[str, object] = {"path": f"{ROOT}/{folder}/{name}"}
        if chance.random() < 0.1:
            arguments["name"] = texts.any_text(chance)
        calls = (Call("import_files", arguments), *_uses(ending, chance))
        yield HostileInput("files", f"{ending}: {how}", calls, (PlacedFile(f"{folder}/{name}", content[:_MOST_BYTES]),))


def mutated(seed: Seed, chance: Chance) -> tuple[bytes, str]:
    """Return a mutant of a file, and the name of the mutation."""
    if seed.ending.endswith((".gz", ".bz2")):
        packed = _gzip if seed.ending.endswith(".gz") else bz2.compress
        if chance.random() < 0.5:
            return _by_bytes(packed(seed.content), chance)
        content, how = mutated(Seed(seed.ending.rpartition(".")[0], seed.content), chance)
        return packed(content), f"packed {how}"
    if seed.ending == ".zip":
        return _by_members(seed.content, chance) if chance.random() < 0.5 else _by_bytes(seed.content, chance)
    if seed.ending.endswith((".yaml", ".yml")):
        ways = (_by_bytes, _by_lines, _by_lines, _by_lines)
        return chance.choice(ways)(seed.content, chance)
    if seed.ending.endswith(".pbf") or chance.random() < 0.15:
        return _by_bytes(seed.content, chance)
    return _by_nodes(seed.content, chance)


def _gzip(content: bytes) -> bytes:
    """Compress without a time stamp."""
    return gzip.compress(content, mtime=0)


def _uses(ending: str, chance: Chance) -> tuple[Call, ...]:
    """Return the calls that use a stored artifact."""
    if ending != ".xml":
        return ()
    known = {"scenario_id": MADE}
    describe = Call(
        "describe_scenario", {**known, "detail": chance.choice(("brief", "vehicles", "lanelets", "checks"))}
    )
    if chance.random() > _USED_AFTERWARDS:
        return (describe,)
    heavy = (
        Call("render", {"ids": [MADE]}),
        Call("run_planner", {"scenarios": [MADE], "configs": ["idm"], "wait_s": 20}),
        Call("modify_scenario", {**known, "edits": [{"op": "set_speed", "vehicles": ["lead"], "speed": "5m/s"}]}),
        Call("modify_scenario", {**known, "edits": [{"op": "remove_vehicle", "vehicles": ["nearest:1"]}]}),
        Call("modify_scenario", {**known, "edits": [{"op": "add_vehicle", "vehicle_class": "car", "at": "ego"}]}),
        Call("find_scenarios", {"like": MADE}),
        Call("export_artifacts", {"ids": [MADE], "folder": f"{ROOT}/out", "formats": ["recipe"], "overwrite": True}),
    )
    return (describe, chance.choice(heavy))


def _together(seeds: Mapping[str, list[Seed]], chance: Chance, number: int) -> HostileInput:
    """Import a folder of mutants; a bad one must not keep the others out."""
    files = []
    for place in range(_FOLDER_OF):
        seed = chance.choice(seeds[chance.choice([ending for ending in seeds if ending != ".zip"])])
        content, _ = mutated(seed, chance)
        files.append(PlacedFile(f"in{number}/d{place % 3}/f{place}{seed.ending}", content[:_MOST_BYTES]))
    return HostileInput("files", "folder", (Call("import_files", {"path": f"{ROOT}/in{number}"}),), tuple(files))


def _hostile_name(chance: Chance, ending: str) -> str:
    stem = chance.choice(
        (f"a\n{INJECTED}", "x" * 240, "é" * 100, "\u202egpj", "a b'\"", "-rf", ".hidden", "%00", "a\x1b[31m", "..a")
    )
    return stem[: 250 - len(ending)] + ending


def _by_bytes(content: bytes, chance: Chance) -> tuple[bytes, str]:
    """Change, cut, double or insert bytes."""
    data = bytearray(content)
    way = chance.choice(("flip", "cut", "double", "insert", "empty", "encoding", "zeros"))
    if way == "flip":
        for _ in range(chance.choice((1, 5, 100))):
            data[chance.randrange(len(data))] = chance.randrange(256)
    elif way == "cut":
        begin, end = sorted((chance.randrange(len(data)), chance.randrange(len(data))))
        data = data[:begin] if chance.random() < 0.5 else data[:begin] + data[end:]
    elif way == "double":
        begin = chance.randrange(len(data))
        data = data[:begin] + data[begin : begin + 5000] * chance.choice((2, 20)) + data[begin:]
    elif way == "insert":
        at = chance.randrange(len(data))
        data = (
            data[:at] + chance.choice((b"\x00", b"\xff\xfe", b"<", b"&#x0;", b"<!--", b"]]>", b"\n" * 9999)) + data[at:]
        )
    elif way == "empty":
        data = bytearray(
            chance.choice((b"", b"\n", b"\x00" * 1000, b"<", b"<a/>", b"\xef\xbb\xbf", b"{}", b"PK\x03\x04"))
        )
    elif way == "encoding":
        data = bytearray(content.decode("utf-8", "replace").encode(chance.choice(("utf-16", "utf-32", "utf-7"))))
    else:
        at = chance.randrange(len(data))
        data = data[:at] + bytearray(chance.choice((100, 100_000))) + data[at:]
    return bytes(data), f"bytes {way}"


_MEMBERS = (
    *(
        "../a.xml",
        "/etc/a.xml",
        "..\\a.xml",
        "a/../../a.xml",
        "C:\\a.xml",
        "~/a.xml",
        "x" * 300 + ".xml",
        ".xml",
        "..xml",
    ),
    *("a\x00.xml", f"a\n{INJECTED}.xml", "con.xml", "a.xml/", "a.xml", "a.xml", "\u202ea.xml", "é" * 200 + ".xml"),
)


def _by_members(content: bytes, chance: Chance) -> tuple[bytes, str]:
    """Return an archive with other members: paths that lead outside, links, bombs, locked ones, many."""
    packed = io.BytesIO()
    way = chance.choice(("names", "link", "bomb", "locked", "method", "many", "sizes"))
    with zipfile.ZipFile(io.BytesIO(content)) as old:
        sound = old.read(old.namelist()[0])
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        member = zipfile.ZipInfo("a.xml")
        if way == "names":
            for name in {chance.choice(_MEMBERS) for _ in range(4)}:
                archive.writestr(zipfile.ZipInfo(name), sound)
        elif way == "link":
            member.external_attr = 0o120777 << 16
            archive.writestr(member, chance.choice(("/etc/passwd", "../../outside/secret.xml", "/dev/zero")))
        elif way == "bomb":
            archive.writestr(member, bytes(chance.choice((1_000_000, 30_000_000))), zipfile.ZIP_DEFLATED)
        elif way == "many":
            for number in range(chance.choice((10, 2000))):
                archive.writestr(f"d{number}/a.xml", b"<a/>")
        else:
            archive.writestr(member, sound)
    data = bytearray(packed.getvalue())
    if way in ("locked", "method", "sizes"):  # in the central directory: flags, method, sizes
        at = data.rfind(b"PK\x01\x02") + {"locked": 8, "method": 10, "sizes": 20}[way]
        data[at] = {"locked": 1, "method": chance.choice((1, 6, 9, 12, 14, 95, 99)), "sizes": chance.randrange(256)}[
            way
        ]
    return bytes(data), f"zip {way}"


def _by_lines(content: bytes, chance: Chance) -> tuple[bytes, str]:
    """Change lines or numbers of a weight file."""
    lines = content.decode().splitlines()
    at = chance.randrange(len(lines))
    way = chance.choice(("number", "key", "line", "drop", "bomb", "tag", "deep", "many"))
    key = lines[at].partition(":")[0]
    if way == "number":
        lines[at] = f"{key}: {chance.choice((*_NUMBERS, '[1, 2]', '{a: 1}', 'yes', '2020-01-01', '~', '!!float x'))}"
    elif way == "key":
        lines[at] = f"  {chance.choice((*_TEXTS, '? [a]', '1', '~', '*a', '<<'))!s}: 1"
    elif way == "line":
        lines[at] = chance.choice((*_TEXTS, "\tx: 1", "- 1", "a: b: c", "%YAML 9.9", "---", "...", "|", ">"))
    elif way == "drop":
        del lines[at]
    elif way == "bomb":
        return alias_bomb(chance.choice((3, 5, 6, 7)), chance.choice((4, 8, 10)), chance), "alias bomb"
    elif way == "tag":
        lines[at] = (
            f"{key}: {chance.choice(('!!python/object/apply:os.system [id]', '!!binary aaaa', '!x 1', '&a [*a]'))}"
        )
    elif way == "deep":
        lines[at] = key + ": " + "[" * chance.choice((50, 2000, 20_000))
    else:
        lines = lines[:1] + [f"  weight_{number}: 1.0" for number in range(chance.choice((1000, 20_000)))]
    return "\n".join(lines).encode(errors="replace"), f"yaml {way}"


def alias_bomb(levels: int, width: int, chance: Chance) -> bytes:
    """Return a small YAML with a value that expands to ``width`` to the power of ``levels`` items."""
    lines = ["a0: &a0 [" + ",".join(["x"] * width) + "]"]
    lines += [f"a{level}: &a{level} [" + ",".join([f"*a{level - 1}"] * width) + "]" for level in range(1, levels)]
    where = chance.choice(
        ("cost_weights:\n  jerk: *a{0}", "planner: *a{0}\ncost_weights: {{jerk: 1}}", "cost_weights: *a{0}")
    )
    return "\n".join([*lines, where.format(levels - 1)]).encode()


def _by_nodes(content: bytes, chance: Chance) -> tuple[bytes, str]:
    """Delete, double, swap or nest XML nodes, or change numbers, references and texts."""
    root = etree.fromstring(content, etree.XMLParser(huge_tree=True, resolve_entities=False))
    nodes = [node for node in root.iter() if isinstance(node.tag, str)]
    way = chance.choice(list(_WAYS))
    for _ in range(chance.choice((1, 1, 1, 3, 20))):
        _WAYS[way](nodes, chance)
    if chance.random() < 0.05:
        return _with_doctype(etree.tostring(root), chance), "doctype"
    return etree.tostring(root, xml_declaration=True, encoding="UTF-8"), f"xml {way}"


_Nodes = list[etree._Element]
_Way = Callable[[_Nodes, Chance], None]
"""Changes a document in place; its nodes, the root first."""


def _delete(nodes: _Nodes, chance: Chance) -> None:
    node = chance.choice(nodes)
    parent = node.getparent()
    if parent is not None:
        parent.remove(node)


def _double(nodes: _Nodes, chance: Chance) -> None:
    node = chance.choice(nodes[1:])
    parent = node.getparent()
    if parent is not None and len(node) < 200:
        for _ in range(chance.choice((1, 1, 2, 200 if len(node) < 4 else 2))):
            parent.append(copy.deepcopy(node))


def _swap(nodes: _Nodes, chance: Chance) -> None:
    one, other = chance.choice(nodes), chance.choice(nodes)
    one.tag, other.tag = other.tag, one.tag
    one.text, other.text = other.text, one.text


def _number(nodes: _Nodes, chance: Chance) -> None:
    node = chance.choice(nodes)
    numeric = [key for key, value in node.attrib.items() if _is_number(str(value))]
    if _is_number(node.text or ""):
        node.text = chance.choice(_NUMBERS)
    elif numeric:
        node.set(chance.choice(numeric), chance.choice(_NUMBERS))
    else:
        _number_of_kind(nodes, chance)


def _number_of_kind(nodes: _Nodes, chance: Chance) -> None:
    """Change all numbers under nodes of one name: every length, every time, every coordinate."""
    tag, value = (
        chance.choice([node.tag for node in nodes if _is_number(node.text or "")] or ["x"]),
        chance.choice(_NUMBERS),
    )
    for node in nodes:
        if node.tag == tag:
            node.text = value


def _text(nodes: _Nodes, chance: Chance) -> None:
    node = chance.choice([*nodes, nodes[0], nodes[0]])
    value = "".join(c for c in chance.choice(_TEXTS) if c.isprintable() or c in "\n\t")
    if node.attrib and chance.random() < 0.8:
        node.set(chance.choice(list(node.attrib)), value)
    else:
        node.text = value


def _reference(nodes: _Nodes, chance: Chance) -> None:
    """Change ids and references: doubled, missing, huge, to themselves."""
    named = [(node, key) for node in nodes for key in ("id", "ref", "from", "to", "lane", "edge") if key in node.attrib]
    if not named:
        return
    node, key = chance.choice(named)
    other, other_key = chance.choice(named)
    values = (str(other.get(other_key)), "999999", "-1", "0", "1e26", "1" + "0" * 26, "9" * 5000, "", "a b", "x")
    node.set(key, chance.choice(values))


def _nest(nodes: _Nodes, chance: Chance) -> None:
    node = chance.choice(nodes)
    for _ in range(chance.choice((10, 300, 5000))):
        node = etree.SubElement(node, node.tag)


def _far(nodes: _Nodes, chance: Chance) -> None:
    """Move one or all coordinates far away."""
    names = {"x", "y", "lat", "lon"}
    value = chance.choice(("10000000", "1e7", "-1e7", "1e8", "180", "90", "-179.999", "1e300"))
    places = [node for node in nodes if node.tag in names]
    for node in places if chance.random() < 0.2 else places[: chance.choice((1, 4))]:
        node.text = value
    for node in nodes if chance.random() < 0.2 else chance.sample(nodes, min(len(nodes), 20)):
        for key in names & set(map(str, node.attrib)):
            node.set(key, value)


def _many_problems(nodes: _Nodes, chance: Chance) -> None:
    """Add many planning problems, obstacles or streets of the same form."""
    found = [
        node for node in nodes if node.tag in ("planningProblem", "obstacle", "dynamicObstacle", "way", "trafficSign")
    ]
    parent = found[0].getparent() if found else None
    if parent is None or len(found) > 1000:
        return
    original = chance.choice(found)
    if len(etree.tostring(original)) > 3000:
        return
    for number in range(chance.choice((3, 50, 1000 if original.tag == "planningProblem" else 100))):
        twin = copy.deepcopy(original)
        twin.set("id", str(700_000 + number))
        parent.append(twin)


def _header(nodes: _Nodes, chance: Chance) -> None:
    """Change the attributes of the root: version, id, step, author."""
    root = nodes[0]
    key = chance.choice([*root.attrib, "timeStepSize", "benchmarkID", "commonRoadVersion", "author"])
    value = chance.choice((*_NUMBERS, *_TEXTS, "2020a", "2018b", "1e-30", "1e-30", "9.9"))
    root.set(key, "".join(c for c in value if c.isprintable() or c in "\n\t"))


_WAYS: dict[str, _Way] = {
    "delete": _delete,
    "double": _double,
    "swap": _swap,
    "number": _number,
    "numbers of a kind": _number_of_kind,
    "text": _text,
    "reference": _reference,
    "nest": _nest,
    "far": _far,
    "many": _many_problems,
    "header": _header,
}


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _with_doctype(content: bytes, chance: Chance) -> bytes:
    bomb = b'<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa">' + b"".join(
        b'<!ENTITY %c "%s">' % (98 + level, b"&%c;" % (97 + level) * 10) for level in range(9)
    )
    outside = b'<!DOCTYPE x [<!ENTITY j SYSTEM "file:///etc/passwd">'
    head = chance.choice((bomb, outside, b'<!DOCTYPE x SYSTEM "http://localhost:1/x.dtd" ['))
    begin = content.find(b">") + 1
    return head + b"]>" + content[:begin] + b"&j;" + content[begin:]
