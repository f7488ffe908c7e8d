"""Speed controllers are declared, in the order in which they act."""

from plannerforge.engine.cosimulation.controllers import (
    SPEED_CONTROLLERS,
    AnticipatoryBraking,
    CurveSpeedController,
    GapWaitController,
    StopController,
)


def test_controllers_are_asked_in_this_order() -> None:
    """Waiting gives orders to change lanes besides, and so comes first."""
    assert (GapWaitController, AnticipatoryBraking, CurveSpeedController, StopController) == SPEED_CONTROLLERS
