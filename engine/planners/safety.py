"""Whether a trajectory stays clear of the predicted obstacles and on the road."""

from typing import TYPE_CHECKING, Literal

from plannerforge.engine.planners.interface import Observation, PlannedTrajectory, PlanningTask
from plannerforge.engine.planners.traffic import rectangle

if TYPE_CHECKING:
    from commonroad_dc import pycrcc

Objection = Literal["collision", "road_edge"]


class SafetyCheck:
    """The checks of one planning step; the present state (index 0) is not judged, since no plan can change it."""

    def __init__(self, task: PlanningTask, observation: Observation) -> None:
        from commonroad_dc import pycrcc

        self._pycrcc = pycrcc
        self._vehicle = task.vehicle
        self._road = task.road
        self._others = pycrcc.CollisionChecker()
        for obstacle in observation.obstacles:
            if len(obstacle.positions) < 2:
                continue
            body = pycrcc.TimeVariantCollisionObject(1)
            half_length, half_width = obstacle.length_m / 2, obstacle.width_m / 2
            for (x, y), heading in zip(
                obstacle.positions[1:].tolist(), obstacle.headings_rad[1:].tolist(), strict=True
            ):
                body.append_obstacle(pycrcc.RectOBB(half_length, half_width, heading, x, y))
            self._others.add_collision_object(body)
        self._on_edge_now = self._road.touches_edge(rectangle(observation.ego, task.vehicle))

    def objection(self, trajectory: PlannedTrajectory) -> Objection | None:
        """What speaks against a trajectory, or None.

        An ego that touches the edge of the road now is only asked to stay clear of it once it has left it.
        """
        rectangles = self._rectangles(trajectory)
        if self._others.collide(self._motion(rectangles)):
            return "collision"
        if self._on_edge_now:
            clear = (i for i, body in enumerate(rectangles) if not self._road.touches_edge(body))
            rectangles = rectangles[next(clear, len(rectangles)) :]
        if rectangles and self._road.touches_edge(self._motion(rectangles)):
            return "road_edge"
        return None

    def _rectangles(self, trajectory: PlannedTrajectory) -> list["pycrcc.RectOBB"]:
        half_length, half_width = self._vehicle.length_m / 2, self._vehicle.width_m / 2
        states = zip(trajectory.positions[1:].tolist(), trajectory.headings_rad[1:].tolist(), strict=True)
        return [self._pycrcc.RectOBB(half_length, half_width, heading, x, y) for (x, y), heading in states]

    def _motion(self, rectangles: list["pycrcc.RectOBB"]) -> "pycrcc.TimeVariantCollisionObject":
        motion = self._pycrcc.TimeVariantCollisionObject(1)
        for body in rectangles:
            motion.append_obstacle(body)
        return motion
