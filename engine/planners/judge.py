"""Decides when and how a run ends, independently of the planner.

A run ends when the ego collides, leaves the road, meets the goal, has passed it, or is out of time. It ends as
``invalid`` before the first plan if no planner can solve the problem. Each verdict has one sentence with figures.
"""

from dataclasses import dataclass
from math import ceil, degrees, pi

from ...schemas.runs import CollisionRecord, InvalidReason, Outcome
from ..geometry import point_at, wrap_angle
from .goal import PASSED_M, Goal, Timing, out_of_reach
from .interface import EgoState, PlanningTask
from .traffic.recorded import Traffic, rectangle

_TIME_LIMIT_FACTOR = 1.7
"""Largest multiple of the steps from the start to the goal's last step, as in the Frenetix reference."""
_MOST_STEPS = 2000
"""Most steps of a run, whatever the goal's time (chosen)."""


_OBSTACLES_NAMED = 3
"""Largest number of obstacles at the ego's start that a verdict names (as a description's checks)."""


@dataclass(frozen=True)
class Verdict:
    """The end of a run, with one sentence of figures; ``invalid_reason`` is set only if the problem is invalid."""

    outcome: Outcome
    reason: str
    collision: CollisionRecord | None = None
    invalid_reason: InvalidReason | None = None

    @classmethod
    def invalid(cls, code: InvalidReason, reason: str) -> "Verdict":
        """Return the verdict on a problem that no planner can solve."""
        return cls("invalid", reason, invalid_reason=code)


class Judge:
    """Judges every driven state against the road, the other road users, the goal and the time limit."""

    def __init__(self, task: PlanningTask, traffic: Traffic, initial: EgoState) -> None:
        region = task.problem.goal
        self._goal = goal = task.made.get(("goal", id(region)), lambda: Goal(region), region)
        self._reference, self._road, self._traffic = task.reference, task.road, traffic
        self._vehicle, self._step_s = task.vehicle, task.step_s
        self._first_step = initial.step
        steps = max(goal.last_step - initial.step, 1)
        self.last_step = initial.step + min(ceil(_TIME_LIMIT_FACTOR * steps), _MOST_STEPS)
        self._follower = task.reference.follower()
        start_m = self._follower.place(initial.position)[0]
        stations = None
        if goal.has_position:
            stations = task.made.get(
                ("stations of the goal", id(region), start_m),
                lambda: goal.stations_on(task.reference.points, start_m),
                region,
            )
        self._goal_end_m = None if stations is None else stations[1]
        self._was_clear_of_edge = not task.road.touches_edge(rectangle(initial, task.vehicle))
        self._stays: set[Timing] = set()  # the timings of the ego's steps in the goal's area
        self._last_stay: EgoState | None = None

    def before_the_run(self, initial: EgoState) -> Verdict | None:
        """Return the verdict if no planner can solve the problem, otherwise None."""
        hits = [f"{key} ({kind})" for key, kind in self._traffic.hits(initial, self._vehicle)]
        if hits:
            more = f" and {len(hits) - _OBSTACLES_NAMED} more" if len(hits) > _OBSTACLES_NAMED else ""
            named = ", ".join(hits[:_OBSTACLES_NAMED])
            return Verdict.invalid("initial_collision", f"the ego overlaps obstacle {named}{more} in its initial state")
        if not self._road.holds(initial.position):
            return Verdict.invalid("ego_off_road", "the ego starts off the road")
        turned_rad = self._off_route_rad(initial)
        if turned_rad > pi / 2:
            turned = (
                f"the ego heads {degrees(turned_rad):.0f}° off the route to its goal, and no vehicle drives backwards"
            )
            return Verdict.invalid("ego_against_route", turned)
        too_far = out_of_reach(self._goal, initial, self._vehicle, self._step_s)
        return Verdict.invalid("goal_out_of_time", too_far) if too_far else None

    def _off_route_rad(self, ego: EgoState) -> float:
        """Return the angle between the ego's heading and the reference path next to it."""
        station_m = self._follower.place(ego.position)[0]
        return abs(wrap_angle(ego.heading_rad - point_at(self._reference.points, station_m)[1]))

    def after_step(self, ego: EgoState) -> Verdict | None:
        """Return the verdict if this state ends the run."""
        return self._collision(ego) or self._off_road(ego) or self._at_goal(ego) or self._out_of_time(ego)

    def _collision(self, ego: EgoState) -> Verdict | None:
        hit = next(iter(self._traffic.hits(ego, self._vehicle)), None)
        if hit is None:
            return None
        time_s = self._since_start_s(ego.step)
        record = CollisionRecord(obstacle_id=hit[0], kind=hit[1], step=ego.step, time_s=time_s)
        reason = f"collided with obstacle {hit[0]} ({hit[1]}) at {time_s:.1f} s, driving {ego.speed_mps:.1f} m/s"
        return Verdict("collision", reason, record)

    def _off_road(self, ego: EgoState) -> Verdict | None:
        touches = self._road.touches_edge(rectangle(ego, self._vehicle))
        leaves = touches if self._was_clear_of_edge else not self._road.holds(ego.position)
        self._was_clear_of_edge = self._was_clear_of_edge or not touches
        if not leaves:
            return None
        time_s = self._since_start_s(ego.step)
        record = CollisionRecord(obstacle_id=None, kind="road_boundary", step=ego.step, time_s=time_s)
        reason = f"left the road at {time_s:.1f} s, driving {ego.speed_mps:.1f} m/s"
        return Verdict("off_road", reason, record)

    def _at_goal(self, ego: EgoState) -> Verdict | None:
        stands = self._goal.status(ego)
        if any(status.reached for status in stands):
            return Verdict(
                "goal_reached", f"reached the goal at {self._since_start_s(ego.step):.1f} s (step {ego.step})"
            )
        timings = {status.timing for status in stands if status.position}
        self._stays |= timings
        self._last_stay = ego if timings else self._last_stay
        for status, state in zip(stands, self._goal.states, strict=True):
            if status.all_but_time and ego.step > self._goal.last_step:
                late_s = (ego.step - state.last) * self._step_s
                reason = f"met the goal's conditions at {self._since_start_s(ego.step):.1f} s, {late_s:.1f} s too late"
                return Verdict("goal_late", reason)
        return self._beyond_goal(ego) if self._goal.has_position else self._too_late_anywhere(ego)

    def _too_late_anywhere(self, ego: EgoState) -> Verdict | None:
        """Return the verdict on a goal that has no position, if its conditions were not met by its last step."""
        if ego.step <= self._goal.last_step:
            return None
        over_s = self._since_start_s(self._goal.last_step)
        reason = f"the goal's time ended at {over_s:.1f} s with its conditions unmet, at {ego.speed_mps:.1f} m/s"
        return Verdict("goal_missed", reason)

    def _beyond_goal(self, ego: EgoState) -> Verdict | None:
        """Return the verdict if the ego has passed a goal with a position, or is beyond it when its time is over."""
        if self._goal_end_m is None:
            return None
        beyond_m = self._beyond_m(ego)
        time_over = ego.step > self._goal.last_step
        if not (beyond_m > PASSED_M or (time_over and self._stays and beyond_m > 0)):
            return None
        if not self._stays:
            reason = f"passed the goal region by {self._since_start_s(ego.step):.1f} s without entering it"
            return Verdict("goal_missed", reason) if time_over else None
        first_s, last_s = (self._since_start_s(step) for step in (self._goal.first_step, self._goal.last_step))
        left = self._last_stay or ego
        reason = (
            f"drove out of the goal region at {self._since_start_s(left.step):.1f} s, at {left.speed_mps:.1f} m/s; "
            f"its time is {first_s:.1f} to {last_s:.1f} s"
        )
        return Verdict(self._outcome_of_stays(), reason)

    def _out_of_time(self, ego: EgoState) -> Verdict | None:
        if ego.step < self.last_step:
            return None
        cause = f"{_TIME_LIMIT_FACTOR} times the time allowed for the goal"
        if ego.step - self._first_step >= _MOST_STEPS:
            cause = f"the limit of {_MOST_STEPS} steps per run"
        limit = f"{self._since_start_s(ego.step):.1f} s ({cause})"
        if self._stays:
            reason = f"was in the goal region but never met all its conditions within {limit}"
            return Verdict(self._outcome_of_stays(), reason)
        left = ""
        if self._goal_end_m is not None and self._beyond_m(ego) < 0:
            here_m = self._follower.place(ego.position)[0]
            left = f", {self._reference.way_m(here_m, self._goal_end_m):.1f} m short of the goal region's end"
        return Verdict("timeout", f"ran out of time after {limit}{left}")

    def _outcome_of_stays(self) -> Outcome:
        """Return the outcome for an ego that was in the goal's area but did not reach the goal.

        Within the goal's time, the speed or heading was wrong; otherwise only the time was wrong, and the last stay
        counts.
        """
        if "in_time" in self._stays:
            return "goal_missed"
        return "goal_late" if "late" in self._stays else "goal_early"

    def _beyond_m(self, ego: EgoState) -> float:
        """Return the distance in m of the ego beyond the end of the goal, along the reference path."""
        return self._follower.place(ego.position)[0] - float(self._goal_end_m or 0.0)

    def _since_start_s(self, step: int) -> float:
        return round((step - self._first_step) * self._step_s, 9)
