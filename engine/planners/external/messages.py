"""Converts the input of a planner into messages of the stepwise protocol."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ....schemas.stepwise import GoalMessage, LaneletMessage, Line, StartMessage, StepMessage
from ...geometry import Points, Values
from ...network import posted_speeds
from ...vehicles import parameter_values
from ..driving.route_place import RoutePlaces
from ..goal import Goal
from ..interface import EgoState, Observation, PlanningTask, PredictedObstacle
from ..prediction import SENSOR_RADIUS_M

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import Lanelet
    from commonroad.scenario.traffic_light import TrafficLight

_DIGITS = 4
"""Positions of others are sent to 0.1 mm, the precision of stored reactive traffic."""


def numbers_of(values: Mapping[str, Any]) -> dict[str, float]:
    """Return the values that are finite numbers, by name."""
    numbers = {name: value for name, value in values.items() if isinstance(value, int | float)}
    return {name: float(value) for name, value in numbers.items() if math.isfinite(value)}


def start_message(task: PlanningTask, planner: str, scenario_id: str) -> StartMessage:
    """Return the message that starts a run."""
    settings, ego = task.configuration.settings, EgoState.of(task.problem.initial_state)
    return StartMessage(
        scenario_id=scenario_id,
        problem_id=int(task.problem.planning_problem_id),
        planner=planner,
        config_id=task.configuration.config_id,
        weights=task.configuration.weights,
        settings=numbers_of(settings.stated_values),
        vehicle=numbers_of(parameter_values(task.vehicle)),
        ego_class=task.vehicle.vehicle_class,
        friction=task.vehicle.friction,
        step_s=task.step_s,
        first_step=ego.step,
        last_step=Goal(task.problem.goal).last_step,
        replan_steps=settings.replan_steps,
        horizon_steps=round(settings.horizon_s / task.step_s),
        goals=tuple(_goals(task)),
        reference=_line(task.reference.points),
        route=tuple(int(key) for key in task.reference.lanelets),
        lanelets=tuple(_lanelets(task)),
    )


@dataclass(frozen=True)
class _Signal:
    """A traffic light of the route, and the station of its lanelet's end on the reference path."""

    light: "TrafficLight"
    lanelet_id: int
    station_m: float

    def at(self, step: int, ego_station_m: float) -> dict[str, object]:
        """Return the fields of ``SignalMessage`` at a step."""
        return {
            "id": int(self.light.traffic_light_id),
            "lanelet": self.lanelet_id,
            "state": str(self.light.get_state_at_time_step(step).value),
            "ahead_m": round(self.station_m - ego_station_m, _DIGITS),
        }


class StepMessages:
    """The messages of the planning steps of one run."""

    def __init__(self, task: PlanningTask) -> None:
        self._first_step, self._step_s = EgoState.of(task.problem.initial_state).step, task.step_s
        self._places = RoutePlaces(task)
        self._signals = _signals(task)

    def at(self, observation: Observation) -> StepMessage:
        """Return the message for one step."""
        ego = observation.ego
        place = self._places.at(ego)
        return StepMessage.model_validate(
            {
                "step": ego.step,
                "time_s": round((ego.step - self._first_step) * self._step_s, 9),
                "ego": {
                    "x_m": float(ego.position[0]),
                    "y_m": float(ego.position[1]),
                    "heading_rad": ego.heading_rad,
                    "speed_mps": ego.speed_mps,
                    "acceleration_mps2": ego.acceleration_mps2,
                    "yaw_rate_radps": ego.yaw_rate_radps,
                },
                "others": _others(observation.obstacles),
                "signals": [
                    one.at(ego.step, place.station_m) for one in self._signals if one.station_m >= place.station_m
                ],
                "route": vars(place),
            }
        )


def _rounded(values: Values) -> tuple[float, ...]:
    return tuple(np.round(values, _DIGITS).tolist())


def _others(obstacles: Sequence[PredictedObstacle]) -> list[dict[str, object]]:
    """Return the other road users at a step as fields of ``OtherMessage``.

    All numbers are rounded together, since numpy is slow for small arrays. The whole message is validated later.
    """
    seen = [one for one in obstacles if len(one.positions)]
    if not seen:
        return []
    places = np.concatenate([one.positions for one in seen]).round(_DIGITS)
    x_m, y_m = places[:, 0].tolist(), places[:, 1].tolist()
    headings_rad = np.concatenate([one.headings_rad for one in seen]).round(_DIGITS).tolist()
    messages, begin = list[dict[str, object]](), 0
    for one in seen:
        part = slice(begin, begin + len(one.positions))
        begin = part.stop
        length_m, width_m = one.observed_size_m or (one.length_m, one.width_m)
        heading_rad = headings_rad[part]
        if heading_rad.count(heading_rad[0]) == len(heading_rad):
            heading_rad = heading_rad[:1]
        matrices = one.covariance.tolist() if one.covariance.ndim > 2 else [one.covariance.tolist()]
        predicted = {
            "x_m": x_m[part],
            "y_m": y_m[part],
            "heading_rad": heading_rad,
            "covariance_m2": [(xx, xy, yy) for (xx, xy), (_, yy) in matrices[: len(one.positions)]],
            "length_m": one.length_m,
            "width_m": one.width_m,
        }
        messages.append(
            {
                "id": one.obstacle_id,
                "kind": one.kind,
                "x_m": x_m[part.start],
                "y_m": y_m[part.start],
                "heading_rad": heading_rad[0],
                "speed_mps": round(one.speed_mps, _DIGITS),
                "length_m": length_m,
                "width_m": width_m,
                "predicted": predicted,
            }
        )
    return messages


def _line(points: Points) -> Line:
    return Line(x_m=_rounded(np.asarray(points)[:, 0]), y_m=_rounded(np.asarray(points)[:, 1]))


def _goals(task: PlanningTask) -> list[GoalMessage]:
    """Return the goal states, starting with those to which the reference path leads."""
    from commonroad.planning.goal import GoalRegion

    ahead = task.goal_ahead
    first = {id(state) for state in ahead.state_list}
    others = [state for state in task.problem.goal.state_list if id(state) not in first]
    return [_goal_state(Goal(GoalRegion([state]))) for state in (*ahead.state_list, *others)]


def _goal_state(goal: Goal) -> GoalMessage:
    (state,) = goal.states
    parts = [] if state.area is None else getattr(state.area, "geoms", [state.area])
    outlines = [_line(np.array(part.exterior.coords)) for part in parts if part.geom_type == "Polygon"]
    return GoalMessage(
        first_step=state.first,
        last_step=state.last,
        areas=None if state.area is None else tuple(outlines),
        heading_rad=state.headings_rad,
        speed_mps=state.speeds_mps,
    )


def _lanelets(task: PlanningTask) -> list[LaneletMessage]:
    """Return the lanelets within the sensor radius around the reference path, in order of id."""
    import shapely

    around = shapely.LineString(task.reference.points).simplify(1.0).buffer(SENSOR_RADIUS_M)
    shapely.prepare(around)
    limits_mps = posted_speeds(task.network)
    near = [one for one in task.network.lanelets if shapely.intersects(around, shapely.LineString(one.center_vertices))]
    return [_lanelet(one, limits_mps.get(int(one.lanelet_id))) for one in sorted(near, key=lambda one: one.lanelet_id)]


def _lanelet(lanelet: "Lanelet", limit_mps: float | None) -> LaneletMessage:
    return LaneletMessage(
        id=int(lanelet.lanelet_id),
        left=_line(lanelet.left_vertices),
        right=_line(lanelet.right_vertices),
        successors=tuple(sorted(int(key) for key in lanelet.successor)),
        left_neighbour=lanelet.adj_left,
        left_same_direction=bool(lanelet.adj_left_same_direction),
        right_neighbour=lanelet.adj_right,
        right_same_direction=bool(lanelet.adj_right_same_direction),
        speed_limit_mps=limit_mps,
        signals=tuple(sorted(int(key) for key in lanelet.traffic_lights or ())),
    )


def _signals(task: PlanningTask) -> list[_Signal]:
    """Return the working traffic lights at the ends of the route's lanelets, in driving order."""
    found = []
    for key, end_m in zip(task.reference.lanelets, task.reference.lanelet_ends_m(task.network), strict=True):
        lanelet = task.network.find_lanelet_by_id(key)
        lights = [task.network.find_traffic_light_by_id(light) for light in sorted(lanelet.traffic_lights or ())]
        working = [one for one in lights if one is not None and one.traffic_light_cycle is not None]
        if working:
            found += [_Signal(light, int(key), float(end_m)) for light in working]
    return found
