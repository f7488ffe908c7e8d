"""The judge of reference drivers on recorded collisions: what it finds on encounters whose end is known."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from support.runs import record

from benchmarks.analysis.recorded import Hit
from benchmarks.analysis.recorded_drivers import DRIVERS, DrivenPath, prevented_by
from plannerforge.schemas.runs import RunSteps

STEP_S = 0.1


def other(ahead_m: float, speed_mps: float, heading_rad: float = 0.0, last: int = 200) -> Any:
    """Return a car that moves evenly along the x axis from a place on, and whose track ends at a step."""
    way = speed_mps * np.cos(heading_rad) * STEP_S

    def state(step: int) -> Any:
        if not 0 <= step <= last:
            return None
        return SimpleNamespace(position=(ahead_m + way * step, 0.0), orientation=heading_rad, velocity=speed_mps)

    return SimpleNamespace(state_at_time=state, obstacle_shape=SimpleNamespace(length=4.5, width=1.8))


def hit(obstacle: Any, speed_mps: float, step: int, *others: Any) -> Hit:
    """Return a collision at a step of an ego that drove evenly along the x axis."""
    count = step + 1
    steps = RunSteps(
        first_step=0,
        x_m=tuple(speed_mps * STEP_S * index for index in range(count)),
        y_m=(0.0,) * count,
        heading_rad=(0.0,) * count,
        speed_mps=(speed_mps,) * count,
        acceleration_mps2=(0.0,) * count,
        plan_steps=(),
        costs={},
    )
    return Hit(record(outcome="collision"), steps, obstacle, step, others)


@pytest.mark.parametrize(
    ("made", "prevented"),
    [
        (hit(other(60.0, 0.0), 10.0, 56), dict.fromkeys(DRIVERS, True)),
        (hit(other(9.0, 0.0), 10.0, 5), dict.fromkeys(DRIVERS, False)),
        (hit(other(14.3, 0.0), 10.0, 10), {"full_braking": True, "r157_careful": False}),
        (hit(other(-20.0, 15.0), 5.0, 16), dict.fromkeys(DRIVERS, False)),
        (hit(other(80.0, 10.0, np.pi), 10.0, 38), dict.fromkeys(DRIVERS, False)),
    ],
    ids=["far ahead", "too near", "in time for one without delay", "from behind", "head on"],
)
def test_drivers_prevent_collisions_that_their_distances_allow(made: Hit, prevented: dict[str, bool]) -> None:
    assert {driver: prevented_by(made, driver) for driver in prevented} == prevented


def test_a_verdict_on_an_edge_is_left_out() -> None:
    """From 10 m/s an ego stops in 9.4 m, of which 5.5 m while its brakes build up; both bodies are 4.5 m long."""
    assert prevented_by(hit(other(13.9, 0.0), 10.0, 10), "full_braking") is None


def test_a_verdict_is_left_out_if_another_vehicle_may_hide_the_one_that_was_hit() -> None:
    made = hit(other(60.0, 0.0), 10.0, 56, other(30.0, 10.0))
    assert prevented_by(made, "full_braking") is True
    assert prevented_by(made, "r157_careful") is None


def test_places_on_a_route_that_returns_are_near_the_last_one() -> None:
    turn = np.linspace(0.0, 2 * np.pi, 60)
    lap = np.column_stack([20 * np.sin(turn), 20 - 20 * np.cos(turn), turn, np.full(60, 5.0)])
    way = DrivenPath.driven(lap)
    assert way.place(np.array([0.5, 0.0]), 1.0, 5.0)[0] == pytest.approx(0.5, abs=0.1)
    assert way.place(np.array([0.5, 0.0]), 125.0, 5.0)[0] == pytest.approx(126.0, abs=0.5)
