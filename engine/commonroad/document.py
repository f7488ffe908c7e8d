"""A CommonRoad file that is parsed only where an edit touches it, and its check against the schema.

commonroad-io's writer rounds every state of every obstacle (half of the files change). Here, untouched elements are
copied. Formats: CommonRoad XML 2018b (``<obstacle>`` with ``<role>``) and 2020a (``<dynamicObstacle>``).

Nearly all of a large file is states, and an edit leaves nearly all states unchanged. A file is therefore split into the
bytes of each moving obstacle and the rest. This is done only if the bytes can be split without a parser: in UTF-8,
without comments, CDATA sections, document types, namespaces, carriage returns and processing instructions (other than
those below).

CommonRoad's format has no field for the ego's vehicle class. A processing instruction in the planning problem contains
it: ``<?plannerforge ego-class="truck"?>``. XML provides processing instructions for the data of a single program; the
schema does not cover them, and other readers ignore them. If there is no such instruction, the ego is a car.
commonroad-io's writer, which writes a file from its objects, drops the instruction. Likewise, ``<?plannerforge
prescribed="12 34"?>`` at the beginning of a file lists the road users that move as an edit prescribes: they keep this
motion in reactive traffic. ``<?plannerforge script='{"id":12, …}'?>`` states, as JSON, what a road user does in
reactive traffic if that depends on the ego. ``<?plannerforge friction="0.3"?>`` at the beginning of a file is the
friction coefficient of its roads, for which the format has no field.
"""

import re
from collections.abc import Callable, Container, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from lxml import etree

from ...schemas.errors import ResourceFailure
from ...schemas.text import cited
from .benchmark_id import is_benchmark_id

_CHUNK = "chunk"
"""The attribute of a stand-in with the number of its chunk; a file with this attribute is not split."""
_DECLARED_UTF8 = re.compile(rb"(\xef\xbb\xbf)?<\?xml version=[\"']1\.0[\"']( encoding=[\"'](?i:utf-8)[\"'])?[^>\w]*\?>")
_NOT_PLAIN = (b"<!", b"\r", b"xmlns", _CHUNK.encode())
_BEGIN = re.compile(rb"<(dynamicObstacle|obstacle)((?:\s+[\w.-]+\s*=\s*(?:\"[^\"<>]*\"|'[^'<>]*'))+)\s*>")
_ATTRIBUTE = re.compile(rb"\s+([\w.-]+)\s*=\s*(?:\"([^\"<>]*)\"|'([^'<>]*)')")
_INSTRUCTION = "plannerforge"
"""The target of our processing instruction."""
_EGO_CLASS = re.compile(r'ego-class="([a-z_]{1,30})"')
_INSTRUCTION_BYTES = re.compile(
    rb'<\?plannerforge (?:ego-class="[a-z_]{1,30}"|prescribed="[0-9 ]{0,9999}"|friction="[0-9.]{1,9}"'
    rb"|script='[^'?<>]{2,4000000}')\?>"
)
_FRICTION = re.compile(r'friction="([0-9.]{1,9})"')
_PRESCRIBED = re.compile(rb'<\?plannerforge prescribed="([0-9 ]{0,9999})"\?>')
_SCRIPT = re.compile(rb"<\?plannerforge script='([^'?<>]{2,4000000})'\?>")
_SCRIPT_ID = re.compile(r'"id":\s{0,5}(-?\d{1,18})\b')
_AN_ID = re.compile(rb"id\s*=")
_PLAIN_ID = re.compile(rb"[^\"'<>&]*")
_STAND_IN = re.compile(rb"<(?:dynamicObstacle|obstacle) id=\"[^\"]*\" chunk=\"(\d+)\"/>")
_AFTER_OBSTACLES = ("phantomObstacle", "environmentObstacle", "planningProblem")
"""Elements that the schema requires after the dynamic obstacles."""


def is_declared_utf8(content: bytes) -> bool:
    """Return whether a file begins with an XML declaration of UTF-8, or of no encoding, which implies UTF-8."""
    return _DECLARED_UTF8.match(content) is not None


def is_2018b(root: "etree._Element") -> bool:
    """Return whether a document is in format 2018b, in which obstacles carry their role in an element.

    A network of format 2017a counts too, because it has no obstacles.
    """
    return root.get("commonRoadVersion") in ("2018b", "2017a")


def moving_obstacle(root: "etree._Element") -> str:
    """Return the element name of moving obstacles in a document's format; commonroad-io ignores other names."""
    return "obstacle" if is_2018b(root) else "dynamicObstacle"


def ego_classes_of(root: "etree._Element") -> dict[int, str]:
    """Return the classes of a document's egos, by planning problem id; cars are left out."""
    found: dict[int, str] = {}
    for problem in root.iterchildren("planningProblem"):
        words = [match[1] for each in _instructions(problem) if (match := _EGO_CLASS.fullmatch(each.text or ""))]
        if words and _id_of(problem) is not None:
            found[int(problem.get("id", "0"))] = words[0]
    return {key: word for key, word in found.items() if word != "car"}


def friction_of(root: "etree._Element") -> str | None:
    """Return the friction coefficient of a document's roads as text, or None if it has none."""
    words = [match[1] for each in _instructions(root) if (match := _FRICTION.fullmatch(each.text or ""))]
    return words[0] if words else None


def set_friction(root: "etree._Element", friction: float | None) -> None:
    """Set the friction coefficient of a document's roads, or remove it."""
    for old in _instructions_starting_with(root, "friction="):
        root.remove(old)
    if friction is not None:
        made = etree.ProcessingInstruction(_INSTRUCTION, f'friction="{friction:.6g}"')
        made.tail = root.text
        root.insert(0, made)


def ego_class_instruction(vehicle_class: str) -> "etree._ProcessingInstruction":
    """Return the processing instruction that states the ego's class."""
    return etree.ProcessingInstruction(_INSTRUCTION, f'ego-class="{vehicle_class}"')


def _instructions(problem: "etree._Element") -> list["etree._ProcessingInstruction"]:
    return [
        child for child in problem if isinstance(child, etree._ProcessingInstruction) and child.target == _INSTRUCTION
    ]


def _instructions_starting_with(root: "etree._Element", words: str) -> list["etree._ProcessingInstruction"]:
    return [one for one in _instructions(root) if (one.text or "").startswith(words)]


def without_scripts(root: "etree._Element") -> int:
    """Remove a document's scripts of motions that depend on the ego; return how many there were."""
    found = _instructions_starting_with(root, "script=")
    for one in found:
        root.remove(one)
    return len(found)


def prescribed_ids(path: Path) -> frozenset[int]:
    """Return the ids of a file's road users that move as an edit prescribes."""
    found = _PRESCRIBED.search(path.read_bytes())
    return frozenset() if found is None else frozenset(map(int, found[1].split()))


def script_texts(path: Path) -> tuple[str, ...]:
    """Return a file's scripts of motions that depend on the ego, each as JSON text."""
    return tuple(found[1].decode(errors="replace") for found in _SCRIPT.finditer(path.read_bytes()))


@dataclass(frozen=True)
class SplitDocument:
    """A split file: ``chunks`` are moving obstacles in file order, ``rest`` is the file with a stand-in for each.

    A stand-in is an empty element of the same name with the obstacle's id and the number of its chunk.
    """

    chunks: tuple[bytes, ...]
    rest: bytes

    @classmethod
    def of(cls, content: bytes) -> "SplitDocument | None":
        """Split a file; return None if its bytes may mean something else."""
        if not is_declared_utf8(content) or any(mark in content for mark in _NOT_PLAIN):
            return None
        if content.count(b"<?") != 1 + len(_INSTRUCTION_BYTES.findall(content)):
            return None
        chunks: list[bytes] = []
        rest: list[bytes] = []
        at = 0
        for begin, end, name, number in _obstacles(content):
            rest += [content[at:begin], b'<%b id="%b" chunk="%d"/>' % (name, number, len(chunks))]
            chunks.append(content[begin:end])
            at = end
        return cls(tuple(chunks), b"".join((*rest, content[at:])))

    def with_chunks(self, rest: bytes, made_of: Callable[[bytes], bytes] = bytes) -> bytes:
        """Return a file: its rest, original or reserialised, with the transformed chunks in place of the stand-ins."""
        if not self.chunks:
            return rest
        return _STAND_IN.sub(lambda found: made_of(self.chunks[int(found[1])]), rest)


def _obstacles(content: bytes) -> Iterator[tuple[int, int, bytes, bytes]]:
    """Yield the start and end of each obstacle that has one unique id and contains no other id or obstacle."""
    at = 0
    while found := _BEGIN.search(content, at):
        closing = b"</%b>" % found[1]
        at = content.find(closing, found.end()) + len(closing)
        if at < len(closing):
            return
        given = {name: double or single for name, double, single in _ATTRIBUTE.findall(found[2])}
        number = given.get(b"id")
        is_alone = content.count(b"bstacle", found.start(), at) == 2 and (  # its own two tags
            len(_AN_ID.findall(content, found.start(), at)) == 1
        )
        if number is not None and is_alone and _PLAIN_ID.fullmatch(number):
            yield found.start(), at, found[1], number


@dataclass(frozen=True)
class ScenarioDocument:
    """The tree of a scenario file, with stand-ins for moving obstacles if it is split; the methods change the tree."""

    tree: "etree._ElementTree"
    split: SplitDocument

    @classmethod
    def read(cls, path: Path) -> "ScenarioDocument":
        """Parse a file that was already scanned; entities are not resolved."""
        content = path.read_bytes()
        whole = SplitDocument((), content)
        split = SplitDocument.of(content) or whole
        try:
            return cls(_parsed(split.rest).getroottree(), split)
        except etree.XMLSyntaxError:  # for example nested obstacles, which are not documents when separated
            return cls(_parsed(content).getroottree(), whole)

    @property
    def root(self) -> "etree._Element":
        """The ``<commonRoad>`` element."""
        return self.tree.getroot()

    @property
    def is_2018b(self) -> bool:
        """Whether obstacles carry their role in an element."""
        return is_2018b(self.root)

    @property
    def highest_id(self) -> int:
        """The highest id of anything in the file."""
        ids = cast("list[str]", self.tree.xpath("//@id"))
        return max((int(text) for text in ids if text.strip().isdecimal()), default=0)

    def obstacle(self, obstacle_id: int) -> "etree._Element":
        """Return the element of an obstacle of any kind.

        Raises:
            ResourceFailure: the file has no such element, although the reader found one.
        """
        for element in self.root:
            is_obstacle = isinstance(element.tag, str) and element.tag.lower().endswith("obstacle")
            if is_obstacle and _id_of(element) == obstacle_id:
                return self._whole(element)
        raise ResourceFailure(f"the file has no obstacle element {obstacle_id}")

    def _whole(self, element: "etree._Element") -> "etree._Element":
        """Return the parsed obstacle, which replaces its stand-in."""
        number = element.get(_CHUNK)
        if number is None or not self.split.chunks:
            return element
        obstacle = _parsed(self.split.chunks[int(number)])
        obstacle.tail = element.tail
        self.root.replace(element, obstacle)
        return obstacle

    def problem(self, problem_id: int) -> "etree._Element":
        """Return the element of a planning problem.

        Raises:
            ResourceFailure: the file has no such planning problem.
        """
        for element in self.root.iter("planningProblem"):
            if _id_of(element) == problem_id:
                return element
        raise ResourceFailure(f"the file has no planning problem {problem_id}")

    def set_ego_class(self, problem_id: int, vehicle_class: str) -> None:
        """Set the class of a planning problem's ego; for a car, nothing is written."""
        problem = self.problem(problem_id)
        for old in _instructions(problem):
            problem.remove(old)
        if vehicle_class != "car":
            made = ego_class_instruction(vehicle_class)
            made.tail = problem.text
            problem.insert(0, made)

    def set_prescribed(self, ids: Iterable[int]) -> None:
        """Mark road users as having a prescribed motion, in addition to those already marked in the file."""
        known = set(ids)
        for old in _instructions_starting_with(self.root, "prescribed="):
            known |= {int(word) for word in re.findall(r"\d+", old.text or "")}
            self.root.remove(old)
        if known:
            made = etree.ProcessingInstruction(_INSTRUCTION, f'prescribed="{" ".join(map(str, sorted(known)))}"')
            made.tail = self.root.text
            self.root.insert(0, made)

    def set_scripts(self, texts: Iterable[str], without: Container[int] = ()) -> None:
        """Store, as JSON, the scripts of road users that depend on the ego, except those in ``without``."""
        kept = []
        for old in _instructions_starting_with(self.root, "script="):
            own = _SCRIPT_ID.search(old.text or "")
            if own is not None and int(own[1]) not in without:
                kept.append(old.text or "")
            self.root.remove(old)
        for text in reversed([*kept, *(f"script='{text}'" for text in texts)]):
            made = etree.ProcessingInstruction(_INSTRUCTION, text)
            made.tail = self.root.text
            self.root.insert(0, made)

    def remove(self, element: "etree._Element") -> None:
        """Remove a first-level element, with the white space that follows it."""
        self.root.remove(element)

    def add_obstacle(self, element: "etree._Element", *, is_static: bool = False) -> None:
        """Add an obstacle: static obstacles are placed before the dynamic obstacles, all others after them."""
        names = ("staticObstacle",) if is_static and not self.is_2018b else ("dynamicObstacle", "obstacle")
        existing = [child for child in self.root if child.tag in names]
        after = (*(("dynamicObstacle",) if is_static else ()), *_AFTER_OBSTACLES)
        following = [child for child in self.root if child.tag in after]
        self._indent(element, 1)
        if existing:
            element.tail = existing[-1].tail
            existing[-1].tail = "\n" + self._indent_unit()
            existing[-1].addnext(element)
        elif following:
            element.tail = "\n" + self._indent_unit()
            following[0].addprevious(element)
        else:
            element.tail = "\n"
            self.root.append(element)

    def replace_children(
        self, parent: "etree._Element", old: list["etree._Element"], new: list["etree._Element"]
    ) -> None:
        """Replace old children with new ones, with the same indentation; ``old`` must not be empty."""
        place, tail = parent.index(old[0]), old[-1].tail
        level = len(list(old[0].iterancestors()))
        for element in old:
            parent.remove(element)
        for offset, element in enumerate(new):
            self._indent(element, level)
            element.tail = "\n" + self._indent_unit() * level
            parent.insert(place + offset, element)
        if new:
            new[-1].tail = tail

    def write(self, path: Path, benchmark_id: str) -> None:
        """Write the tree with a new benchmark id, in UTF-8 and with an XML declaration."""
        self.root.set("benchmarkID", benchmark_id)
        written = etree.tostring(self.tree, xml_declaration=True, encoding="UTF-8")
        path.write_bytes(self.split.with_chunks(written))

    def _indent(self, element: "etree._Element", level: int) -> None:
        etree.indent(element, space=self._indent_unit() or " ", level=level)

    def _indent_unit(self) -> str:
        """Return the white space of one indentation level in the file."""
        text = (self.root.text or "").rpartition("\n")[2]
        return text if text.strip() == "" else ""


def _parsed(content: bytes) -> "etree._Element":
    parser = etree.XMLParser(resolve_entities=False, no_network=True, remove_blank_text=False, huge_tree=True)
    return etree.fromstring(content, parser)


def _id_of(element: "etree._Element") -> int | None:
    """Return the id as a number; the schema allows leading zeros and spaces."""
    text = element.get("id", "").strip()
    return int(text) if text.isdecimal() else None


@dataclass(frozen=True)
class SchemaFault:
    """A violation of CommonRoad's schema: the line in the file, the path of the element, and the reason, quoted."""

    line: int
    path: str
    message: str

    @property
    def element_name(self) -> str:
        """The name of the element."""
        return self.path.rsplit("/", 1)[-1].partition("[")[0]


def schema_faults(tree: "etree._ElementTree") -> list[SchemaFault]:
    """Return the violations of CommonRoad's XML schema (2020a) in a file's tree, in file order."""
    import commonroad

    folder = Path(str(commonroad.__file__)).parent / "scenario_definition" / "xml_definition_files"
    schema = etree.XMLSchema(etree.parse(folder / "XML_commonRoad_XSD.xsd"))
    schema.validate(tree)
    log: Any = schema.error_log
    return [SchemaFault(int(error.line), str(error.path or ""), cited(error.message)) for error in log]


def schema_errors(document: "Path | etree._ElementTree") -> list[str]:
    """Return a file's violations of CommonRoad's XML schema (2020a) and of its benchmark naming.

    Each violation is a line of at most 200 characters, because the schema's messages repeat content of the file.
    """
    tree = etree.parse(document) if isinstance(document, Path) else document
    errors = [fault.message for fault in schema_faults(tree)]
    benchmark_id = tree.getroot().get("benchmarkID", "")
    if not is_benchmark_id(benchmark_id):
        errors.append(f"{cited(benchmark_id)} is not a benchmark id of 2020a")
    return errors
