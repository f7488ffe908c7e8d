"""Twice as much scenario is twice as much work: calls are counted, not seconds."""

import copy
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType

import pytest
from lxml import etree
from support.builders import town_road

from plannerforge.engine.commonroad import read_scenario
from plannerforge.engine.execution.executor import silent
from plannerforge.engine.network.rules.check import check_file
from plannerforge.engine.scenarios.description import describe
from plannerforge.engine.scenarios.facts import read_facts
from plannerforge.engine.scene import Scene
from plannerforge.schemas.scenarios import DescribeRequest, ReadFactsRequest

APART_M = 2000.0
MORE_THAN_DOUBLE = 2.2
KEPT_ONCE = ("location", "scenarioTags", "planningProblem")


def town(copies: int, path: Path) -> Path:
    """The town several times side by side, with one ego."""
    root = etree.fromstring(town_road().cut(6).xml().encode())
    once = [element for element in root if element.tag not in KEPT_ONCE]
    last = next(element for element in root if element.tag == "planningProblem")
    for number in range(1, copies):
        for element in copy.deepcopy(once):
            for part in element.iter():
                for name in ("id", "ref"):
                    if part.get(name):
                        part.set(name, str(int(part.get(name)) + 1000 * number))
                if part.tag == "x" and part.getparent().getparent().tag != "shape":
                    part.text = str(float(part.text) + APART_M * number)
            last.addprevious(element)
    etree.ElementTree(root).write(path, xml_declaration=True, encoding="UTF-8")
    return path


def calls(work: Callable[[Path], object], path: Path) -> int:
    count = 0

    def note(frame: FrameType, event: str, argument: object) -> None:
        nonlocal count
        count += event in ("call", "c_call")

    sys.setprofile(note)
    try:
        work(path)
    finally:
        sys.setprofile(None)
    return count


WORK: dict[str, Callable[[Path], object]] = {
    "facts": lambda path: read_facts(ReadFactsRequest(path=path), silent),
    "describe": lambda path: describe(DescribeRequest(path=path, detail="checks", focus=None, radius_m=80.0), silent),
    "check": check_file,
    "SUMO network": lambda path: Scene.of(read_scenario(path)).sumo_net,
}


@pytest.mark.parametrize("name", WORK)
def test_twice_the_scenario_is_twice_the_work(tmp_path: Path, name: str) -> None:
    WORK[name](town(1, tmp_path / "first.xml"))  # what is loaded once
    few, many = (calls(WORK[name], town(count, tmp_path / f"{count}.xml")) for count in (8, 16))
    assert many < MORE_THAN_DOUBLE * few, f"{many / few:.2f} times as many calls"
