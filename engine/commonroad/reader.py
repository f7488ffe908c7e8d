"""Reading CommonRoad XML files (2018b and 2020a), and scanning XML of any kind, without trusting the file.

commonroad-io reads with ElementTree, which takes 200,000 nesting levels and expands the entities that a file declares.
So a file passes three gates before anything is computed from it:

1. Its bytes are within ``XmlLimits`` and declare no document type, by a scan with expat that keeps nothing, or by
   counting bytes where that is enough (``parse_document``).
2. Every number, count and text is within what scenarios have (``value_limits``), in the parsed document.
3. commonroad-io reads that document. Whatever it raises becomes one ``UnsafeInput``.

The states of plain trajectories, most of a file, are read into arrays before (``plain_states``), so that commonroad-io
reads the rest: ``read_recorded`` gives them as tracks, ``read_scenario`` as the objects that commonroad-io makes.
"""

import hashlib
import logging
import math
import os
import warnings
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree.ElementTree import Element, ElementTree, fromstring
from xml.parsers import expat

from commonroad.common.reader.file_reader_xml import XMLFileReader
from lxml import etree

from ...schemas.errors import UnknownName, UnsafeInput
from ...schemas.text import cited, shown_name
from ...schemas.vocabulary import EGO_CLASSES, LEAST_FRICTION, MOST_FRICTION
from .benchmark_id import without_blanks
from .completeness import check_complete, complete
from .document import (
    SplitDocument,
    ego_classes_of,
    friction_of,
    is_2018b,
    is_declared_utf8,
    moving_obstacle,
    schema_faults,
)
from .lanelet_networks import scenario_of
from .plain_states import PlainStates, cut_states, put_states, take_plain_states, take_states
from .recordings import FOLDER_VARIABLE, Recording, RecordingStore
from .tracks import Track, recorded_tracks
from .value_limits import MOST_OF_A_KIND, BeyondLimits, check_document

if TYPE_CHECKING:
    from commonroad.planning.planning_problem import PlanningProblem, PlanningProblemSet
    from commonroad.scenario.lanelet import Lanelet
    from commonroad.scenario.scenario import Scenario


@dataclass(frozen=True)
class XmlLimits:
    """What an XML file may hold at most before any parser of a library sees it.

    Chosen well above what occurs and below what harms: the largest of about 200 scenarios of CommonRoad measured has
    1.4 MB, 8 levels, 46,000 elements and 370 lanelets.

    ``size_bytes``: bytes of the file. ``depth``: levels of elements, which parsers follow by recursion. ``elements``:
    each takes about 250 bytes in memory, so all of them less than 400 MB. ``tag_bytes``: one tag or comment, which
    expat reads anew with every block until it ends, so that time grows with the square. ``lanelets``: commonroad-io
    makes a polygon of each.
    """

    size_bytes: int = 100_000_000
    depth: int = 64
    elements: int = 1_500_000
    tag_bytes: int = 1_000_000
    lanelets: int = MOST_OF_A_KIND["lanelet"]


@dataclass(frozen=True)
class LoadedScenario:
    """A CommonRoad scenario in memory, with its planning problems and the file it came from.

    ``plain_states``: by obstacle id, the states after the initial one of those that were read as arrays: points and
    exact headings. ``ego_classes``: the ego's class by planning problem, without cars. ``friction``: the coefficient of
    friction of the roads; None if the file does not state it.
    """

    scenario: "Scenario"
    planning_problems: "PlanningProblemSet"
    path: Path
    declared_id: str = ""
    plain_states: Mapping[int, PlainStates] = field(default_factory=dict)
    ego_classes: Mapping[int, str] = field(default_factory=dict)
    friction: float | None = None

    def ego_class(self, problem_id: int) -> str:
        """Return the class of a planning problem's ego by the file, or a car if the file does not say."""
        return self.ego_classes.get(problem_id, "car")

    @cached_property
    def tracks(self) -> dict[int, Track]:
        """The recording, as ``recorded_tracks`` gives it."""
        return recorded_tracks(self.scenario, self.plain_states)

    @property
    def footways(self) -> "tuple[Lanelet, ...]":
        """The lanelets that are open to pedestrians in both directions, and to nobody else: not in the network."""
        return tuple(getattr(self.scenario, "footways", ()))  # format 2018b has none

    @property
    def benchmark_id(self) -> str:
        """The CommonRoad benchmark id as in the file, without blanks; commonroad-io changes other unusual ones too."""
        return without_blanks(self.declared_id) or str(self.scenario.scenario_id)

    @property
    def step_s(self) -> float:
        """Duration of one time step in seconds."""
        return float(self.scenario.dt)

    def problem(self, problem_id: int | None = None) -> "PlanningProblem":
        """The planning problem with this id, or the one with the lowest.

        Raises:
            UnknownName: the file has no planning problem, or none with this id.
        """
        problems = self.planning_problems.planning_problem_dict
        if not problems:
            raise UnknownName(
                f"{self.benchmark_id} has no planning problem",
                next_step="use a scenario with a planning problem, or add a goal with modify_scenario op set_goal",
            )
        if problem_id is None:
            return problems[min(problems)]
        if problem_id not in problems:
            raise UnknownName(f"{self.benchmark_id} has no planning problem {problem_id}", valid=sorted(problems))
        return problems[problem_id]


@dataclass(frozen=True, eq=False)
class RecordedScenario:
    """A scenario with its recording; the obstacles of ``loaded`` keep the first and the last of their states only.

    It equals itself alone, so that what is made of it can be kept with it.
    """

    loaded: LoadedScenario

    @property
    def tracks(self) -> dict[int, Track]:
        """The recording, as ``recorded_tracks`` gives it."""
        return self.loaded.tracks


def read_scenario(path: Path, limits: XmlLimits | None = None) -> LoadedScenario:
    """Check and read a CommonRoad file.

    Raises:
        UnsafeInput: the file is hostile, broken, not a CommonRoad file, has no lanelets or an id twice, or a
            number is beyond its limits.
    """
    loaded = _open(path, *_road_document(path, limits))
    states = loaded.plain_states
    put_states(loaded.scenario, states)
    return loaded


def read_recorded(path: Path, limits: XmlLimits | None = None) -> RecordedScenario:
    """Read a CommonRoad file as ``read_scenario`` does, with its recording as arrays in place of objects.

    Raises:
        UnsafeInput: the file is hostile, broken, not a CommonRoad file, has no lanelets or an id twice, or a
            number is beyond its limits.
    """
    recorded = RecordedScenario(_open(path, *_road_document(path, limits)))
    _ = recorded.tracks  # which refuses a state without a position
    return recorded


_KEPT = 4
"""Scenarios that a worker keeps, some MB each (chosen): one is edited, run and drawn again and again."""


def kept_recording(path: Path, size_bytes: int | None = None, *, keep: bool = True) -> RecordedScenario:
    """A CommonRoad file as ``read_recorded`` reads it, and the same object while its content is the same.

    What a worker wrote and read back, to check it, is not parsed again when it is asked for where it was stored, and
    what one worker has read another one finds on disk (``recordings``). Nobody changes what is kept.

    Args:
        path: the file.
        size_bytes: how large it may be; None: as large as ``XmlLimits`` says.
        keep: keep it on disk too; not worth while for a file that is looked at once, of many.

    Raises:
        UnsafeInput: as ``read_recorded``.
    """
    limits = XmlLimits() if size_bytes is None else XmlLimits(size_bytes=size_bytes)
    try:
        content = path.read_bytes() if path.stat().st_size <= limits.size_bytes else b""
    except OSError:
        content = b""
    if not content:
        return read_recorded(path, limits)  # which says what is wrong with the file
    return _kept(path, _Content(hashlib.sha256(content).hexdigest(), path, limits, keep))


@dataclass(frozen=True)
class _Content:
    """What a file holds, wherever it lies; the rest says where, and with which limits, it is read first."""

    digest: str
    path: Path = field(compare=False)
    limits: XmlLimits = field(compare=False)
    keep: bool = field(compare=False)


@lru_cache(maxsize=_KEPT)
def _kept(path: Path, content: _Content) -> RecordedScenario:
    parsed = _parsed(content)
    return parsed if parsed.loaded.path == path else RecordedScenario(replace(parsed.loaded, path=path))


@lru_cache(maxsize=_KEPT)
def _parsed(content: _Content) -> RecordedScenario:
    store = _recordings()
    found = None if store is None else store.find(content.digest)
    if found is not None:
        return RecordedScenario(
            LoadedScenario(
                found.scenario,
                found.planning_problems,
                content.path,
                found.declared_id,
                found.plain_states,
                found.ego_classes,
                found.friction,
            )
        )
    read = read_recorded(content.path, content.limits)
    if store is not None and content.keep:
        loaded = read.loaded
        store.put(
            content.digest,
            Recording(
                loaded.scenario,
                loaded.planning_problems,
                loaded.declared_id,
                loaded.plain_states,
                loaded.ego_classes,
                loaded.friction,
            ),
        )
    return read


@cache
def _recordings() -> RecordingStore | None:
    """The recordings on disk that the process was given; None without any."""
    folder = os.environ.get(FOLDER_VARIABLE)
    return RecordingStore(Path(folder)) if folder else None


_RoadDocument = tuple[Element, dict[int, PlainStates], dict[int, str], float | None]
"""A checked document, the states that were taken out of it, what its egos are, and the friction of its roads."""


def _road_document(path: Path, limits: XmlLimits | None) -> _RoadDocument:
    """Read and check a document, and take out of it what is read in another way.

    commonroad-io fails on a scenario without lanelets, and its error does not say why.
    """
    content, limits = _small_content(path), limits or XmlLimits()
    whole, states = _split_document(content, limits) or (
        _parsed_document(path, content, limits, keeps_instructions=True),
        None,
    )
    ego_classes = _known_ego_classes(path, ego_classes_of(whole))
    friction = _possible_friction(path, friction_of(whole))
    etree.strip_elements(whole, etree.ProcessingInstruction, with_tail=False)
    refuse_another_root(path, str(whole.tag))
    if whole.find("lanelet") is None:
        raise UnsafeInput(
            f"{shown_name(path.name)} has no lanelets, so there is no road to drive on",
            next_step="export the scenario again with its lanelet network, or choose another file",
        )
    states = take_plain_states(whole) if states is None else states
    root = fromstring(etree.tostring(whole))  # noqa: S314 - serialised just now
    _check(path, root, limits, states)
    complete(root)
    return root, states, ego_classes, friction


def _known_ego_classes(path: Path, found: dict[int, str]) -> dict[int, str]:
    """Return the classes of a file's egos after checking that each of them exists."""
    for word in found.values():
        if word not in EGO_CLASSES:
            raise UnsafeInput(
                f"{shown_name(path.name)} says that its ego is a {cited(word)}, which no ego can be here",
                valid=EGO_CLASSES,
                next_step="name one of these in the file's <?plannerforge ego-class=…?>, or take that out: a car then",
            )
    return found


def _possible_friction(path: Path, text: str | None) -> float | None:
    """Return the friction that a file states after checking that a road can have it."""
    try:
        friction = None if text is None else float(text)
    except ValueError:
        friction = math.nan
    if friction is not None and not LEAST_FRICTION <= friction <= MOST_FRICTION:
        raise UnsafeInput(
            f"{shown_name(path.name)} states a friction of {cited(text or '')}, which no road has",
            valid=[f"{LEAST_FRICTION:g} … {MOST_FRICTION:g}"],
            next_step="correct the file's <?plannerforge friction=…?>, or take it out",
        )
    return friction


def _split_document(content: bytes, limits: XmlLimits) -> "tuple[etree._Element, dict[int, PlainStates]] | None":
    """The document without the states of plain trajectories, and these; an obstacle that is known by its bytes is not
    parsed again. None where the file has to be looked at as a whole: that tells what is wrong with it too.
    """
    split = SplitDocument.of(content) if _is_surely_within(content, limits, limits.elements) else None
    if split is None or not split.chunks:
        return None
    states: dict[int, PlainStates] = {}

    def taken_from(chunk: bytes) -> bytes:
        read = _read_obstacle(chunk)
        if read.taken is not None:
            key, states[key] = read.taken
        return read.left

    try:
        whole = etree.fromstring(split.with_chunks(split.rest, taken_from), _parser(keeps_instructions=True))
    except (etree.XMLSyntaxError, ValueError, LookupError):
        return None
    name = moving_obstacle(whole)
    are_read = all(each.getparent() is whole and each.tag == name for each in whole.iter("dynamicObstacle", "obstacle"))
    return (whole, states) if are_read and not _is_too_deep(whole, limits) else None


def _small_content(path: Path) -> bytes:
    """The bytes of a small file; nothing of a large one, or of one that cannot be read, which a scan says."""
    try:
        return path.read_bytes() if path.stat().st_size <= _SMALL_BYTES else b""
    except OSError:
        return b""


@dataclass(frozen=True)
class _ReadObstacle:
    """The plain states of an obstacle with its id, None where it has none, and the element without them."""

    taken: tuple[int, PlainStates] | None
    left: bytes


_KEPT_OBSTACLES = 1_000
"""Obstacles that a worker knows by their bytes, some kB each (chosen): an edited scenario has most of its base's."""
LARGEST_KEPT_BYTES = 1_000_000
"""A larger obstacle is read anew each time (chosen): what is kept of it may be as large."""


def _read_obstacle(chunk: bytes) -> _ReadObstacle:
    """Raises what lxml raises where the bytes are no element."""
    known = _known_obstacle(hashlib.sha256(chunk).digest()) if len(chunk) <= LARGEST_KEPT_BYTES else []
    if not known:
        known.append(_cut_obstacle(chunk) or _parsed_obstacle(chunk))
    return known[0]


def _cut_obstacle(chunk: bytes) -> _ReadObstacle | None:
    cut = cut_states(chunk)
    return None if cut is None else _ReadObstacle(cut[:2], cut[2])


def _parsed_obstacle(chunk: bytes) -> _ReadObstacle:
    obstacle = etree.fromstring(chunk, _parser())
    taken = take_states(obstacle)
    return _ReadObstacle(taken, chunk if taken is None else etree.tostring(obstacle))


def forget_obstacles() -> None:
    """Read all obstacles anew from now on, as a worker does that has just started."""
    _known_obstacle.cache_clear()


@lru_cache(maxsize=_KEPT_OBSTACLES)
def _known_obstacle(digest: bytes) -> list[_ReadObstacle]:
    """What was read of bytes with a digest: nothing yet, or one."""
    del digest
    return []


def _check(path: Path, root: Element, limits: XmlLimits | None, taken: Collection[int] = ()) -> None:
    """Refuse what is beyond the limits; its line is looked for in the whole document, of which states may be taken."""
    try:
        check_document(root, taken)
        check_complete(root)
    except BeyondLimits as error:
        _refuse_with_line(path, parse_document(path, limits))
        raise error.refusal(path.name, None) from None
    _refuse_duplicate_ids(path, root)


def _refuse_with_line(path: Path, whole: "etree._Element") -> None:
    try:
        check_document(whole)
        check_complete(whole)
    except BeyondLimits as error:
        number = next(number for number, element in enumerate(whole.iter()) if element is error.element)
        raise error.refusal(path.name, _line_of(path, number)) from None


def refuse_another_root(path: Path, root_name: str) -> None:
    """Refuse an XML file that is no CommonRoad file.

    Raises:
        UnsafeInput: naming its root element.
    """
    if root_name != "commonRoad":
        raise UnsafeInput(
            f"{shown_name(path.name)} is no CommonRoad file: its root element is {cited(root_name)}, not 'commonRoad'"
        )


def _line_of(path: Path, number: int) -> int | None:
    """The line on which an element begins, by its number in the order of the file; ElementTree does not keep it."""
    lines: list[int] = []
    parser = expat.ParserCreate()

    def start(*_: Any) -> None:
        if len(lines) <= number:
            lines.append(parser.CurrentLineNumber)

    parser.StartElementHandler = start
    with path.open("rb") as stream:
        while len(lines) <= number and (block := stream.read(_BLOCK_BYTES)):
            parser.Parse(block, False)
    return lines[number] if number < len(lines) else None


def _refuse_duplicate_ids(path: Path, root: Element) -> None:
    """commonroad-io keeps one of two lanelets with one id; a planning problem may share its id with another element."""
    seen: set[tuple[bool, str]] = set()
    for element in root:
        key = element.tag == "planningProblem", element.get("id", "")
        if key[1] and key in seen:
            raise UnsafeInput(
                f"{shown_name(path.name)} has two elements with the id {key[1]}, the second is {cited(element.tag)}",
                next_step="give one of them another id",
            )
        seen.add(key)


def _open(
    path: Path, root: Element, states: Mapping[int, PlainStates], ego_classes: Mapping[int, str], friction: float | None
) -> LoadedScenario:
    try:
        with _silence_commonroad_warnings():
            scenario, problems = _ParsedReader(path, root).open()
    except Exception as error:
        reason = _against_schema(path) or f"{type(error).__name__}: {cited(error)}"
        raise UnsafeInput(f"{shown_name(path.name)} is not readable as CommonRoad: {reason}") from error
    return LoadedScenario(scenario, problems, path, root.get("benchmarkID", ""), states, ego_classes, friction)


def _against_schema(path: Path) -> str:
    """Return the first element of a file that breaks CommonRoad's schema (2020a), with its line; empty if none does."""
    root = parse_document(path)
    if is_2018b(root):
        return ""
    faults = [fault for fault in schema_faults(etree.ElementTree(root)) if fault.element_name != "commonRoad"]
    return f"line {faults[0].line:,}, {faults[0].message}" if faults else ""


@contextmanager
def _silence_commonroad_warnings() -> Iterator[None]:
    """Drop commonroad-io's warnings: on standard error they do not say which file they are about.

    They are about what the rules for networks name too (``network/rules``), or about countries whose signs it does not
    know.
    """
    log = logging.getLogger("commonroad.common.reader.file_reader_xml")
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        log.setLevel(level)


class _ParsedReader(XMLFileReader):  # type: ignore[misc]  # commonroad-io has no types
    """commonroad-io's reader on a document that is parsed already."""

    def __init__(self, path: Path, root: Element) -> None:
        super().__init__(path)
        self._root = root

    def _parse_file(self) -> None:
        self._tree = ElementTree(self._root)

    def _open_scenario(self, lanelet_assignment: bool) -> "Scenario":
        if lanelet_assignment or self._commonroad_version == "2018b":
            return super()._open_scenario(lanelet_assignment)
        return scenario_of(self._tree, self._dt, self._benchmark_id, self._commonroad_version, self._meta_data)


_SMALL_BYTES = 40_000_000
"""Chosen: a file up to this size is read whole before it is known to be harmless."""
_FEW_TAGS = 800_000
"""Tags of which the elements take less than 200 MB (0.24 kB each): as many are parsed before their depth is known."""


def parse_document(path: Path, limits: XmlLimits | None = None) -> "etree._Element":
    """The root element of an XML file that is not too large, too deep or broken, and declares no document type.

    In UTF-8 a tag begins with the byte ``<`` and a document type with ``<!DOCTYPE``: where counting bytes shows that a
    file is within the limits, only its depth is left to look at once it is parsed. Any other file is scanned before.

    Raises:
        UnsafeInput: naming what was found and the limit.
    """
    return _parsed_document(path, _small_content(path), limits or XmlLimits())


def _parsed_document(
    path: Path, content: bytes, limits: XmlLimits, *, keeps_instructions: bool = False
) -> "etree._Element":
    """As ``parse_document``, for a file whose bytes are read already where it is small."""
    try:
        if not _is_surely_within(content, limits, _FEW_TAGS):
            scan_xml(path, limits)
            content = path.read_bytes()
        root = etree.fromstring(content, _parser(keeps_instructions=keeps_instructions))
    except OSError as error:
        raise UnsafeInput(f"{shown_name(path.name)} cannot be read: {error.strerror}") from error
    except (etree.XMLSyntaxError, ValueError, LookupError) as error:
        scan_xml(path, limits)  # which names a limit that libxml2 has too, such as the depth
        raise UnsafeInput(f"{shown_name(path.name)} is not well-formed XML: {cited(error)}") from error
    if _is_too_deep(root, limits):
        raise UnsafeInput(f"{shown_name(path.name)} nests elements deeper than {limits.depth} levels")
    return root


def _is_too_deep(root: "etree._Element", limits: XmlLimits) -> bool:
    return bool(root.xpath(f"boolean({'/*' * (limits.depth + 1)})"))


def _is_surely_within(content: bytes, limits: XmlLimits, most_tags: int) -> bool:
    return (
        is_declared_utf8(content)
        and b"<!DOCTYPE" not in content
        and content.count(b"<") <= min(most_tags, limits.elements)
        and content.count(b"<lanelet") <= limits.lanelets
        and len(content) <= limits.size_bytes
    )


def _parser(*, keeps_instructions: bool = False) -> etree.XMLParser:
    """Return a parser for elements and their texts, and for processing instructions if requested.

    Size was looked at, and a document type is refused.
    """
    return etree.XMLParser(
        resolve_entities=False, no_network=True, huge_tree=True, remove_comments=True, remove_pis=not keeps_instructions
    )


_BLOCK_BYTES = 1 << 18
"""Chosen: bytes of a file that the scan holds at a time (256 KiB)."""


@dataclass(frozen=True)
class _XmlRoot:
    """Name and attributes of a document's root element, and how many elements ``lanelet`` the document has."""

    name: str
    attributes: dict[str, str]
    lanelets: int


def scan_xml(path: Path, limits: XmlLimits | None = None) -> _XmlRoot:
    """Refuse an XML file that is too large, too deep, broken or that declares a document type.

    Returns:
        The name and the attributes of its root element, and the number of its lanelets.

    Raises:
        UnsafeInput: naming what was found and the limit.
    """
    limits = limits or XmlLimits()
    try:
        size = path.stat().st_size
    except OSError as error:
        raise UnsafeInput(f"{shown_name(path.name)} cannot be read: {error.strerror}") from error
    if size > limits.size_bytes:
        raise UnsafeInput(
            f"{shown_name(path.name)} has {size:,} bytes; at most {limits.size_bytes:,} are read",
            next_step="split the file, or raise the setting file_mb",
        )
    scan = _Scan(path.name, limits)
    try:
        with path.open("rb") as stream:
            while block := stream.read(_BLOCK_BYTES):
                scan.feed(block)
            scan.parser.Parse(b"", True)
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise UnsafeInput(f"{shown_name(path.name)} is not well-formed XML: {cited(error)}") from error
    return _XmlRoot(scan.root, scan.attributes, scan.lanelets)


_SPLIT = "split the file, or take parts of it out"
"""What helps against a file of too many elements."""


class _Scan:
    """Counts depth and elements while expat reads; a limit passed or a document type ends it."""

    def __init__(self, name: str, limits: XmlLimits) -> None:
        self.name, self.limits, self.root = name, limits, ""
        self.attributes: dict[str, str] = {}
        self.depth = self.elements = self.lanelets = self.fed_bytes = 0
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.StartDoctypeDeclHandler = self._doctype

    def feed(self, block: bytes) -> None:
        """Parse the next bytes; a tag that does not end is refused, since expat reads it anew with every block."""
        self.parser.Parse(block, False)
        self.fed_bytes += len(block)
        if self.fed_bytes - self.parser.CurrentByteIndex > self.limits.tag_bytes + _BLOCK_BYTES:
            raise UnsafeInput(
                f"{shown_name(self.name)} holds a tag or comment of more than {self.limits.tag_bytes:,} bytes"
            )

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        if not self.root:
            self.root, self.attributes = tag, attributes
        self.depth += 1
        self.elements += 1
        self.lanelets += tag == "lanelet"
        if self.depth > self.limits.depth:
            raise UnsafeInput(f"{shown_name(self.name)} nests elements deeper than {self.limits.depth} levels")
        if self.elements > self.limits.elements:
            raise UnsafeInput(
                f"{shown_name(self.name)} holds more than {self.limits.elements:,} elements", next_step=_SPLIT
            )
        if self.lanelets > self.limits.lanelets:
            raise UnsafeInput(
                f"{shown_name(self.name)} holds more than {self.limits.lanelets:,} lanelets", next_step=_SPLIT
            )

    def _end(self, tag: str) -> None:
        del tag
        self.depth -= 1

    def _doctype(self, *declaration: Any) -> None:
        del declaration
        raise UnsafeInput(
            f"{shown_name(self.name)} declares a document type; entities are not read", next_step="remove <!DOCTYPE"
        )
