"""Figures of a driven trajectory: progress, comfort, nearness to others."""

import numpy as np

from plannerforge.engine.geometry.polyline import Values, wrap_angles
from plannerforge.engine.planners.criticality import criticality
from plannerforge.engine.planners.interface import EgoState
from plannerforge.engine.planners.traffic import Traffic
from plannerforge.engine.planners.vehicle import VehicleParameters
from plannerforge.engine.scenarios.tracks import Track
from plannerforge.schemas.runs import RunMetrics


def run_metrics(
    states: list[EgoState],
    traffic: Traffic,
    vehicle: VehicleParameters,
    step_s: float,
    total_costs: list[float],
) -> RunMetrics:
    """The metrics of a run over its driven states (the initial one included)."""
    positions = np.array([state.position for state in states])
    speeds = np.array([state.speed_mps for state in states])
    accelerations = np.array([state.acceleration_mps2 for state in states])
    turn = wrap_angles(np.diff([state.heading_rad for state in states]))
    jerk: Values = np.diff(accelerations[1:]) / step_s  # the recorded initial acceleration is not the planner's doing
    lateral = np.abs(speeds[1:] * turn / step_s)
    duration = (len(states) - 1) * step_s
    distance = float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())
    nearness = criticality(_ego_track(states, vehicle), traffic)
    return RunMetrics(
        duration_s=round(duration, 9),
        distance_m=distance,
        mean_speed_mps=distance / duration if duration else float(speeds[0]),
        minimum_distance_m=nearness.minimum_distance_m,
        minimum_time_to_collision_s=nearness.minimum_time_to_collision_s,
        minimum_time_headway_s=nearness.minimum_time_headway_s,
        risk_score=nearness.risk_score,
        maximum_jerk_mps3=float(np.abs(jerk).max()) if len(jerk) else 0.0,
        mean_squared_jerk=float((jerk**2).mean()) if len(jerk) else 0.0,
        maximum_lateral_acceleration_mps2=float(lateral.max()) if len(lateral) else 0.0,
        mean_total_cost=float(np.mean(total_costs)) if total_costs else None,
    )


def _ego_track(states: list[EgoState], vehicle: VehicleParameters) -> Track:
    """The driven states as a track with the ego's size; its id is of no obstacle."""
    return Track(
        obstacle_id=-1,
        kind="car",
        length_m=vehicle.length_m,
        width_m=vehicle.width_m,
        first_step=states[0].step,
        positions=np.array([state.position for state in states]),
        headings_rad=np.array([state.heading_rad for state in states]),
        speeds_mps=np.array([state.speed_mps for state in states]),
    )
