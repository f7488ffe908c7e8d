"""What a configuration holds beside its weights: the ego vehicle, the horizon, the replanning rate, the sampling."""

from plannerforge.schemas.base import Model


class PlannerSettings(Model):
    """Settings of a run; ranges and meanings are in ``engine/tuning/settings.py``.

    ``vehicle``: CommonRoad's vehicle 1 to 4; a parameter of it that is None here is that vehicle's own. Lengths in m,
    speeds in m/s, accelerations in m/s², angles in rad. The plan is renewed every ``replan_steps`` time steps of the
    scenario.
    """

    vehicle: int = 2
    length_m: float | None = None
    width_m: float | None = None
    wheelbase_m: float | None = None
    rear_axle_behind_center_m: float | None = None
    maximum_acceleration_mps2: float | None = None
    maximum_speed_mps: float | None = None
    switching_speed_mps: float | None = None
    maximum_steering_rad: float | None = None
    maximum_steering_rate_radps: float | None = None
    horizon_s: float = 3.0
    replan_steps: int = 3
    sampling_level: int = 2
