"""The end states that Frenetix samples: duration × final speed × final lateral offset."""

from dataclasses import dataclass

import numpy as np

from plannerforge.engine.geometry.polyline import Points, Values
from plannerforge.engine.planners.vehicle import VehicleParameters
from plannerforge.schemas.planner_settings import PlannerSettings

SPEED_LIMIT_MPS = 36.0
SHORTEST_REST_S = 0.2
FINAL_SPEED = 5
"""Column of the sampling matrix."""
DURATION_STEPS_S = (1.0, 0.5, 0.3, 0.2)
"""Steps of the sampled durations at the levels 0 to 3, as in the reference for time steps of 0.1 s."""


@dataclass(frozen=True)
class SamplingSettings:
    """The reference's sampling, by default at level 2: nine values per axis; durations from 1.1 s every 0.3 s."""

    horizon_s: float = 3.0
    shortest_s: float = 1.1
    duration_step_s: float = 0.3
    lateral_m: float = 3.0
    values: int = 9

    @classmethod
    def of(cls, settings: PlannerSettings) -> "SamplingSettings":
        """The horizon and the level of a configuration; each level halves the distance of the values."""
        level = settings.sampling_level
        return cls(horizon_s=settings.horizon_s, values=2 ** (level + 1) + 1, duration_step_s=DURATION_STEPS_S[level])


@dataclass(frozen=True)
class CurvilinearState:
    """Arc length and lateral offset with two derivatives each.

    At low speed (``low_speed``) the lateral derivatives are by arc length, else by time.
    """

    longitudinal: Values
    lateral: Values
    low_speed: bool

    def as_mode(self, low_speed: bool) -> "CurvilinearState":
        """The same state with the lateral derivatives of the other mode (chain rule)."""
        if low_speed == self.low_speed:
            return self
        _, speed, acceleration = self.longitudinal
        offset, first, second = self.lateral
        if not low_speed:
            lateral = [offset, first * speed, second * speed**2 + first * acceleration]
        elif speed > 1e-3:
            slope = first / speed
            lateral = [offset, slope, (second - slope * acceleration) / speed**2]
        else:
            lateral = [offset, 0.0, 0.0]
        return CurvilinearState(self.longitudinal, np.array(lateral), low_speed)


@dataclass(frozen=True)
class EndState:
    """Where a candidate ends: after ``duration_s``, at ``speed_mps`` along the path and ``offset_m`` beside it."""

    duration_s: float
    speed_mps: float
    offset_m: float


def sampling_matrix(
    state: CurvilinearState,
    speed_mps: float,
    settings: SamplingSettings,
    vehicle: VehicleParameters,
    going_on: EndState | None = None,
) -> Points:
    """All combinations as the core's matrix, shape (n, 13).

    Columns: t0, t1, s0, s0', s0'', s1', s1'', d0, d0', d0'', d1, d1', d1''.
    About 800 rows: the present speed and offset and the whole horizon are among the end states, and ``going_on``, the
    rest of the plan that is being driven. Without it a plan that stops just in time is lost by replanning, because
    every new candidate takes at least ``shortest_s``.
    """
    durations = np.arange(settings.shortest_s, settings.horizon_s + 1e-9, settings.duration_step_s)
    durations = np.unique(np.round(np.append(durations, settings.horizon_s), 6))
    low = max(0.001, speed_mps - vehicle.maximum_acceleration_mps2 * settings.horizon_s)
    reach = speed_mps + vehicle.maximum_acceleration_mps2 / 6.0 * settings.horizon_s
    high = max(min(reach, SPEED_LIMIT_MPS, vehicle.maximum_speed_mps), low)
    speeds = np.unique(np.append(np.linspace(low, high, settings.values), state.longitudinal[1]))
    offsets = np.linspace(-settings.lateral_m, settings.lateral_m, settings.values)
    offsets = np.unique(np.append(offsets, state.lateral[0]))
    t1, v1, d1 = (axis.ravel() for axis in np.meshgrid(durations, speeds, offsets, indexing="ij"))
    if going_on is not None and going_on.duration_s >= SHORTEST_REST_S:
        t1, v1, d1 = (
            np.append(t1, going_on.duration_s),
            np.append(v1, going_on.speed_mps),
            np.append(d1, going_on.offset_m),
        )
    matrix = np.zeros((len(t1), 13))
    matrix[:, 1], matrix[:, FINAL_SPEED], matrix[:, 10] = t1, v1, d1
    matrix[:, 2:5], matrix[:, 7:10] = state.longitudinal, state.lateral
    return matrix
