"""The judge of manoeuvres reads files on its own: it sees what happens, and leaves open what is near a threshold."""

import math
from pathlib import Path

import pytest
from support.builders import ScenarioBuilder, Vehicle, driving, town_road

from benchmarks.selection.manoeuvre_judge import OTHERS, Answer, Judge
from benchmarks.selection.manoeuvres import requests_of

STEPS = 60


def aside(begin_m: float, end_m: float, start_x: float = 60.0, kind: str = "car") -> Vehicle:
    """A vehicle at 10 m/s that moves from one offset to another between 1 s and 4 s."""
    poses = []
    for step in range(STEPS):
        share = min(max((step * 0.1 - 1.0) / 3.0, 0.0), 1.0)
        slope = (end_m - begin_m) / 3.0 if 0.0 < share < 1.0 else 0.0
        poses.append((start_x + step, begin_m + (end_m - begin_m) * share, math.atan2(slope, 10.0), 10.0))
    return Vehicle(77, tuple(poses), kind)


def braking(rate_mps2: float) -> Vehicle:
    """A vehicle ahead in the ego's lane that brakes from 10 m/s on."""
    poses, x = [], 60.0
    for step in range(STEPS):
        speed = max(10.0 - rate_mps2 * step * 0.1, 0.0)
        poses.append((x, 0.0, 0.0, speed))
        x += speed * 0.1
    return Vehicle(77, tuple(poses))


def answers(builder: ScenarioBuilder, folder: Path) -> dict[str, Answer]:
    """What the judge says of a scenario."""
    return dict(Judge(builder.write(folder / "scenario.xml")).answers())


@pytest.mark.parametrize(
    ("vehicle", "name"),
    [
        (aside(3.5, 0.0), "cut_in"),
        (aside(0.0, 3.5), "cut_out"),
        (braking(6.0), "lead_brakes_hard"),
        (driving(77, (110, -6), 3.0, STEPS, heading_rad=math.pi / 2), "crossing"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_the_manoeuvre_and_no_other_is_seen(vehicle: Vehicle, name: str, tmp_path: Path) -> None:
    found = answers(town_road().with_vehicles(vehicle), tmp_path)
    assert {key for key in OTHERS if found[key] is Answer.YES} == {name}


@pytest.mark.parametrize(
    "vehicle", [aside(3.5, 3.5), aside(3.5, 0.0, start_x=180.0), braking(1.0)], ids=["kept lane", "far ahead", "gentle"]
)
def test_quiet_traffic_makes_no_manoeuvre(vehicle: Vehicle, tmp_path: Path) -> None:
    found = answers(town_road().with_vehicles(vehicle), tmp_path)
    assert {found[key] for key in OTHERS} == {Answer.NO}


def test_braking_near_the_threshold_is_left_open(tmp_path: Path) -> None:
    found = answers(town_road().with_vehicles(braking(3.45)), tmp_path)
    assert found["lead_brakes_hard"] is Answer.OPEN


def test_requests_are_the_same_for_a_seed_and_ask_for_all_manoeuvres() -> None:
    one, again, other = (list(requests_of(48, seed)) for seed in (1, 1, 2))
    assert one == again != other
    assert set(OTHERS) <= {request.feature for request in one}
