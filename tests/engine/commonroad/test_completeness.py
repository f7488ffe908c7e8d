"""Files that lack what commonroad-io takes for granted: completed where that is clear, otherwise named."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from commonroad.common.file_reader import CommonRoadFileReader
from lxml import etree
from support.builders import town_road

from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.maps.foreign.lanelet_map import read_lanelet_map, write_network
from plannerforge.schemas.errors import UnsafeInput


def changed(folder: Path, change: Callable[[etree._Element], None]) -> Path:
    """The scenario of a town road after a change of its document."""
    path = town_road().write(folder / "town.xml")
    root = etree.parse(path).getroot()
    change(root)
    path.write_bytes(etree.tostring(root, encoding="UTF-8", xml_declaration=True))
    return path


def without(path: str) -> Callable[[etree._Element], None]:
    def change(root: etree._Element) -> None:
        element = root.findall(path)[0]
        parent = element.getparent()
        assert parent is not None
        parent.remove(element)

    return change


def with_text(path: str, text: str) -> Callable[[etree._Element], None]:
    def change(root: etree._Element) -> None:
        root.findall(path)[0].text = text

    return change


def put_heights(root: etree._Element) -> None:
    for point in root.iterfind("lanelet/*/point"):
        etree.SubElement(point, "z").text = "1.5"


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (without("planningProblem/goalState/time"), "goal of planningProblem .* <time>"),
        (without("planningProblem/initialState"), "planningProblem .* <initialState>"),
        (without("planningProblem/initialState/position"), "initialState of planningProblem .* <position>"),
        (lambda root: root.set("commonRoadVersion", "2021b"), "2021b"),
        (lambda root: root.attrib.pop("timeStepSize"), "timeStepSize"),
        (without("dynamicObstacle/type"), "type"),
        (with_text("dynamicObstacle/type", "spaceship"), "spaceship"),
        (with_text("lanelet/laneletType", "canal"), "canal"),
    ],
)
def test_missing_parts_of_a_file_are_named(
    change: Callable[[etree._Element], None], named: str, tmp_path: Path
) -> None:
    with pytest.raises(UnsafeInput, match=named) as refusal:
        read_scenario(changed(tmp_path, change))
    assert re.search(r"line \d", refusal.value.message)
    assert "Error" not in refusal.value.message


def test_a_goal_on_a_lanelet_that_is_not_there_is_named(tmp_path: Path) -> None:
    def change(root: etree._Element) -> None:
        goal = root.findall("planningProblem/goalState")[0]
        for position in goal.findall("position"):
            goal.remove(position)
        etree.SubElement(etree.SubElement(goal, "position"), "lanelet", ref="4711")

    with pytest.raises(UnsafeInput, match="lanelet 4711"):
        read_scenario(changed(tmp_path, change))


@pytest.mark.parametrize("missing", ["scenarioTags", "location/gpsLatitude", "location"])
def test_tags_and_places_may_be_missing(missing: str, tmp_path: Path) -> None:
    assert len(read_scenario(changed(tmp_path, without(missing))).scenario.lanelet_network.lanelets) > 1


def test_lanelets_with_heights_are_read_in_the_plane(tmp_path: Path) -> None:
    path = changed(tmp_path, put_heights)
    assert {one.left_vertices.shape[1] for one in read_scenario(path).scenario.lanelet_network.lanelets} == {2}


def test_lanelets_with_heights_are_a_map(tmp_path: Path) -> None:
    lost = write_network(changed(tmp_path, put_heights), tmp_path / "map.xml")
    assert "heights" in lost
    network = read_lanelet_map(tmp_path / "map.xml").network
    assert network is not None
    assert network.lanelets


def test_a_network_of_format_2017a_is_read(tmp_path: Path) -> None:
    def change(root: etree._Element) -> None:
        for element in [one for one in root if one.tag != "lanelet"]:
            root.remove(element)
        for name in ("tags", "author", "affiliation", "source"):
            root.attrib.pop(name, None)
        for element in list(root.iterfind("lanelet/laneletType")):
            parent = element.getparent()
            assert parent is not None
            parent.remove(element)
        root.set("commonRoadVersion", "2017a")

    loaded = read_scenario(changed(tmp_path, change))
    assert len(loaded.scenario.lanelet_network.lanelets) > 1


def test_a_map_is_used_without_the_elements_that_the_schema_refuses(tmp_path: Path) -> None:
    def change(root: etree._Element) -> None:
        lanelet = root.findall("lanelet")[0]
        lanelet.append(etree.Element("outgoingRight", ref=lanelet.get("id", "")))

    path = changed(tmp_path, change)
    lost = write_network(path, tmp_path / "map.xml")
    assert any("outgoingRight 1" in words for words in lost)
    kept = CommonRoadFileReader(str(tmp_path / "map.xml")).open_lanelet_network()
    assert len(kept.lanelets) == len(CommonRoadFileReader(str(path)).open_lanelet_network().lanelets)


def test_a_goal_in_the_words_of_an_old_format_is_passed_over(tmp_path: Path) -> None:
    def old_goal(root: etree._Element) -> None:
        problem = root.find("planningProblem")
        assert problem is not None
        for goal in problem.findall("goalState"):
            problem.remove(goal)
        times = "<time><intervalStart>0.0</intervalStart><intervalEnd>5.4</intervalEnd></time>"
        problem.append(etree.fromstring(f"<goalRegion><state>{times}</state></goalRegion>"))

    assert read_scenario(changed(tmp_path, old_goal)).problem().goal.state_list == []
