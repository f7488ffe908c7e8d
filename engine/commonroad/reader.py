"""Reading CommonRoad XML files without trusting them.

ElementTree, with which commonroad-io reads, takes 200,000 nesting levels and expands entities that a file declares:
size, depth, element count and ``<!DOCTYPE`` are scanned before it sees the file.
"""

import logging
import math
import re
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree.ElementTree import Element, ElementTree, ParseError, fromstring
from xml.parsers import expat

import numpy as np
from commonroad.common.reader.file_reader_xml import XMLFileReader

from ...schemas.errors import UnknownName, UnsafeInput
from .tracks import Track, last_recorded_step, middle_of, recorded_tracks, take_plain_states

if TYPE_CHECKING:
    from commonroad.planning.planning_problem import PlanningProblem, PlanningProblemSet
    from commonroad.scenario.scenario import Scenario

# ---------- reader
# Reading CommonRoad XML files without trusting them.
#
# ElementTree, with which commonroad-io reads, takes 200,000 nesting levels and expands entities that a file declares:
# size, depth, element count and ``<!DOCTYPE`` are scanned before it sees the file.

_BLOCK_BYTES = 1 << 18


@dataclass(frozen=True)
class XmlLimits:
    """What an XML file may hold at most before any parser of a library sees it."""

    size_bytes: int = 100_000_000
    depth: int = 64
    elements: int = 1_500_000
    tag_bytes: int = 1_000_000
    lanelets: int = 50_000


@dataclass(frozen=True)
class LoadedScenario:
    """A CommonRoad scenario in memory, with its planning problems and the file it came from."""

    scenario: "Scenario"
    planning_problems: "PlanningProblemSet"
    path: Path
    declared_id: str = ""

    @property
    def benchmark_id(self) -> str:
        """The CommonRoad benchmark id as in the file; commonroad-io's own rendering changes unusual ones."""
        return self.declared_id or str(self.scenario.scenario_id)

    @property
    def step_s(self) -> float:
        """Duration of one time step in seconds."""
        return float(self.scenario.dt)

    def problem(self, problem_id: int | None = None) -> "PlanningProblem":
        """The planning problem with this id, or the first one.

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


@dataclass(frozen=True)
class _XmlRoot:
    """Name and attributes of a document's root element, and how many lanelets the document has."""

    name: str
    attributes: dict[str, str]
    lanelets: int


def scan_xml(path: Path, limits: XmlLimits | None = None) -> str:
    """Refuse an XML file that is too large, too deep, broken or that declares a document type.

    Returns:
        The name of the root element.

    Raises:
        UnsafeInput: naming what was found and the limit.
    """
    return scan_root(path, limits).name


def scan_root(path: Path, limits: XmlLimits | None = None) -> _XmlRoot:
    """As ``scan_xml``, with the attributes of the root element and the number of lanelets.

    Raises:
        UnsafeInput: naming what was found and the limit.
    """
    limits = limits or XmlLimits()
    try:
        size = path.stat().st_size
    except OSError as error:
        raise UnsafeInput(f"{path.name} cannot be read: {error.strerror}") from error
    if size > limits.size_bytes:
        raise UnsafeInput(f"{path.name} has {size:,} bytes; at most {limits.size_bytes:,} are read")
    scan = _Scan(path.name, limits)
    try:
        with path.open("rb") as stream:
            while block := stream.read(_BLOCK_BYTES):
                scan.feed(block)
            scan.parser.Parse(b"", True)
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise UnsafeInput(f"{path.name} is not well-formed XML: {error}") from error
    return _XmlRoot(scan.root, scan.attributes, scan.lanelets)


class _Scan:
    """Counts depth and elements while expat reads; a document type ends it."""

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
            raise UnsafeInput(f"{self.name} holds a tag or comment of more than {self.limits.tag_bytes:,} bytes")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        if not self.root:
            self.root, self.attributes = tag, attributes
        self.depth += 1
        self.elements += 1
        self.lanelets += tag == "lanelet"
        if self.depth > self.limits.depth:
            raise UnsafeInput(f"{self.name} nests elements deeper than {self.limits.depth} levels")
        if self.elements > self.limits.elements:
            raise UnsafeInput(f"{self.name} holds more than {self.limits.elements:,} elements")
        if self.lanelets > self.limits.lanelets:
            raise UnsafeInput(f"{self.name} holds more than {self.limits.lanelets:,} lanelets")

    def _end(self, tag: str) -> None:
        del tag
        self.depth -= 1

    def _doctype(self, *declaration: Any) -> None:
        del declaration
        raise UnsafeInput(f"{self.name} declares a document type; entities are not read", next_step="remove <!DOCTYPE")


@contextmanager
def _unsaid_remarks() -> Iterator[None]:
    """commonroad-io's warnings are left unsaid meanwhile: on standard error nobody sees which file they are about.

    They tell of what our own rules name (``rules/``), or of countries for which it knows no signs.
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


def _refuse_without_lanelets(file_name: str, lanelets: int) -> None:
    """commonroad-io fails on a scenario without a road, and says nothing of it.

    Raises:
        UnsafeInput: there are none.
    """
    if not lanelets:
        raise UnsafeInput(
            f"{file_name} has no lanelets, so there is no road to drive on",
            next_step="export the scenario again with its lanelet network, or choose another file",
        )


def read_scenario(path: Path, limits: XmlLimits | None = None) -> LoadedScenario:
    """Scan and read a CommonRoad file (2018b or 2020a).

    Raises:
        UnsafeInput: the file is hostile, broken, not a CommonRoad file, or has no lanelets.
    """
    from commonroad.common.file_reader import CommonRoadFileReader

    root = scan_root(path, limits)
    if root.name != "commonRoad":
        raise UnsafeInput(f"{path.name} is no CommonRoad file: its root element is <{root.name}>, not <commonRoad>")
    _refuse_without_lanelets(path.name, root.lanelets)
    try:
        with _unsaid_remarks():
            scenario, problems = CommonRoadFileReader(path).open()
    except Exception as error:
        raise UnsafeInput(f"{path.name} is not readable as CommonRoad: {type(error).__name__}: {error}") from error
    return LoadedScenario(scenario, problems, path, root.attributes.get("benchmarkID", ""))


# ---------- xml_document
# Parsing an XML file that nobody vouches for, once, and as fast as its size allows.

_SMALL_BYTES = 20_000_000
_FEW_TAGS = 400_000
"""So many tags do no harm before their depth is known: their elements take less than 100 MB."""
_IN_UTF8 = re.compile(rb"(\xef\xbb\xbf)?<\?xml version=[\"']1\.0[\"']( encoding=[\"'](?i:utf-8)[\"'])?[^>\w]*\?>")


def parse_document(path: Path, limits: XmlLimits | None = None) -> Element:
    """The root element of an XML file that is not too large, too deep or broken, and declares no document type.

    In UTF-8 a tag begins with the byte ``<`` and a document type with ``<!DOCTYPE``: where counting bytes shows that a
    file is within the limits, only its depth is left to look at once it is parsed. Any other file is scanned before.

    Raises:
        UnsafeInput: naming what was found and the limit.
    """
    limits = limits or XmlLimits()
    try:
        content = path.read_bytes() if path.stat().st_size <= _SMALL_BYTES else b""
        if not _is_surely_within(content, limits):
            scan_root(path, limits)
            content = path.read_bytes()
        root = fromstring(content)  # noqa: S314 - entities and size were looked at
    except OSError as error:
        raise UnsafeInput(f"{path.name} cannot be read: {error.strerror}") from error
    except (ParseError, ValueError, LookupError) as error:
        raise UnsafeInput(f"{path.name} is not well-formed XML: {error}") from error
    if _is_deeper(root, limits.depth):
        raise UnsafeInput(f"{path.name} nests elements deeper than {limits.depth} levels")
    return root


def _is_surely_within(content: bytes, limits: XmlLimits) -> bool:
    return (
        _IN_UTF8.match(content) is not None
        and b"<!DOCTYPE" not in content
        and content.count(b"<") <= min(_FEW_TAGS, limits.elements)
        and content.count(b"<lanelet") <= limits.lanelets
        and len(content) <= limits.size_bytes
    )


def _is_deeper(root: Element, levels: int) -> bool:
    level = [root]
    for _ in range(levels):
        level = list(chain.from_iterable(level))
        if not level:
            return False
    return True


# ---------- recorded_scenario
# Reading a CommonRoad file for its facts: the road and the problems by commonroad-io, the recording as arrays.


@dataclass(frozen=True)
class RecordedScenario:
    """A scenario with its recording; the obstacles of ``loaded`` keep the first and the last of their states only."""

    loaded: LoadedScenario
    tracks: dict[int, Track]


def read_recorded(path: Path, limits: XmlLimits | None = None) -> RecordedScenario:
    """Read a CommonRoad file (2018b or 2020a) as ``read_scenario`` does, in half of its time.

    Raises:
        UnsafeInput: the file is hostile, broken, not a CommonRoad file, or has no lanelets.
    """
    root = parse_document(path, limits)
    if root.tag != "commonRoad":
        raise UnsafeInput(f"{path.name} is no CommonRoad file: its root element is <{root.tag}>, not <commonRoad>")
    _refuse_without_lanelets(path.name, len(root.findall("lanelet")))
    _refuse_duplicate_ids(path.name, root)
    states = take_plain_states(root)
    try:
        with _unsaid_remarks():
            scenario, problems = _ParsedReader(path, root).open()
    except Exception as error:
        raise UnsafeInput(f"{path.name} is not readable as CommonRoad: {type(error).__name__}: {error}") from error
    loaded = LoadedScenario(scenario, problems, path, root.get("benchmarkID", ""))
    return RecordedScenario(loaded, recorded_tracks(scenario, states))


def _refuse_duplicate_ids(name: str, root: Element) -> None:
    """commonroad-io keeps one of two lanelets with one id; a planning problem may share its id with something else."""
    seen: set[tuple[bool, str]] = set()
    for element in root:
        key = element.tag == "planningProblem", element.get("id", "")
        if key[1] and key in seen:
            raise UnsafeInput(f"{name} has two elements with the id {key[1][:40]}, the second a {element.tag}")
        seen.add(key)


class _ParsedReader(XMLFileReader):  # type: ignore[misc]  # commonroad-io has no types
    """commonroad-io's reader on a document that is parsed already."""

    def __init__(self, path: Path, root: Element) -> None:
        super().__init__(path)
        self._root = root

    def _parse_file(self) -> None:
        self._tree = ElementTree(self._root)


BENCHMARK_ID = re.compile(r"[A-Z]{3}_[a-zA-Z0-9]+-[1-9]\d*_[1-9]\d*_[STPI](-[1-9]\d*)+")


def schema_errors(path: Path) -> list[str]:
    """What CommonRoad's own XML schema (2020a) and the naming of benchmarks find wrong with a file."""
    from lxml import etree

    return schema_errors_of(etree.parse(path))


def schema_errors_of(document: Any) -> list[str]:
    """The same for an lxml element tree."""
    import commonroad
    from lxml import etree

    folder = Path(str(commonroad.__file__)).parent / "scenario_definition" / "xml_definition_files"
    schema = etree.XMLSchema(etree.parse(folder / "XML_commonRoad_XSD.xsd"))
    schema.validate(document)
    log: Any = schema.error_log
    found = [str(error.message) for error in log]
    benchmark_id = document.getroot().get("benchmarkID", "")
    if BENCHMARK_ID.fullmatch(benchmark_id) is None:
        found.append(f"{benchmark_id!r} is no benchmark id of 2020a")
    return found


# ---------- wild_numbers
# Refusing numbers that no scenario has, before they fill the memory or bend the geometry of whoever uses them.

LONGEST_COORDINATE_M = 1e8
LARGEST_OBSTACLE_M = 1000.0
LONGEST_STEP_S = 10.0
LAST_STEP = 1_000_000
"""More than a day at 0.1 s; longer scenarios would fill the memory of whatever goes through their steps."""


def refuse_wild_numbers(read: RecordedScenario) -> None:
    """Look at step, coordinates, sizes, states and times of a scenario.

    Raises:
        UnsafeInput: one is not finite or far beyond what occurs, naming where it stands.
    """
    scenario, problems = read.loaded.scenario, read.loaded.planning_problems.planning_problem_dict
    if not 0.0 < read.loaded.step_s <= LONGEST_STEP_S:
        raise UnsafeInput(
            f"timeStepSize is {read.loaded.step_s:g} s", valid=[f"more than 0 and at most {LONGEST_STEP_S:g} s"]
        )
    for lanelet in scenario.lanelet_network.lanelets:
        if not _tame(lanelet.left_vertices) or not _tame(lanelet.right_vertices):
            raise UnsafeInput(f"lanelet {lanelet.lanelet_id} has coordinates that are not finite or beyond 1e8 m")
    for obstacle in scenario.obstacles:
        if not _sized(getattr(obstacle, "obstacle_shape", None)):  # phantom obstacles have none
            raise UnsafeInput(
                f"obstacle {obstacle.obstacle_id} has a size that is not above 0 and at most {LARGEST_OBSTACLE_M:g} m"
            )
    for obstacle in scenario.dynamic_obstacles:
        _refuse_unfinite(obstacle)
    for track in read.tracks.values():
        if not (_tame(track.positions) and _tame(track.headings_rad) and _tame(track.speeds_mps)):
            raise UnsafeInput(f"obstacle {track.obstacle_id} has states that are not finite or beyond 1e8")
        _refuse_late(f"obstacle {track.obstacle_id}", [track.first_step, track.last_step])
    _refuse_late("the recording", [last_recorded_step(scenario)])
    for key, problem in sorted(problems.items()):
        state = problem.initial_state
        values = np.array([*np.asarray(state.position, dtype=float), float(state.velocity), float(state.orientation)])
        if not _tame(values):
            raise UnsafeInput(f"planning problem {key} has an initial state that is not finite or beyond 1e8")
        _refuse_late(f"planning problem {key}", chain([int(state.time_step)], _goal_steps(problem)))


def _refuse_unfinite(obstacle: Any) -> None:
    """A value that is no number is not one that was left out: whatever is made of the file would keep it.

    Of plain trajectories, which are read apart, there are the first and the last state; the rest is finite.
    """
    trajectory = getattr(obstacle.prediction, "trajectory", None)
    for state in (obstacle.initial_state, *(trajectory.state_list if trajectory else ())):
        for name in state.used_attributes:
            value = getattr(state, name)
            if name != "position" and value is not None and not math.isfinite(middle_of(value)):
                raise UnsafeInput(
                    f"obstacle {obstacle.obstacle_id} has a {name} that is not finite at step {state.time_step}",
                    next_step=f"correct the {name} in the file, or leave it out of all states of the obstacle",
                )


def _goal_steps(problem: Any) -> Iterable[int]:
    steps = [goal.time_step for goal in problem.goal.state_list if getattr(goal, "time_step", None) is not None]
    return [int(end) for step in steps for end in (getattr(step, "start", step), getattr(step, "end", step))]


def _refuse_late(what: str, steps: Iterable[int]) -> None:
    for step in steps:
        if not 0 <= step <= LAST_STEP:
            raise UnsafeInput(f"{what} has the time step {step:,}", valid=[f"0 to {LAST_STEP:,}"])


def _sized(shape: Any) -> bool:
    """Whether length, width and radius, those that the shape has, can be those of a body."""
    sizes = [getattr(shape, name, None) for name in ("length", "width", "radius")]
    return all(0.0 < float(size) <= LARGEST_OBSTACLE_M for size in sizes if size is not None)


def _tame(values: Any) -> bool:
    array = np.asarray(values, dtype=float)
    return bool(np.all(np.isfinite(array)) and np.all(np.abs(array) < LONGEST_COORDINATE_M))
