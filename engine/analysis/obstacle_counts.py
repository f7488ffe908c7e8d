"""How many obstacles of which type a CommonRoad file holds, counted without building the scenario."""

from collections import Counter
from pathlib import Path
from xml.parsers import expat

from plannerforge.engine.scenarios.reader import scan_xml

_OBSTACLES = ("obstacle", "dynamicObstacle", "staticObstacle")


def count_obstacles(path: Path) -> dict[str, int]:
    """Obstacles by CommonRoad type, in alphabetical order; both the 2018b and the 2020a format.

    Raises:
        UnsafeInput: the file is hostile or broken.
    """
    scan_xml(path)
    counting = _Counting()
    with path.open("rb") as stream:
        counting.parser.ParseFile(stream)
    return dict(sorted(counting.found.items()))


class _Counting:
    """Follows the element path: the ``type`` directly inside an obstacle is its class."""

    def __init__(self) -> None:
        self.found: Counter[str] = Counter()
        self.open: list[str] = []
        self.text = ""
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._characters

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        del attributes
        self.open.append(tag)
        self.text = ""

    def _characters(self, text: str) -> None:
        self.text += text

    def _end(self, tag: str) -> None:
        self.open.pop()
        if tag == "type" and len(self.open) == 2 and self.open[-1] in _OBSTACLES:
            self.found[self.text.strip()] += 1
