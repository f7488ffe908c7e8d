"""Ways over junctions are mended in the net: no corner where they meet their roads, no hook within."""

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from lxml import etree

from plannerforge.engine.geometry.polyline import Points, headings, length_m, wrap_angles
from plannerforge.engine.network.netconvert import smooth_junction_lanes, smoothest_curve, without_folds


def direction(angle: float) -> Points:
    return np.array([math.cos(angle), math.sin(angle)])


def corners(ahead: Points, way: Points, onward: Points) -> Points:
    """Turns at both ends of a way in radians, shape (2,)."""
    line = np.vstack([way[0] - ahead, way, way[-1] + onward])
    turns = np.abs(np.diff(headings(line)))
    return turns[[0, -1]]


@settings(max_examples=80, deadline=None)
@given(
    arrive=st.floats(-math.pi, math.pi), leave=st.floats(-2.6, 2.6), span=st.floats(1.0, 40.0), bearing=st.floats(-2, 2)
)
def test_a_straight_path_between_two_directions_becomes_a_curve_that_meets_both(
    arrive: float, leave: float, span: float, bearing: float
) -> None:
    ahead, onward = direction(arrive), direction(arrive + leave)
    way = np.array([[0.0, 0.0], span * direction(arrive + bearing)])
    curve = smoothest_curve(ahead, way, onward)
    if curve is None:
        assert corners(ahead, way, onward).max() < math.radians(100)
        return
    assert np.allclose(curve[[0, -1]], way)
    assert corners(ahead, curve, onward).max() < corners(ahead, way, onward).max()
    if max(abs(bearing), abs(leave - bearing), abs(leave)) < 1.4:
        assert corners(ahead, curve, onward).max() < math.radians(45)


def test_a_path_without_corner_and_hook_stays_unchanged() -> None:
    angles = np.linspace(0.0, math.pi / 2, 12)
    arc = 8.0 * np.stack([np.sin(angles), 1.0 - np.cos(angles)], axis=1)
    assert smoothest_curve(direction(0.0), arc, direction(math.pi / 2)) is None


def test_a_hook_within_a_path_is_spread_over_its_whole_length() -> None:
    hooked = np.array([[0.0, 0.0], [5.5, 0.0], [5.9, 0.1], [6.0, 0.5], [6.0, 6.0]])
    curve = smoothest_curve(direction(0.0), hooked, direction(math.pi / 2))
    assert curve is not None
    assert np.abs(np.diff(headings(curve))).max() < 0.5 * np.abs(np.diff(headings(hooked))).max()


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(-20, 20), st.integers(-20, 20)), min_size=2, max_size=9, unique=True))
def test_a_line_without_folds_keeps_its_ends_and_never_turns_back(points: list[tuple[int, int]]) -> None:
    line = np.array(points, dtype=float)
    kept = without_folds(line)
    assert np.array_equal(kept[[0, -1]], line[[0, -1]])
    assert all(np.abs(wrap_angles(turn)) < math.radians(101) for turn in np.diff(headings(kept)))


NET = """<net>
  <edge id=":j_0" function="internal">
    <lane id=":j_0_0" index="0" length="6.000" shape="0.000,0.000 6.000,0.000"/>
  </edge>
  <edge id=":j_1" function="internal">
    <lane id=":j_1_0" index="0" length="6.000" shape="6.000,0.000 6.000,6.000"/>
  </edge>
  <edge id="a" from="i" to="j"><lane id="a_0" index="0" length="20.000" shape="-14.142,-14.142 0.000,0.000"/></edge>
  <edge id="b" from="j" to="k">
    <lane id="b_0" index="0" length="33.000" shape="6.000,6.000 6.000,20.000 6.500,18.000 6.000,26.000"/>
  </edge>
  <connection from="a" to="b" fromLane="0" toLane="0" via=":j_0_0" dir="l" state="M"/>
  <connection from=":j_0" to="b" fromLane="0" toLane="0" via=":j_1_0" dir="l" state="M"/>
  <connection from=":j_1" to="b" fromLane="0" toLane="0" dir="l" state="M"/>
</net>
"""


def test_in_a_net_the_parts_of_a_path_become_one_curve_and_roads_lose_their_folds(tmp_path: Path) -> None:
    path = tmp_path / "a.net.xml"
    path.write_text(NET, encoding="utf-8")
    assert smooth_junction_lanes(path) == 2
    lanes = {lane.get("id"): lane for lane in etree.parse(path).getroot().iter("lane")}
    lines = {
        key: np.array([[float(v) for v in point.split(",")] for point in lane.get("shape", "").split()])
        for key, lane in lanes.items()
    }
    route = [lines[key] for key in ("a_0", ":j_0_0", ":j_1_0", "b_0")]
    assert all(np.allclose(one[-1], other[0]) for one, other in pairwise(route))
    assert np.abs(np.diff(headings(np.vstack([route[0], *(line[1:] for line in route[1:])])))).max() < math.radians(45)
    assert all(abs(float(lane.get("length", "0")) - length_m(lines[key])) < 0.01 for key, lane in lanes.items())
    assert smooth_junction_lanes(path) == 0
