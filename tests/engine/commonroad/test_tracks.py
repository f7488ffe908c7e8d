"""Reading a recording as arrays takes and refuses exactly what commonroad-io takes and refuses."""

import tempfile
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element, ElementTree, fromstring, parse

import numpy as np
import pytest
from commonroad.common.reader.file_reader_xml import XMLFileReader
from commonroad.geometry.shape import Polygon, Rectangle, ShapeGroup
from commonroad.prediction.prediction import TrajectoryPrediction
from commonroad.scenario.scenario import Scenario
from hypothesis import given, settings
from hypothesis import strategies as st
from lxml import etree
from support.builders import ScenarioBuilder, town_road

from plannerforge.engine.commonroad.document import SplitDocument
from plannerforge.engine.commonroad.plain_states import cut_states, remove_plain_states, remove_states
from plannerforge.engine.commonroad.reader import read_recorded, read_scenario
from plannerforge.engine.commonroad.tracks import Track, last_recorded_step, recorded_tracks, size_of
from plannerforge.engine.commonroad.value_limits import check_document
from plannerforge.schemas.errors import UnsafeInput

STEPS = 6
Change = Callable[[Element], None]
Reading = Callable[[Path], tuple[int, dict[int, Track]]]


def small(version: str = "2020a") -> ScenarioBuilder:
    road = replace(town_road(), version=version)
    return road.with_vehicles(*road.vehicles[:2]).cut(STEPS)


def drop(tag: str) -> Change:
    def change(state: Element) -> None:
        for field in state.findall(tag):
            state.remove(field)

    return change


def say(path: str, text: str | None) -> Change:
    def change(state: Element) -> None:
        for value in state.findall(path):
            value.text = text

    return change


def add(xml: str) -> Change:
    return lambda state: state.append(fromstring(xml))


def fill(tag: str, xml: str) -> Change:
    """Give a field other children in place of its own."""

    def change(state: Element) -> None:
        for field in state.findall(tag):
            field[:] = fromstring(f"<all>{xml}</all>")

    return change


def rename(state: Element) -> None:
    state.tag = "moment"


INTERVAL = "<intervalStart>1</intervalStart><intervalEnd>2</intervalEnd>"
RECTANGLE = "<rectangle><length>2</length><width>1</width><center><x>5</x><y>0</y></center></rectangle>"
CHANGES: dict[str, Change] = {
    "no velocity": drop("velocity"),
    "no orientation": drop("orientation"),
    "no time": drop("time"),
    "no position": drop("position"),
    "velocity no number": say("velocity/exact", "fast"),
    "velocity NaN": say("velocity/exact", "nan"),
    "velocity empty": say("velocity/exact", None),
    "velocity with blanks": say("velocity/exact", " 3.5\n"),
    "time no integer": say("time/exact", "2.0"),
    "time negative": say("time/exact", "-2"),
    "time another": say("time/exact", "40"),
    "x no number": say("position/point/x", "here"),
    "x infinite": say("position/point/x", "1e999"),
    "field twice": add("<velocity><exact>3</exact></velocity>"),
    "unknown field": add("<mood><exact>3</exact></mood>"),
    "unknown field without value": add("<mood>3</mood>"),
    "field called x": add("<x><exact>3</exact></x>"),
    "acceleration": add("<acceleration><exact>0.5</exact></acceleration>"),
    "velocity in another element": fill("velocity", "<about>3</about>"),
    "velocity interval": fill("velocity", INTERVAL),
    "time interval": fill("time", INTERVAL),
    "point with height": fill("position", "<point><x>1</x><y>2</y><z>3</z></point>"),
    "point the other way round": fill("position", "<point><y>2</y><x>1</x></point>"),
    "region": fill("position", RECTANGLE),
    "another element": rename,
}


def outcome(read: Reading, path: Path) -> tuple[int, list[tuple[object, ...]]] | str:
    """What the reading gives, in a form that can be compared; ``refused`` where it refuses."""
    try:
        last, tracks = read(path)
    except UnsafeInput:
        return "refused"
    return last, [(one.obstacle_id, one.kind, one.first_step, _bytes(one)) for one in tracks.values()]


def _bytes(track: Track) -> bytes:
    return b"".join(values.tobytes() for values in (track.positions, track.headings_rad, track.speeds_mps))


def read_by_commonroad_io(path: Path) -> Scenario:
    """What commonroad-io itself makes of a file whose numbers are within the limits."""
    try:
        check_document(parse(path).getroot())
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return XMLFileReader(path).open()[0]
    except Exception as error:
        raise UnsafeInput(str(error)) from error


def by_commonroad_io(path: Path) -> tuple[int, dict[int, Track]]:
    scenario = read_by_commonroad_io(path)
    return last_recorded_step(scenario), recorded_tracks(scenario)


def as_objects(path: Path) -> tuple[int, dict[int, Track]]:
    """By way of the objects that are made of the arrays, which hold what those of commonroad-io do."""
    scenario, expected = read_scenario(path).scenario, read_by_commonroad_io(path)
    assert _states(scenario) == _states(expected)
    return last_recorded_step(scenario), recorded_tracks(scenario)


def _states(scenario: Scenario) -> list[tuple[object, ...]]:
    """Every state of all trajectories: its class, and its values by name."""
    trajectories = {
        one.obstacle_id: one.prediction.trajectory
        for one in scenario.dynamic_obstacles
        if isinstance(one.prediction, TrajectoryPrediction)
    }
    return [
        (key, type(state).__name__, *sorted((name, _plain(getattr(state, name))) for name in state.used_attributes))
        for key, trajectory in trajectories.items()
        for state in trajectory.state_list
    ]


def _plain(value: object) -> str:
    return repr(value.tolist()) if isinstance(value, np.ndarray) else f"{type(value).__name__} {value}"


def as_arrays(path: Path) -> tuple[int, dict[int, Track]]:
    found = read_recorded(path)
    return last_recorded_step(found.loaded.scenario), found.tracks


def agree(root: Element) -> str:
    """Assert that both readings agree; gives ``refused`` or ``taken``."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scenario.xml"
        ElementTree(root).write(path, encoding="UTF-8", xml_declaration=True)
        expected = outcome(by_commonroad_io, path)
        assert outcome(as_arrays, path) == expected
        assert outcome(as_objects, path) == expected
    return expected if isinstance(expected, str) else "taken"


@pytest.mark.parametrize(("version", "where"), [("2020a", 0), ("2020a", STEPS - 2), ("2018b", 2)])
@pytest.mark.parametrize("name", CHANGES)
def test_one_unusual_state_is_judged_as_commonroad_io_judges_it(version: str, where: int, name: str) -> None:
    root = fromstring(small(version).xml().encode())
    CHANGES[name](root.findall(".//trajectory/state")[where])
    agree(root)


@pytest.mark.parametrize("name", CHANGES)
def test_a_whole_unusual_trajectory_is_judged_as_commonroad_io_judges_it(name: str) -> None:
    root = fromstring(small().xml().encode())
    for state in root.findall(".//trajectory/state"):
        CHANGES[name](state)
    agree(root)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(sorted(CHANGES)), st.integers(0, 2 * STEPS - 3)), min_size=2, max_size=5))
def test_several_unusual_states_are_judged_as_commonroad_io_judges_them(changes: list[tuple[str, int]]) -> None:
    root = fromstring(small().xml().encode())
    states = root.findall(".//trajectory/state")
    for name, where in changes:
        CHANGES[name](states[where])
    agree(root)


def test_plain_trajectories_are_removed_and_the_others_stay_complete() -> None:
    root = etree.fromstring(small().xml().encode())
    trajectories = root.findall(".//trajectory")
    trajectories[1][2].remove(trajectories[1][2].find("velocity"))
    before = len(trajectories[1])
    assert list(remove_plain_states(root)) == [31]
    assert [len(one) for one in trajectories] == [2, before]


def test_real_recordings_are_the_same_either_way(shared_data: Path) -> None:
    files = sorted((shared_data / "data/commonroad").glob("*.xml"))[::80]
    expected = [outcome(by_commonroad_io, path) for path in files]
    assert [outcome(as_arrays, path) for path in files] == expected
    assert [outcome(as_objects, path) for path in files] == expected


@pytest.mark.parametrize("read", [read_scenario, read_recorded])
def test_a_country_without_its_own_signs_is_read_without_a_warning(
    read: Callable[[Path], object], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "a.xml"
    path.write_text(small().xml().replace("ZAM_Builder", "ALB_Builder"), encoding="utf-8")
    read(path)
    assert caplog.records == []


def test_the_size_of_a_group_of_shapes_is_that_of_the_box_around_them() -> None:
    cab = Rectangle(2.0, 2.0, center=np.array([4.0, 0.0]))
    trailer = Rectangle(6.0, 2.5)
    assert size_of(ShapeGroup([cab, trailer])) == pytest.approx((8.0, 2.5))
    assert size_of(Polygon(np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 2.0]]))) == (3.0, 2.0)


def test_states_read_from_bytes_match_those_of_a_parser(tmp_path: Path) -> None:
    content = town_road().write(tmp_path / "town.xml").read_bytes()
    split = SplitDocument.of(content)
    assert split is not None
    for chunk in split.chunks:
        parsed = etree.fromstring(chunk)
        taken, cut = remove_states(parsed), cut_states(chunk)
        assert taken is not None
        assert cut is not None
        assert taken[0] == cut[0]
        assert taken[1].positions.tobytes() == cut[1].positions.tobytes()
        assert {name: values.tolist() for name, values in taken[1].columns.items()} == {
            name: values.tolist() for name, values in cut[1].columns.items()
        }
        left = etree.fromstring(cut[2])
        assert [(each.tag, each.attrib) for each in left.iter()] == [(each.tag, each.attrib) for each in parsed.iter()]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"</state>", b"</state>7"),
        (b"<exact>", b"5<exact>"),
        (b"<exact>", b"<exact >"),
        (b"<trajectory>", b"<trajectory/><trajectory>"),
        (b"</x>", b"</x><z>1</z>"),
        (b"<velocity>", b"<velocity>&#49;"),
        (b"<trajectory>", b"<trajectory></state>"),
    ],
    ids=["text behind", "text before", "spaced", "twice", "another element", "reference", "broken"],
)
def test_an_obstacle_with_differing_states_is_left_to_the_parser(tmp_path: Path, old: bytes, new: bytes) -> None:
    split = SplitDocument.of(town_road().write(tmp_path / "town.xml").read_bytes())
    assert split is not None
    (chunk, *_) = (chunk for chunk in split.chunks if cut_states(chunk) is not None)
    place = chunk.rfind(old)
    assert place >= 0
    assert cut_states(chunk[:place] + new + chunk[place + len(old) :]) is None
