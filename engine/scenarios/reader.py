"""Reading CommonRoad XML files without trusting them.

ElementTree, with which commonroad-io reads, takes 200,000 nesting levels and expands entities that a file declares:
size, depth, element count and ``<!DOCTYPE`` are scanned before it sees the file.
"""

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.parsers import expat

from plannerforge.schemas.errors import UnknownName, UnsafeInput

if TYPE_CHECKING:
    from commonroad.planning.planning_problem import PlanningProblem, PlanningProblemSet
    from commonroad.scenario.scenario import Scenario


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
class XmlRoot:
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


def scan_root(path: Path, limits: XmlLimits | None = None) -> XmlRoot:
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
    return XmlRoot(scan.root, scan.attributes, scan.lanelets)


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
def unsaid_remarks() -> Iterator[None]:
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


def refuse_without_lanelets(file_name: str, lanelets: int) -> None:
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
    refuse_without_lanelets(path.name, root.lanelets)
    try:
        with unsaid_remarks():
            scenario, problems = CommonRoadFileReader(path).open()
    except Exception as error:
        raise UnsafeInput(f"{path.name} is not readable as CommonRoad: {type(error).__name__}: {error}") from error
    return LoadedScenario(scenario, problems, path, root.attributes.get("benchmarkID", ""))
