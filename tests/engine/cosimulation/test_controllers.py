"""Speed controllers: their order, and how they brake."""

import pytest

from plannerforge.engine.cosimulation.controllers import (
    SPEED_CONTROLLERS,
    AnticipatoryBraking,
    CurveSpeedController,
    GapWaitController,
    StopController,
    next_speed_mps,
)


def test_controllers_decide_in_this_order() -> None:
    """Waiting gives orders to change lanes besides, and so comes first."""
    assert (GapWaitController, AnticipatoryBraking, CurveSpeedController, StopController) == SPEED_CONTROLLERS


def test_braking_exceeds_the_vehicle_s_own_deceleration_only_if_necessary() -> None:
    def stopped(speed_mps: float, room_m: float) -> tuple[float, float]:
        hardest, rolled_m = 0.0, 0.0
        for _ in range(200):
            after = next_speed_mps(speed_mps, 4.0, 0.1, room_m - rolled_m, room_m - rolled_m)
            after = speed_mps if after is None else after
            hardest, rolled_m, speed_mps = max(hardest, (speed_mps - after) / 0.1), rolled_m + after * 0.1, after
        return hardest, rolled_m

    hardest, rolled_m = stopped(10.0, 60.0)
    assert hardest == pytest.approx(4.0, abs=0.5)
    assert 57.0 < rolled_m <= 60.0
    hardest, rolled_m = stopped(10.0, 8.0)
    assert 6.0 < hardest < 8.01
    assert rolled_m < 8.3
