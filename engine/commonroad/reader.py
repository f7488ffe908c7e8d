"""Reads CommonRoad XML files (2018b and 2020a), and scans any XML, as untrusted input.

commonroad-io reads with ElementTree, which accepts 200,000 nesting levels and expands the entities that a file
declares. A file therefore passes three gates before any computation:

1. Its bytes are within ``XmlLimits`` and declare no document type: checked by a scan with expat that stores nothing, or
   by counting bytes if that is enough (``parse_document``).
2. Every number, count and text in the parsed document is within the limits of scenarios (``value_limits``).
3. commonroad-io reads that document. All its errors become one ``UnsafeInput``.

The states of plain trajectories, most of a file, are first read into arrays (``plain_states``); commonroad-io reads the
rest. ``read_recorded`` returns them as tracks, ``read_scenario`` as commonroad-io's objects.
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
    prescribed_ids,
    schema_faults,
    script_texts,
)
from .lanelet_networks import scenario_of
from .made_once import MadeOnce
from .plain_states import PlainStates, cut_states, put_states, remove_plain_states, remove_states
from .recordings import FOLDER_VARIABLE, Recording, RecordingStore
from .tracks import Track, recorded_tracks
from .value_limits import MOST_OF_A_KIND, BeyondLimits, check_document

if TYPE_CHECKING:
    from commonroad.planning.planning_problem import PlanningProblem, PlanningProblemSet
    from commonroad.scenario.lanelet import Lanelet
    from commonroad.scenario.scenario import Scenario


@dataclass(frozen=True)
class XmlLimits:
    """Limits for an XML file before any library parses it.

    Chosen well above real files and below harmful files: the largest of about 200 measured CommonRoad scenarios is 1.4
    MB in size, with 8 levels, 46,000 elements and 370 lanelets.

    ``size_bytes``: bytes of the file. ``depth``: levels of elements, which parsers follow by recursion. ``elements``:
    each takes about 250 bytes in memory, so together they take less than 400 MB. ``tag_bytes``: one tag or comment;
    expat reads it again with every block until it ends, so the time is quadratic. ``lanelets``: commonroad-io creates a
    polygon for each.
    """

    size_bytes: int = 100_000_000
    depth: int = 64
    elements: int = 1_500_000
    tag_bytes: int = 1_000_000
    lanelets: int = MOST_OF_A_KIND["lanelet"]


@dataclass(frozen=True)
class EditedMotions:
    """What edits in memory prescribe: ids of road users with a prescribed motion, and scripts as JSON text."""

    prescribed: frozenset[int]
    scripts: tuple[str, ...]


@dataclass(frozen=True)
class LoadedScenario:
    """A CommonRoad scenario in memory, with its planning problems and its source file.

    ``plain_states``: by obstacle id, the states after the initial one that were read as arrays: points and exact
    headings. ``ego_classes``: the ego's class by planning problem; cars are left out. ``friction``: the friction
    coefficient of the roads, or None if the file has none. ``edited``: what edits in memory prescribe; None if the
    scenario is as in its file, which then contains these. ``made``: what runs derive from roads and planning problems,
    shared by scenarios with the same roads.
    """

    scenario: "Scenario"
    planning_problems: "PlanningProblemSet"
    path: Path
    declared_id: str = ""
    plain_states: Mapping[int, PlainStates] = field(default_factory=dict)
    ego_classes: Mapping[int, str] = field(default_factory=dict)
    friction: float | None = None
    edited: EditedMotions | None = None
    made: MadeOnce = field(default_factory=MadeOnce, repr=False, compare=False)

    @property
    def prescribed_ids(self) -> frozenset[int]:
        """The ids of road users with a motion that an edit prescribes."""
        return prescribed_ids(self.path) if self.edited is None else self.edited.prescribed

    @property
    def script_texts(self) -> tuple[str, ...]:
        """The scripts of motions that depend on the ego, each as JSON text."""
        return script_texts(self.path) if self.edited is None else self.edited.scripts

    def ego_class(self, problem_id: int) -> str:
        """Return the class of a planning problem's ego, or a car if the file does not state it."""
        return self.ego_classes.get(problem_id, "car")

    @cached_property
    def tracks(self) -> dict[int, Track]:
        """The recording, as ``recorded_tracks`` returns it."""
        return recorded_tracks(self.scenario, self.plain_states)

    @property
    def footways(self) -> "tuple[Lanelet, ...]":
        """The lanelets, outside the network, that are open only to pedestrians, in both directions."""
        return tuple(getattr(self.scenario, "footways", ()))  # format 2018b has none

    @property
    def benchmark_id(self) -> str:
        """The benchmark id as in the file, without blanks; commonroad-io also changes other unusual ids."""
        return without_blanks(self.declared_id) or str(self.scenario.scenario_id)

    @property
    def step_s(self) -> float:
        """The duration of one time step in seconds."""
        return float(self.scenario.dt)

    def problem(self, problem_id: int | None = None) -> "PlanningProblem":
        """Return the planning problem with this id or, by default, with the lowest id.

        Raises:
            UnknownName: the file has no planning problem with this id, or no problem at all.
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
    """A scenario with its recording; obstacles in ``loaded`` keep only their first and last states.

    A scenario equals only itself, so derived data can be cached with it.
    """

    loaded: LoadedScenario

    @property
    def tracks(self) -> dict[int, Track]:
        """The recording, as ``recorded_tracks`` returns it."""
        return self.loaded.tracks


def read_scenario(path: Path, limits: XmlLimits | None = None) -> LoadedScenario:
    """Check and read a CommonRoad file.

    Raises:
        UnsafeInput: the file is hostile, broken, not a CommonRoad file, has no lanelets or a duplicate id, or a number
            is beyond its limits.
    """
    loaded = _open(path, *_road_document(path, limits))
    states = loaded.plain_states
    put_states(loaded.scenario, states)
    return loaded


def read_recorded(path: Path, limits: XmlLimits | None = None) -> RecordedScenario:
    """Read a CommonRoad file as ``read_scenario`` does, but with the recording as arrays, not objects.

    Raises:
        UnsafeInput: the file is hostile, broken, not a CommonRoad file, has no lanelets or a duplicate id, or a number
            is beyond its limits.
    """
    recorded = RecordedScenario(_open(path, *_road_document(path, limits)))
    _ = recorded.tracks  # this raises an error for a state without a position
    return recorded


_KEPT = 4
"""Scenarios that a worker keeps, some MB each (chosen): one is edited, run and drawn again and again."""


def kept_recording(path: Path, size_bytes: int | None = None, *, keep: bool = True) -> RecordedScenario:
    """Read a CommonRoad file like ``read_recorded``; return the same object while its content is the same.

    A file that a worker wrote and read back as a check is not parsed again after it has been stored. Workers share
    results on disk (``recordings``). Cached scenarios must not be changed.

    Args:
        path: the file.
        size_bytes: its maximum size; None means that of ``XmlLimits``.
        keep: whether to cache it on disk too, which is not worthwhile for a file that is read only once.

    Raises:
        UnsafeInput: as ``read_recorded``.
    """
    limits = XmlLimits() if size_bytes is None else XmlLimits(size_bytes=size_bytes)
    try:
        content = path.read_bytes() if path.stat().st_size <= limits.size_bytes else b""
    except OSError:
        content = b""
    if not content:
        return read_recorded(path, limits)  # this reports what is wrong with the file
    return _kept(path, _Content(hashlib.sha256(content).hexdigest(), path, limits, keep))


@dataclass(frozen=True)
class _Content:
    """The content of a file, equal for equal digests; ``path``, ``limits`` and ``keep`` state how it is first read."""

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
    """Return the process's store of recordings on disk, or None."""
    folder = os.environ.get(FOLDER_VARIABLE)
    return RecordingStore(Path(folder)) if folder else None


_RoadDocument = tuple[Element, dict[int, PlainStates], dict[int, str], float | None]
"""A checked document, the states removed from it, the classes of its egos, and the friction of its roads."""


def _road_document(path: Path, limits: XmlLimits | None) -> _RoadDocument:
    """Read and check a document, and remove the parts that are read separately.

    commonroad-io fails on a scenario without lanelets, and its error does not state the reason.
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
    states = remove_plain_states(whole) if states is None else states
    root = fromstring(etree.tostring(whole))  # noqa: S314 - serialised by this process
    _check(path, root, limits, states)
    complete(root)
    return root, states, ego_classes, friction


def _known_ego_classes(path: Path, found: dict[int, str]) -> dict[int, str]:
    """Return the classes of a file's egos after checking that each of them exists."""
    for word in found.values():
        if word not in EGO_CLASSES:
            raise UnsafeInput(
                f"{shown_name(path.name)} states that its ego is a {cited(word)}, which is not supported",
                valid=EGO_CLASSES,
                next_step="use one of these in the file's <?plannerforge ego-class=…?>, or remove it for a car",
            )
    return found


def _possible_friction(path: Path, text: str | None) -> float | None:
    """Return the friction in a file after checking that it is possible for a road."""
    try:
        friction = None if text is None else float(text)
    except ValueError:
        friction = math.nan
    if friction is not None and not LEAST_FRICTION <= friction <= MOST_FRICTION:
        raise UnsafeInput(
            f"{shown_name(path.name)} states a friction of {cited(text or '')}, which is impossible for a road",
            valid=[f"{LEAST_FRICTION:g} to {MOST_FRICTION:g}"],
            next_step="correct the file's <?plannerforge friction=…?>, or remove it",
        )
    return friction


def _split_document(content: bytes, limits: XmlLimits) -> "tuple[etree._Element, dict[int, PlainStates]] | None":
    """Return the document without the states of plain trajectories, and those states separately.

    Known obstacles are not parsed again. The result is None if the whole file must be examined, which also shows what
    is wrong with it.
    """
    split = SplitDocument.of(content) if _is_surely_within(content, limits, limits.elements) else None
    if split is None or not split.chunks:
        return None
    states: dict[int, PlainStates] = {}

    def remove_states(chunk: bytes) -> bytes:
        read = _read_obstacle(chunk)
        if read.taken is not None:
            key, states[key] = read.taken
        return read.left

    try:
        whole = etree.fromstring(split.with_chunks(split.rest, remove_states), _parser(keeps_instructions=True))
    except (etree.XMLSyntaxError, ValueError, LookupError):
        return None
    name = moving_obstacle(whole)
    are_read = all(each.getparent() is whole and each.tag == name for each in whole.iter("dynamicObstacle", "obstacle"))
    return (whole, states) if are_read and not _is_too_deep(whole, limits) else None


def _small_content(path: Path) -> bytes:
    """Return the bytes of a small file; empty for a large file, or for an unreadable one, which a scan reports."""
    try:
        return path.read_bytes() if path.stat().st_size <= _SMALL_BYTES else b""
    except OSError:
        return b""


@dataclass(frozen=True)
class _ReadObstacle:
    """The plain states of an obstacle with its id, or None, and the element without them."""

    taken: tuple[int, PlainStates] | None
    left: bytes


_KEPT_OBSTACLES = 1_000
"""Obstacles that a worker caches by their bytes, some kB each (chosen): edited scenarios share most with their base."""
LARGEST_KEPT_BYTES = 1_000_000
"""A larger obstacle is read again each time (chosen): its cached data could be as large."""


def _read_obstacle(chunk: bytes) -> _ReadObstacle:
    """Read an obstacle; raise lxml's error if the bytes are not an element."""
    known = _known_obstacle(hashlib.sha256(chunk).digest()) if len(chunk) <= LARGEST_KEPT_BYTES else []
    if not known:
        known.append(_cut_obstacle(chunk) or _parsed_obstacle(chunk))
    return known[0]


def _cut_obstacle(chunk: bytes) -> _ReadObstacle | None:
    cut = cut_states(chunk)
    return None if cut is None else _ReadObstacle(cut[:2], cut[2])


def _parsed_obstacle(chunk: bytes) -> _ReadObstacle:
    obstacle = etree.fromstring(chunk, _parser())
    taken = remove_states(obstacle)
    return _ReadObstacle(taken, chunk if taken is None else etree.tostring(obstacle))


def forget_obstacles() -> None:
    """Clear the cache, so that all obstacles are read again, as in a new worker."""
    _known_obstacle.cache_clear()


@lru_cache(maxsize=_KEPT_OBSTACLES)
def _known_obstacle(digest: bytes) -> list[_ReadObstacle]:
    """Return the cache entry of bytes with a digest: an empty list, or one result."""
    del digest
    return []


def _check(path: Path, root: Element, limits: XmlLimits | None, taken: Collection[int] = ()) -> None:
    """Raise an error for values beyond the limits.

    The error states the line in the complete document, since states may have been removed from ``root``.
    """
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
    """Raise an error for an XML file that is not a CommonRoad file.

    Raises:
        UnsafeInput: the error gives its root element.
    """
    if root_name != "commonRoad":
        raise UnsafeInput(
            f"{shown_name(path.name)} is not CommonRoad: its root element is {cited(root_name)}, not 'commonRoad'"
        )


def _line_of(path: Path, number: int) -> int | None:
    """Return the line on which an element begins, by its number in file order; ElementTree does not store it."""
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
    """Raise an error for duplicate ids, because commonroad-io drops one of two lanelets.

    A planning problem may have the id of another element.
    """
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
    """Return the file's first violation of CommonRoad's schema (2020a) with its line, as text; may be empty."""
    root = parse_document(path)
    if is_2018b(root):
        return ""
    faults = [fault for fault in schema_faults(etree.ElementTree(root)) if fault.element_name != "commonRoad"]
    return f"line {faults[0].line:,}, {faults[0].message}" if faults else ""


@contextmanager
def _silence_commonroad_warnings() -> Iterator[None]:
    """Suppress commonroad-io's warnings on standard error, because they do not name the file.

    They concern faults that the rules for networks (``network/rules``) also report, or countries for which
    commonroad-io does not know the signs.
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
    """commonroad-io's reader for a document that is already parsed."""

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
"""Number of tags with elements of less than 200 MB (0.24 kB each): so many are parsed before the depth is checked."""


def parse_document(path: Path, limits: XmlLimits | None = None) -> "etree._Element":
    """Return the root element of an XML file that is not too large, too deep or broken, and has no document type.

    In UTF-8, a tag begins with the byte ``<`` and a document type with ``<!DOCTYPE``. If counting bytes shows that a
    file is within the limits, only its depth must be checked after parsing. Any other file is scanned first.

    Raises:
        UnsafeInput: the error gives the value found and the limit.
    """
    return _parsed_document(path, _small_content(path), limits or XmlLimits())


def _parsed_document(
    path: Path, content: bytes, limits: XmlLimits, *, keeps_instructions: bool = False
) -> "etree._Element":
    """Parse a document as ``parse_document`` does; ``content`` contains the whole file if it is small."""
    try:
        if not _is_surely_within(content, limits, _FEW_TAGS):
            scan_xml(path, limits)
            content = path.read_bytes()
        root = etree.fromstring(content, _parser(keeps_instructions=keeps_instructions))
    except OSError as error:
        raise UnsafeInput(f"{shown_name(path.name)} cannot be read: {error.strerror}") from error
    except (etree.XMLSyntaxError, ValueError, LookupError) as error:
        scan_xml(path, limits)  # this reports a limit that libxml2 shares, such as the depth
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

    The caller has checked the size and rejected document types.
    """
    return etree.XMLParser(
        resolve_entities=False, no_network=True, huge_tree=True, remove_comments=True, remove_pis=not keeps_instructions
    )


_BLOCK_BYTES = 1 << 18
"""Chosen: bytes of a file in memory during the scan (256 KiB)."""


@dataclass(frozen=True)
class _XmlRoot:
    """Name and attributes of a document's root element, and the number of ``lanelet`` elements in the document."""

    name: str
    attributes: dict[str, str]
    lanelets: int


def scan_xml(path: Path, limits: XmlLimits | None = None) -> _XmlRoot:
    """Reject an XML file that is too large, too deep, broken or that declares a document type.

    Returns:
        The name and the attributes of its root element, and the number of its lanelets.

    Raises:
        UnsafeInput: the error gives the value found and the limit.
    """
    limits = limits or XmlLimits()
    try:
        size = path.stat().st_size
    except OSError as error:
        raise UnsafeInput(f"{shown_name(path.name)} cannot be read: {error.strerror}") from error
    if size > limits.size_bytes:
        raise UnsafeInput(
            f"{shown_name(path.name)} has {size:,} bytes; the limit is {limits.size_bytes:,}",
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


_SPLIT = "split the file, or remove parts of it"
"""The remedy for a file with too many elements."""


class _Scan:
    """A scan that counts depth and elements while expat reads, and stops at a limit or a document type."""

    def __init__(self, name: str, limits: XmlLimits) -> None:
        self.name, self.limits, self.root = name, limits, ""
        self.attributes: dict[str, str] = {}
        self.depth = self.elements = self.lanelets = self.fed_bytes = 0
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.StartDoctypeDeclHandler = self._doctype

    def feed(self, block: bytes) -> None:
        """Parse the next bytes; reject a tag that does not end, because expat reads it again with every block."""
        self.parser.Parse(block, False)
        self.fed_bytes += len(block)
        if self.fed_bytes - self.parser.CurrentByteIndex > self.limits.tag_bytes + _BLOCK_BYTES:
            raise UnsafeInput(
                f"{shown_name(self.name)} has a tag or comment of more than {self.limits.tag_bytes:,} bytes"
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
                f"{shown_name(self.name)} has more than {self.limits.elements:,} elements", next_step=_SPLIT
            )
        if self.lanelets > self.limits.lanelets:
            raise UnsafeInput(
                f"{shown_name(self.name)} has more than {self.limits.lanelets:,} lanelets", next_step=_SPLIT
            )

    def _end(self, tag: str) -> None:
        del tag
        self.depth -= 1

    def _doctype(self, *declaration: Any) -> None:
        del declaration
        raise UnsafeInput(
            f"{shown_name(self.name)} declares a document type; entities are not read", next_step="remove <!DOCTYPE"
        )
