"""When a run ends and how: the judge of the loop, apart from the planner."""

from dataclasses import dataclass
from math import ceil

from plannerforge.engine.geometry.polyline import project
from plannerforge.engine.planners.goal import Goal
from plannerforge.engine.planners.interface import EgoState
from plannerforge.engine.planners.reference_path import ReferencePath
from plannerforge.engine.planners.road import Road
from plannerforge.engine.planners.traffic import RecordedTraffic, rectangle
from plannerforge.engine.planners.vehicle import VehicleParameters
from plannerforge.schemas.runs import CollisionRecord, Outcome

TIME_LIMIT_FACTOR = 1.7
"""A run may take so many times the steps from its start to the goal's last step, as in the Frenetix reference."""
MOST_STEPS = 2000
PASSED_M = 5.0


@dataclass(frozen=True)
class Verdict:
    """How a run ended, with one sentence of figures."""

    outcome: Outcome
    reason: str
    collision: CollisionRecord | None = None


class Judge:
    """Looks at every driven state; knows the road, the others, the goal and the time limit."""

    def __init__(
        self,
        goal: Goal,
        reference: ReferencePath,
        road: Road,
        traffic: RecordedTraffic,
        vehicle: VehicleParameters,
        initial: EgoState,
        step_s: float,
    ) -> None:
        self._goal, self._reference, self._road = goal, reference, road
        self._traffic, self._vehicle, self._step_s = traffic, vehicle, step_s
        self._first_step = initial.step
        steps = max(goal.last_step - initial.step, 1)
        self.last_step = initial.step + min(ceil(TIME_LIMIT_FACTOR * steps), MOST_STEPS)
        stations = goal.stations_on(reference.points) if goal.has_position else None
        self._goal_end_m = None if stations is None else stations[1]
        self._was_clear_of_edge = not road.touches_edge(rectangle(initial, vehicle))
        self._was_in_goal = False

    def before_the_run(self, initial: EgoState) -> Verdict | None:
        """Why the problem cannot be attempted, or None."""
        hit = self._traffic.hit_by(initial, self._vehicle)
        if hit:
            return Verdict("invalid", f"the ego overlaps obstacle {hit[0]} ({hit[1]}) in its initial state")
        if not self._road.holds(initial.position):
            return Verdict("invalid", "the ego starts off the road")
        return None

    def after_step(self, ego: EgoState) -> Verdict | None:
        """The verdict if this state ends the run."""
        return self._collision(ego) or self._off_road(ego) or self._at_goal(ego) or self._out_of_time(ego)

    def _collision(self, ego: EgoState) -> Verdict | None:
        hit = self._traffic.hit_by(ego, self._vehicle)
        if hit is None:
            return None
        time_s = self._time_s(ego)
        record = CollisionRecord(obstacle_id=hit[0], kind=hit[1], step=ego.step, time_s=time_s)
        reason = f"collided with obstacle {hit[0]} ({hit[1]}) at {time_s:.1f} s, driving {ego.speed_mps:.1f} m/s"
        return Verdict("collision", reason, record)

    def _off_road(self, ego: EgoState) -> Verdict | None:
        touches = self._road.touches_edge(rectangle(ego, self._vehicle))
        leaves = touches if self._was_clear_of_edge else not self._road.holds(ego.position)
        self._was_clear_of_edge = self._was_clear_of_edge or not touches
        if not leaves:
            return None
        time_s = self._time_s(ego)
        record = CollisionRecord(obstacle_id=None, kind="road_boundary", step=ego.step, time_s=time_s)
        reason = f"left the road at {time_s:.1f} s, driving {ego.speed_mps:.1f} m/s"
        return Verdict("off_road", reason, record)

    def _at_goal(self, ego: EgoState) -> Verdict | None:
        states = self._goal.status(ego)
        if any(status.reached for status in states):
            return Verdict("goal_reached", f"reached the goal at {self._time_s(ego):.1f} s (step {ego.step})")
        self._was_in_goal = self._was_in_goal or any(status.position for status in states)
        for status, window in zip(states, self._goal.windows, strict=True):
            if status.all_but_time and status.timing == "late" and ego.step > self._goal.last_step:
                late = ego.step - window.last
                return Verdict("goal_missed", f"came into the goal at step {ego.step}, {late} steps after its last")
        return self._beyond_goal(ego)

    def _beyond_goal(self, ego: EgoState) -> Verdict | None:
        if not self._goal.has_position:
            if ego.step <= self._goal.last_step:
                return None
            reason = (
                f"the goal's last step {self._goal.last_step} passed at {ego.speed_mps:.1f} m/s without its conditions"
            )
            return Verdict("goal_missed", reason)
        if self._goal_end_m is None or not self._was_in_goal:
            return None
        station = project(self._reference.points, ego.position)[0]
        too_late = ego.step > self._goal.last_step and station > self._goal_end_m
        if station <= self._goal_end_m + PASSED_M and not too_late:
            return None
        window = f"{self._goal.first_step} to {self._goal.last_step}"
        reason = (
            f"drove out of the goal region by step {ego.step} at {ego.speed_mps:.1f} m/s; its time is step {window}"
        )
        return Verdict("goal_missed", reason)

    def _out_of_time(self, ego: EgoState) -> Verdict | None:
        if ego.step < self.last_step:
            return None
        left = ""
        if self._goal_end_m is not None:
            away = self._goal_end_m - project(self._reference.points, ego.position)[0]
            left = f", {max(away, 0.0):.0f} m before the goal's end" if away > 0 else ""
        limit = f"{self._time_s(ego):.1f} s ({TIME_LIMIT_FACTOR} × the goal's last step)"
        if self._was_in_goal:
            return Verdict("goal_missed", f"was in the goal region but never met all its conditions within {limit}")
        return Verdict("timeout", f"ran out of time after {limit}{left}")

    def _time_s(self, ego: EgoState) -> float:
        return round((ego.step - self._first_step) * self._step_s, 9)
