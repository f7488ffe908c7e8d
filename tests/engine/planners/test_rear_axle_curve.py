"""The curve of the rear axle: it begins as the vehicle stands, ends on its path, and its centre keeps to the lane."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from plannerforge.engine.geometry.polyline import Points, Values, arc_length, project_all
from plannerforge.engine.planners.route_follower import RearAxleCurve, RearAxlePath
from plannerforge.engine.vehicles.kinematics import centers
from plannerforge.engine.vehicles.models import BMW_320I

BEHIND_M = BMW_320I.rear_axle_behind_center_m


def s_bend(radius_m: float) -> Points:
    """40 m straight on, a quarter turn left, a quarter turn right and 60 m straight on, a metre between points."""
    turn = np.full(round(radius_m * math.pi / 2), 1 / radius_m)
    heading = np.cumsum(np.concatenate([np.zeros(40), turn, -turn, np.zeros(60)]))
    steps = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    return np.concatenate([[[0.0, 0.0]], np.cumsum(steps, axis=0)])


def every(metres: float, curve: RearAxleCurve, station: float, length_m: float) -> tuple[Values, Points, Values]:
    """Stations, rear axles and headings along a curve."""
    stations = curve.after(station, np.arange(0.0, length_m, metres))
    return stations, *curve.poses(stations)


@pytest.mark.parametrize("radius_m", [6.0, 10.0, 40.0])
def test_the_centre_keeps_to_the_path(radius_m: float) -> None:
    path = s_bend(radius_m)
    curve = RearAxleCurve.beginning_at(RearAxlePath(path, BEHIND_M), np.array([5.0, 0.0]), 0.0, 15.0)
    _, rear, headings = every(0.5, curve, curve.fade.begin_m, arc_length(path)[-1] - 10.0)
    offsets = project_all(path, centers(rear, headings, BMW_320I))[1]
    assert np.abs(offsets).max() < 0.05


@given(
    aside_m=st.floats(-1.5, 1.5), turned_rad=st.floats(-0.4, 0.4), begin=st.integers(5, 60), radius_m=st.floats(8.0, 50)
)
def test_it_begins_at_the_vehicle_s_pose_and_ends_on_its_path(
    aside_m: float, turned_rad: float, begin: int, radius_m: float
) -> None:
    path = RearAxlePath(s_bend(radius_m), BEHIND_M)
    (foot,), (along_rad,), _, _ = path.frame(np.array([float(begin)]))
    point = foot + aside_m * np.array([-math.sin(along_rad), math.cos(along_rad)])
    curve = RearAxleCurve.beginning_at(path, point, along_rad + turned_rad, 15.0)
    stations, rear, headings = every(0.1, curve, curve.fade.begin_m, 40.0)
    assert rear[0] == pytest.approx(point, abs=1e-3)
    assert headings[0] == pytest.approx(along_rad + turned_rad, abs=1e-3)
    assert rear[-1] == pytest.approx(path.frame(stations[-1:])[0][0], abs=1e-9)
    moved = np.diff(rear, axis=0)
    assert np.linalg.norm(moved, axis=1) == pytest.approx(0.1, abs=2e-3)
    between = np.arctan2(moved[:, 1], moved[:, 0]) - 0.5 * (headings[1:] + headings[:-1])
    assert np.abs(np.remainder(between + math.pi, math.tau) - math.pi).max() < 0.01


def test_its_curvature_has_no_steps() -> None:
    path = RearAxlePath(s_bend(8.0), BEHIND_M)
    curve = RearAxleCurve.beginning_at(path, np.array([5.0, 0.5]), 0.1, 15.0)
    _, _, headings = every(0.1, curve, curve.fade.begin_m, 80.0)
    curvature = np.diff(headings) / 0.1
    assert np.abs(np.diff(curvature)).max() < 0.03
    assert np.abs(curvature).max() < 0.16


def test_the_spline_is_scipys_to_the_last_bit() -> None:
    from scipy.interpolate import CubicSpline

    path = RearAxlePath(s_bend(12.0) + 1e5, BEHIND_M)
    spline = CubicSpline(path.stations_m, path._points)
    stations = np.concatenate([path.stations_m, np.linspace(0.0, float(path.stations_m[-1]), 333)])
    points, headings, pace, _ = path.frame(stations)
    along = spline.derivative(1)(stations)
    assert np.array_equal(points, spline(stations))
    assert np.array_equal(headings, np.arctan2(along[:, 1], along[:, 0]))
    assert np.array_equal(pace, np.linalg.norm(along, axis=1))
