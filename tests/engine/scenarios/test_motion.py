"""How a recorded vehicle moves over time, why it brakes, and where all are at a moment."""

import math
from collections.abc import Callable
from pathlib import Path

import pytest
from support.builders import Vehicle, driving, town_road

from plannerforge.engine.execution.executor import silent
from plannerforge.engine.scenarios.description import describe
from plannerforge.schemas.errors import NotPossible
from plannerforge.schemas.scenarios import DescribedMotion, DescribeRequest, Description

STEPS = 80


def slowing(key: int, start: tuple[float, float], speed: Callable[[float], float]) -> Vehicle:
    """A vehicle in its lane with a speed over time."""
    poses, x = [], start[0]
    for step in range(STEPS):
        now_mps = speed(step * 0.1)
        poses.append((x, start[1], 0.0, now_mps))
        x += now_mps * 0.1
    return Vehicle(key, tuple(poses))


def described(
    folder: Path, *vehicles: Vehicle, focus: str | None, time_s: float = 0.0, motion: bool = False
) -> Description:
    path = town_road().with_vehicles(*vehicles).write(folder / "scenario.xml")
    detail = "motion" if motion else "vehicles"
    return describe(
        DescribeRequest(path=path, detail=detail, focus=focus, radius_m=400.0, time_s=time_s),  # type: ignore[arg-type]
        silent,
    )


def motion(folder: Path, *vehicles: Vehicle, focus: str) -> DescribedMotion:
    asked = described(folder, *vehicles, focus=focus, motion=True).asked
    assert asked is not None
    assert asked.motion is not None
    return asked.motion


def test_a_vehicle_brakes_for_its_leader(tmp_path: Path) -> None:
    seen = motion(
        tmp_path,
        slowing(71, (60, 0), lambda t: 10.0 if t < 2 else max(10.0 - 3.0 * (t - 2), 4.0)),
        driving(72, (80, 0), 4.0, STEPS),
        focus="71",
    )
    assert [(event.code, event.cause) for event in seen.events] == [("brakes", "leader")]
    assert seen.events[0].from_s == pytest.approx(2.0, abs=0.4)
    assert "vehicle 72" in seen.events[0].words
    first = seen.moments[0]
    assert (first.leader, first.gap_m, first.lanelet) == (72, pytest.approx(15.5, abs=0.1), 1)
    assert min(one.acceleration_mps2 for one in seen.moments) == pytest.approx(-3.0, abs=0.5)


def test_a_pedestrian_follows_no_vehicle_and_gets_no_drivers_events(tmp_path: Path) -> None:
    walking = Vehicle(76, slowing(76, (60, 0), lambda t: 2.4 if t < 2 else 0.6).poses, "pedestrian", 0.5, 0.5)
    leader = driving(72, (64, 0), 2.0, STEPS)
    seen = motion(tmp_path, walking, leader, focus="76")
    assert {(one.leader, one.gap_m) for one in seen.moments} == {(None, None)}
    assert (seen.events, seen.walks) == ((), True)
    assert not any("lane," in line or "brakes" in line for line in seen.lines())
    asked = described(tmp_path, walking, leader, focus="76", motion=True).asked
    assert asked is not None
    assert asked.reach == ()
    assert motion(tmp_path, walking, leader, focus="72").walks is False


def test_a_vehicle_brakes_for_crossing_traffic_and_without_a_visible_reason(tmp_path: Path) -> None:
    braking = slowing(71, (60, 0), lambda t: 10.0 if t < 1 else max(10.0 - 4.0 * (t - 1), 0.0))
    crossing = driving(73, (85, -12), 5.0, STEPS, heading_rad=math.pi / 2)
    assert motion(tmp_path, braking, crossing, focus="71").events[0].cause == "crossing"
    assert motion(tmp_path, braking, focus="71").events[0].cause == "unknown"


def test_a_change_of_lane_is_reported_with_its_side(tmp_path: Path) -> None:
    poses = tuple((40 + step, min(step * 0.1, 3.5), 0.1, 10.0) for step in range(STEPS))
    events = motion(tmp_path, Vehicle(74, poses), focus="74").events
    assert [(event.code, "left" in event.words) for event in events] == [("changes_lane", True)]


def test_all_vehicles_are_described_at_a_time(tmp_path: Path) -> None:
    shown = described(tmp_path, driving(75, (60, 0), 10.0, STEPS), focus="75", time_s=3.0)
    assert shown.asked is not None
    assert shown.asked.vehicle is not None
    assert shown.asked.vehicle.ahead_m == pytest.approx(50.0, abs=0.2)


def test_an_empty_moment_and_an_ego_without_a_recording_are_refused(tmp_path: Path) -> None:
    with pytest.raises(NotPossible):
        described(tmp_path, driving(75, (60, 0), 10.0, STEPS), focus=None, time_s=60.0)
    with pytest.raises(NotPossible):
        described(tmp_path, driving(75, (60, 0), 10.0, STEPS), focus="ego", motion=True)


def test_a_crossing_pedestrian_is_on_the_lanelets_that_it_crosses(tmp_path: Path) -> None:
    walker = driving(71, (60, -4), 1.4, STEPS, heading_rad=math.pi / 2, kind="pedestrian", size_m=(0.5, 0.6))
    under = [one.lanelet for one in motion(tmp_path, walker, focus="71").moments]
    assert under[0] is None
    assert [key for key in dict.fromkeys(under) if key is not None] == [1, 2, 3]


def test_braking_that_an_edit_sets_has_the_edit_as_its_cause(tmp_path: Path) -> None:
    path = town_road().with_vehicles(slowing(71, (60, 0), lambda t: 10.0)).write(tmp_path / "base.xml")
    edited = town_road().with_vehicles(slowing(71, (60, 0), lambda t: 10.0 if t < 2 else max(10.0 - 5.0 * (t - 2), 0)))
    request = DescribeRequest(
        path=edited.write(tmp_path / "edited.xml"), base=path, detail="motion", focus="71", radius_m=400.0
    )
    for base, cause in ((path, "edit"), (None, "unknown")):
        asked = describe(request.model_copy(update={"base": base}), silent).asked
        assert asked is not None
        assert asked.motion is not None
        assert [event.cause for event in asked.motion.events] == [cause]
        assert asked.motion.events[0].from_s == pytest.approx(2.0, abs=0.1)
