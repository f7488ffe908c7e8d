"""Figures of a driven trajectory: progress, comfort, nearness to others."""

import numpy as np

from plannerforge.engine.geometry.polyline import Values, oriented_rectangle, wrap_angles
from plannerforge.engine.planners.interface import EgoState
from plannerforge.engine.planners.time_to_collision import MovingRectangle, time_to_collision_s
from plannerforge.engine.planners.traffic import RecordedTraffic
from plannerforge.engine.planners.vehicle import VehicleParameters
from plannerforge.engine.scenarios.tracks import Track
from plannerforge.schemas.runs import RunMetrics

NEAR_M = 60.0


def run_metrics(
    states: list[EgoState],
    traffic: RecordedTraffic,
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
    gaps, collision_times = _nearness(states, traffic, vehicle)
    return RunMetrics(
        duration_s=round(duration, 9),
        distance_m=distance,
        mean_speed_mps=distance / duration if duration else float(speeds[0]),
        minimum_distance_m=min(gaps, default=None),
        minimum_time_to_collision_s=min(collision_times, default=None),
        maximum_jerk_mps3=float(np.abs(jerk).max()) if len(jerk) else 0.0,
        mean_squared_jerk=float((jerk**2).mean()) if len(jerk) else 0.0,
        maximum_lateral_acceleration_mps2=float(lateral.max()) if len(lateral) else 0.0,
        mean_total_cost=float(np.mean(total_costs)) if total_costs else None,
    )


def _nearness(
    states: list[EgoState], traffic: RecordedTraffic, vehicle: VehicleParameters
) -> tuple[list[float], list[float]]:
    """For every step the smallest gap between rectangles, and all times to collision."""
    import shapely

    gaps: list[float] = []
    times: list[float] = []
    for ego in states:
        present = [(track, index) for track in traffic.moving if (index := track.index_at(ego.step)) is not None]
        present += [(track, 0) for track in traffic.standing]
        close = [(t, i) for t, i in present if float(np.hypot(*(t.positions[i] - ego.position))) < NEAR_M]
        if not close:
            continue
        own = shapely.Polygon(oriented_rectangle(ego.position, ego.heading_rad, (vehicle.length_m, vehicle.width_m)))
        others = shapely.polygons(
            [oriented_rectangle(t.positions[i], float(t.headings_rad[i]), (t.length_m, t.width_m)) for t, i in close]
        )
        gaps.append(float(shapely.distance(own, others).min()))
        ego_body = MovingRectangle(ego.position, ego.heading_rad, (vehicle.length_m, vehicle.width_m), ego.speed_mps)
        found = (time_to_collision_s(ego_body, _body(track, index)) for track, index in close)
        times += [time for time in found if time is not None]
    return gaps, times


def _body(track: Track, index: int) -> MovingRectangle:
    return MovingRectangle(
        center=track.positions[index],
        heading_rad=float(track.headings_rad[index]),
        size_m=(track.length_m, track.width_m),
        speed_mps=float(track.speeds_mps[index]),
    )
