"""Every rule catches its defect, and only where there is one."""

import math
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lxml import etree
from support.road_defects import COMPANIONS, DEFECTS
from support.roads import add_lanelet, good_road, write

from plannerforge.engine.network.rules.check import all_rules, check_file

NAMES = [rule.rule_id for rule in all_rules()]


def broken_rules(root: etree._Element, folder: Path) -> set[str]:
    checked = check_file(write(root, folder))
    assert not checked.unreadable
    return {finding.rule for finding in checked.findings}


def test_a_good_road_is_silent(tmp_path: Path) -> None:
    assert broken_rules(good_road(), tmp_path) == set()


def test_a_file_with_only_short_lanelets_is_checked(tmp_path: Path) -> None:
    root = etree.Element("commonRoad", {"benchmarkID": "DEU_Short-1_1_T-1"})
    add_lanelet(root, 1, [(0, 0), (0.5, 0), (1, 0)])
    assert broken_rules(root, tmp_path) == set()


@pytest.mark.parametrize("name", NAMES)
def test_a_rule_catches_its_defect_and_no_other_rule_does(name: str, tmp_path: Path) -> None:
    root = good_road()
    DEFECTS[name](root)
    assert broken_rules(root, tmp_path) == {name, *COMPANIONS.get(name, set())}


def test_a_rule_has_its_function_s_name_and_states_its_meaning() -> None:
    rules = all_rules()
    assert len(set(NAMES)) == len(rules)
    assert set(DEFECTS) == set(NAMES)
    assert all(rule.meaning.endswith(".") and rule.why.endswith(".") for rule in rules)
    assert len({rule.meaning for rule in rules}) == len(rules)


@settings(max_examples=40, deadline=None)
@given(
    angle=st.floats(-math.pi, math.pi),
    bend=st.floats(-0.02, 0.02),
    east=st.floats(-5e5, 5e5),
    north=st.floats(-5e5, 5e5),
    points=st.integers(3, 40),
)
def test_a_plain_road_has_no_findings_at_any_place_and_curvature(
    tmp_path_factory: pytest.TempPathFactory, angle: float, bend: float, east: float, north: float, points: int
) -> None:
    center, heading = [(east, north)], angle
    for _ in range(points):
        center.append((center[-1][0] + 4 * math.cos(heading), center[-1][1] + 4 * math.sin(heading)))
        heading += bend * 4
    root = etree.Element("commonRoad", {"benchmarkID": "DEU_Plain-1_1_T-1"})
    half = len(center) // 2
    add_lanelet(root, 1, center[: half + 1], successors=(2,))
    add_lanelet(root, 2, center[half:], predecessors=(1,))
    assert broken_rules(root, tmp_path_factory.mktemp("road")) == set()


def test_a_finding_names_the_lanelets_and_the_place(tmp_path: Path) -> None:
    root = good_road()
    DEFECTS["gap_at_join"](root)
    (finding,) = check_file(write(root, tmp_path)).findings
    assert finding.elements == (4, 6)
    assert finding.where == (120.0, 0.0)
    assert finding.severity == "warning"
    assert finding.message == "3.00 m between its end and the beginning of 6"


def test_errors_come_before_warnings(tmp_path: Path) -> None:
    root = good_road()
    DEFECTS["gap_at_join"](root)
    DEFECTS["unknown_light"](root)
    found = check_file(write(root, tmp_path))
    assert [finding.severity for finding in found.findings] == ["error", "warning"]
    assert not found.passed


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("<osm/>", "“osm”"),
        ("<commonRoad>", "well-formed"),
        ("<!DOCTYPE a><commonRoad/>", "document type"),
        ("<commonRoad><lanelet id='one'/></commonRoad>", "id of <lanelet> of <lanelet> is “one”"),
        ("<commonRoad><lanelet id='1'><successor/></lanelet></commonRoad>", "ref=''"),
    ],
)
def test_a_file_that_cannot_be_read_is_reported(tmp_path: Path, text: str, complaint: str) -> None:
    path = tmp_path / "bad.xml"
    path.write_text(text)
    checked = check_file(path)
    assert complaint in checked.unreadable
    assert not checked.passed
