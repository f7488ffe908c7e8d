"""A CommonRoad file as an XML tree, of which only what an edit touches is replaced.

commonroad-io's writer rounds every state of every obstacle (half of the files change); here untouched elements are
copied. Formats: CommonRoad XML 2018b (``<obstacle>`` with ``<role>``) and 2020a (``<dynamicObstacle>``).
"""

from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import cast

from lxml import etree

from ...schemas.errors import ResourceFailure

_AFTER_OBSTACLES = ("phantomObstacle", "environmentObstacle", "planningProblem")


@dataclass(frozen=True)
class ScenarioDocument:
    """The tree of a scenario file; the methods change it."""

    tree: "etree._ElementTree"

    @classmethod
    def read(cls, path: Path) -> "ScenarioDocument":
        """Parse a file that was scanned before; entities are not resolved."""
        return cls(etree.parse(path, etree.XMLParser(resolve_entities=False, no_network=True, remove_blank_text=False)))

    @property
    def root(self) -> "etree._Element":
        """The ``<commonRoad>`` element."""
        return self.tree.getroot()

    @property
    def is_2018b(self) -> bool:
        """Whether obstacles carry their role in an element."""
        return self.root.get("commonRoadVersion") == "2018b"

    @property
    def highest_id(self) -> int:
        """The highest id of anything in the file."""
        ids = cast("list[str]", self.tree.xpath("//@id"))
        return max((int(text) for text in ids if text.isdigit()), default=0)

    def obstacle(self, obstacle_id: int) -> "etree._Element":
        """The element of an obstacle of any kind.

        Raises:
            ResourceFailure: the file holds no such element, though the reader found one.
        """
        for element in self.root:
            is_obstacle = isinstance(element.tag, str) and element.tag.lower().endswith("obstacle")
            if is_obstacle and element.get("id") == str(obstacle_id):
                return element
        raise ResourceFailure(f"the file holds no obstacle element {obstacle_id}")

    def problem(self, problem_id: int) -> "etree._Element":
        """The element of a planning problem.

        Raises:
            ResourceFailure: there is none.
        """
        found = [element for element in self.root.iter("planningProblem") if element.get("id") == str(problem_id)]
        if not found:
            raise ResourceFailure(f"the file holds no planning problem {problem_id}")
        return found[0]

    def remove(self, element: "etree._Element") -> None:
        """Take an element of the first level out, with the white space that follows it."""
        self.root.remove(element)

    def add_obstacle(self, element: "etree._Element") -> None:
        """Put an obstacle after the last dynamic one, or where the format wants the first."""
        existing = [one for one in self.root if one.tag in ("dynamicObstacle", "obstacle")]
        following = [one for one in self.root if one.tag in _AFTER_OBSTACLES]
        indent(element, self._indent_unit(), 1)
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
        """Put new children where old ones were, indented like them; ``old`` is not empty."""
        place, tail = parent.index(old[0]), old[-1].tail
        level = len(list(old[0].iterancestors()))
        for element in old:
            parent.remove(element)
        for offset, element in enumerate(new):
            indent(element, self._indent_unit(), level)
            element.tail = "\n" + self._indent_unit() * level
            parent.insert(place + offset, element)
        if new:
            new[-1].tail = tail

    def write(self, path: Path, benchmark_id: str) -> None:
        """Write the tree under a new benchmark id; UTF-8 with a declaration."""
        self.root.set("benchmarkID", benchmark_id)
        self.tree.write(path, xml_declaration=True, encoding="UTF-8")

    def copy(self) -> "ScenarioDocument":
        """A tree of its own."""
        return ScenarioDocument(deepcopy(self.tree))

    def _indent_unit(self) -> str:
        """The white space of one level, as in the file."""
        text = (self.root.text or "").rpartition("\n")[2]
        return text if text.strip() == "" else ""


def indent(element: "etree._Element", unit: str, level: int) -> None:
    """Lay an element and its descendants out with line breaks."""
    etree.indent(element, space=unit or " ", level=level)
