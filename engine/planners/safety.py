"""Checks whether a trajectory is safe: clear of the predicted road users, and of the edge of the road.

The check uses the motion with which the vehicle follows the trajectory (``driving/following.py``).
"""

from typing import TYPE_CHECKING, Literal

from .driving.following import FollowedPlan, follow
from .interface import Observation, PlannedTrajectory, PlanningTask, PredictedObstacle
from .traffic.recorded import rectangle

if TYPE_CHECKING:
    from commonroad_dc import pycrcc


Objection = Literal["collision", "road_edge", "friction", "steering_rate"]


class SafetyCheck:
    """The checks of one planning step; the present state (index 0) is not checked, since no plan can change it."""

    def __init__(self, task: PlanningTask, observation: Observation) -> None:
        from commonroad_dc import pycrcc

        self._vehicle, self._road = task.vehicle, task.road
        self._ego, self._step_s = observation.ego, task.step_s
        self._others = pycrcc.CollisionChecker()
        for obstacle in observation.obstacles:
            if len(obstacle.positions) > 1:
                bodies = _rectangles(obstacle, obstacle.length_m, obstacle.width_m)
                self._others.add_collision_object(_motion(bodies))
        self._on_edge_now = self._road.touches_edge(rectangle(observation.ego, task.vehicle))

    def followed(
        self, trajectory: PlannedTrajectory, most_m: float, counted: int | None = None, *, is_safe: bool = False
    ) -> "FollowedPlan | Objection":
        """Return the motion with which the vehicle follows a trajectory, or the reason for refusing it.

        ``counted``: the number of initial states that must be safe; None means all. ``is_safe``: True if the planner's
        core has already checked the trajectory, so that only the motion that follows it is checked here.

        The reason is ``steering_rate`` if the wheels turn too slowly to stay within ``most_m`` of it, and ``friction``
        if tyres or engine do not allow its accelerations.
        """
        refused = None if is_safe else self.objection(trajectory if counted is None else trajectory.until(counted))
        if refused is not None:
            return refused
        followed = follow(trajectory, self._ego, self._vehicle, self._step_s)
        if not followed.within_tyres:
            return "friction"
        if followed.deviation_m > most_m:
            return "steering_rate"
        driven = followed.trajectory if counted is None else followed.trajectory.until(counted)
        return self.objection(driven) or followed

    def objection(self, trajectory: PlannedTrajectory) -> Literal["collision", "road_edge"] | None:
        """Return why a trajectory is not safe, or None.

        An ego that touches the edge of the road at present must stay clear of it only after it has left it.
        """
        rectangles = _rectangles(trajectory, self._vehicle.length_m, self._vehicle.width_m)
        if self._others.collide(_motion(rectangles)):
            return "collision"
        if self._on_edge_now:
            clear = (i for i, body in enumerate(rectangles) if not self._road.touches_edge(body))
            rectangles = rectangles[next(clear, len(rectangles)) :]
        if rectangles and self._road.touches_edge(_motion(rectangles)):
            return "road_edge"
        return None


def _rectangles(
    driven: PlannedTrajectory | PredictedObstacle, length_m: float, width_m: float
) -> list["pycrcc.RectOBB"]:
    """Return the body at each step but the present step."""
    from commonroad_dc import pycrcc

    states = zip(driven.positions[1:].tolist(), driven.headings_rad[1:].tolist(), strict=True)
    return [pycrcc.RectOBB(length_m / 2, width_m / 2, heading, x, y) for (x, y), heading in states]


def _motion(rectangles: list["pycrcc.RectOBB"]) -> "pycrcc.TimeVariantCollisionObject":
    from commonroad_dc import pycrcc

    motion = pycrcc.TimeVariantCollisionObject(1)
    for body in rectangles:
        motion.append_obstacle(body)
    return motion
