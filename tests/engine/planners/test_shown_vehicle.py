from typing import Any

import numpy as np
import pytest

from plannerforge.engine.cosimulation.vehicles import ShownVehicle, SumoVehicles

HALF_LANE_M, HALF_WIDTH_M = 1.75, 0.9
HINT = ("e1", 0)


class OneLane(SumoVehicles):
    """A straight lane along x instead of SUMO; it notes every entry."""

    def __init__(self) -> None:
        super().__init__(None)
        self.entries: list[str] = []
        self.removed: list[str] = []
        self.aside_m = 0.0
        self.lane = "e1_0"

    def add_route(self, key: str, edges: tuple[str, ...]) -> None: ...

    def add(self, name: str, key: str) -> None:
        self.entries.append(name)

    def remove(self, key: str) -> None:
        if key:
            self.removed.append(key)

    def place(self, key: str, center: Any, heading_rad: float, length_m: float, hint: Any, keep: int = 2) -> None:
        self.aside_m = float(center[1])

    def show_speed(self, key: str, speed_mps: float) -> None: ...

    def hold(self, key: str) -> None: ...

    def lines_lapped(self, key: str) -> tuple[str, frozenset[str]]:
        over = {"left": self.aside_m + HALF_WIDTH_M, "right": HALF_WIDTH_M - self.aside_m}
        return self.lane, frozenset(side for side, reach in over.items() if reach > HALF_LANE_M)


def driven(asides_m: list[float], lanes: list[str] | None = None) -> OneLane:
    road = OneLane()
    ego = ShownVehicle(road, "ego", ("e1",))
    for step, aside in enumerate(asides_m):
        road.lane = lanes[step] if lanes else road.lane
        ego.place(np.array([10.0 * step, aside]), 0.0, 4.5, HINT)
        ego.settle(10.0, frozenset(road.entries) - frozenset(road.removed))
    return road


def test_staying_between_the_lines_keeps_the_entry() -> None:
    """In a junction a new entry would be the last to have come, and a follower would not wait for it."""
    assert driven([0.0, 0.3, -0.5, 0.8]).entries == ["ego:0"]


@pytest.mark.parametrize("asides_m", [[0.0, 1.2, 1.3, 1.3], [1.2, 0.0, 0.1, 0.1], [1.2, -1.2, -1.2, -1.2]])
def test_coming_over_a_line_or_back_enters_anew_once(asides_m: list[float]) -> None:
    road = driven(asides_m)
    assert road.entries == ["ego:0", "ego:1"]
    assert road.removed == ["ego:0"]


def test_changing_the_lane_needs_no_new_entry() -> None:
    assert driven([0.0, 1.2, 0.0, 0.0], ["e1_0", "e1_1", "e1_1", "e1_1"]).entries == ["ego:0", "ego:1"]
    assert driven([0.0, 1.2, 1.2, 1.2], ["e1_0", "e1_1", "e1_1", "e1_1"]).entries == ["ego:0"]


def test_a_lost_vehicle_enters_anew() -> None:
    road = OneLane()
    ego = ShownVehicle(road, "ego", ("e1",))
    for _ in range(2):
        ego.place(np.zeros(2), 0.0, 4.5, HINT)
        ego.settle(0.0, frozenset())
    assert road.entries == ["ego:0", "ego:1"]
