from collections.abc import Sequence
from typing import Any

import pytest

from plannerforge.engine.planners.traffic.reactive import ShownVehicle
from plannerforge.engine.traffic.sumo import Sumo, sumo_pose

HINT = ("e1", 0)


class OneLane(Sumo):
    """A straight lane along x, 3.5 m wide, instead of SUMO; it notes every entry of a vehicle of 1.8 m."""

    def __init__(self) -> None:
        self.entries: list[str] = []
        self.removed: list[str] = []
        self.aside_m = 0.0
        self.present_lane = "e1_0"

    def add_route(self, route: str, edges: Sequence[str]) -> None: ...

    def insert(self, key: str, route: str, vehicle_type: str) -> None:
        self.entries.append(key)

    def remove(self, key: str) -> None:
        if key:
            self.removed.append(key)

    def move_to(self, key: str, pose: Any, hint: Any, *, keep_to_route: bool = False) -> None:
        self.aside_m = pose[1]

    def show_speed(self, key: str, speed_mps: float) -> None: ...

    def hold(self, key: str) -> None: ...

    def lane(self, key: str) -> str:
        return self.present_lane

    def offset_m(self, key: str) -> float:
        return self.aside_m

    def width_m(self, key: str) -> float:
        return 1.8

    def lane_width_m(self, lane: str) -> float:
        return 3.5


def driven(asides_m: list[float], lanes: list[str] | None = None) -> OneLane:
    road = OneLane()
    ego = ShownVehicle(road, "ego", ("e1",))
    for step, aside in enumerate(asides_m):
        road.present_lane = lanes[step] if lanes else road.present_lane
        ego.place(sumo_pose(10.0 * step, aside, 0.0, 4.5), HINT)
        ego.settle(10.0, frozenset(road.entries) - frozenset(road.removed))
    return road


def test_staying_between_the_lines_keeps_the_entry() -> None:
    """In a junction a new entry would be the last to have come, and a follower would not wait for it."""
    assert driven([0.0, 0.3, -0.5, 0.8]).entries == ["ego:0"]


@pytest.mark.parametrize("asides_m", [[0.0, 1.2, 1.3, 1.3], [1.2, 0.0, 0.1, 0.1], [1.2, -1.2, -1.2, -1.2]])
def test_coming_over_a_line_or_back_enters_again_once(asides_m: list[float]) -> None:
    road = driven(asides_m)
    assert road.entries == ["ego:0", "ego:1"]
    assert road.removed == ["ego:0"]


def test_changing_the_lane_needs_no_new_entry() -> None:
    assert driven([0.0, 1.2, 0.0, 0.0], ["e1_0", "e1_1", "e1_1", "e1_1"]).entries == ["ego:0", "ego:1"]
    assert driven([0.0, 1.2, 1.2, 1.2], ["e1_0", "e1_1", "e1_1", "e1_1"]).entries == ["ego:0"]


def test_a_lost_vehicle_enters_again() -> None:
    road = OneLane()
    ego = ShownVehicle(road, "ego", ("e1",))
    for _ in range(2):
        ego.place(sumo_pose(0.0, 0.0, 0.0, 4.5), HINT)
        ego.settle(0.0, frozenset())
    assert road.entries == ["ego:0", "ego:1"]


def test_a_vehicle_that_leaves_the_road_is_removed_and_enters_again() -> None:
    # SUMO crashes on what it still knows of such a vehicle.
    road = driven([0.0, 0.0, 0.0, 0.0], ["e1_0", "", "", "e1_0"])
    assert road.removed == ["ego:0"]
    assert road.entries == ["ego:0", "ego:1"]
