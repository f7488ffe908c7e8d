"""SUMO in this process: simulations, their vehicles, and the state of vehicles and lanes.

The only module of the engine that calls libsumo. Generation, edits and reactive traffic drive their simulations through
:class:`Sumo`. libsumo keeps its state in the process: one simulation runs at a time.

This module hides libsumo's calls and bit masks for drivers, SUMO's options and the XML of vehicle types. SUMO states
the position of the front bumper and measures angles in degrees clockwise from north; everything else here is in m, s,
m/s and radians counterclockwise from east, as in CommonRoad.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from enum import IntEnum
from importlib.metadata import version
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

from ...schemas.errors import PlannerForgeError, WorkerFailure
from ...schemas.text import cited

LaneHint = tuple[str, int]
"""SUMO's edge and lane index; ("", -1) if the lane is unknown."""
NO_LANE: LaneHint = ("", -1)

_MATCH_REACH_M = 8.0
"""Distance within which SUMO looks for a lane when a vehicle is moved; far enough for all that are next to the road."""
_ARRIVAL_REACH_M = 1.0
"""How near to the end of its route a standing vehicle may arrive (chosen; SUMO's own reach is 0.1 m)."""
_TURN_REACH_M = 0.01
"""How far the centre of a standing vehicle may move when SUMO turns it along its lane (chosen: no driver notices)."""
_KEEP_ROUTE, _KEEP_POSE = 1, 2
"""SUMO's keepRoute flags: 1 moves the vehicle to the nearest lane of its route, 2 leaves it exactly where it is put."""
_PLACED_SPEED_MODE = 32
"""SUMO's speed mode without any check, for vehicles that are placed by hand."""
_DRIVEN_SPEED_MODE = 31
"""SUMO's default speed mode, with all checks: gaps, power, brakes, right of way and lights."""
_HARD_BRAKING_SPEED_MODE = 27
"""SUMO's speed mode with all checks (gaps, power, right of way, lights) except the driver's own deceleration."""
_NO_LIMIT_SPEED_MODE = 95
"""SUMO's speed mode with all checks (gaps, power, brakes, right of way, lights) except the speed limit."""
_LIGHTS_AND_RIGHT_OF_WAY = 8 | 16
"""The bits of SUMO's speed modes for the right of way at junctions and for braking at red lights."""
_DRIVERS_CHOICE = -1
"""SUMO's value for a speed that the driver model chooses."""
_PASSING_MPS = "100"
"""The speed of a stop that is passed without stopping: above all driven speeds."""


class LaneChanges(IntEnum):
    """The lane changes that a vehicle performs: SUMO's modes, bit masks of reasons and respected constraints."""

    NONE = 0
    """Placed by hand."""
    DRIVERS_OWN = 1621
    """Those that SUMO's driver wants; an ordered change is obeyed if the driver's own gaps are kept."""
    INTO_ANY_ROOM = 1365
    """Those on an order, wherever no vehicle is in the way; the caller must check for room."""
    FOR_THE_ROUTE = 1537
    """Those that the route needs, if they are safe: for a vehicle that was sent to its lane."""


def sumo_version() -> str:
    """Return the installed version of SUMO."""
    return version("libsumo")


def sumo_angle_deg(heading_rad: float) -> float:
    """Return the angle for a heading in SUMO's convention: degrees clockwise from north, in [0, 360)."""
    return (90.0 - math.degrees(heading_rad)) % 360.0


def heading_of_angle_rad(angle_deg: float) -> float:
    """Return the heading in rad, in (-3π/2, π/2], for an angle in SUMO's degrees."""
    return math.radians(90.0 - angle_deg)


def sumo_pose(x_m: float, y_m: float, heading_rad: float, length_m: float) -> tuple[float, float, float]:
    """Return a vehicle's front bumper (x, y) and its angle in SUMO's degrees, from its centre and heading."""
    ahead_m = length_m / 2
    front = x_m + ahead_m * math.cos(heading_rad), y_m + ahead_m * math.sin(heading_rad)
    return *front, sumo_angle_deg(heading_rad)


def vehicle_type(type_id: str, **attributes: object) -> str:
    """Return a ``vType`` element; pass floats as formatted text."""
    named = {"id": type_id} | attributes
    return f"<vType {' '.join(f'{name}={quoteattr(str(value))}' for name, value in named.items())}/>"


def vehicle_type_distribution(type_id: str, vehicle_types: Iterable[str]) -> str:
    """Return a ``vTypeDistribution`` element: a vehicle of this type is one of the given types, with equal chances."""
    return f"<vTypeDistribution id={quoteattr(type_id)}>{''.join(vehicle_types)}</vTypeDistribution>"


@contextmanager
def sumo_running(
    net: Path,
    types_file: Path,
    vehicle_types: Iterable[str],
    *,
    step_s: float,
    seed: int,
    options: Mapping[str, object],
    refusal: Callable[[str], PlannerForgeError] = lambda why: WorkerFailure(f"SUMO did not start: {why}"),
) -> "Iterator[Sumo]":
    """Run a simulation that ends with the block; vehicles neither collide nor are teleported.

    Args:
        net: SUMO's network.
        types_file: the file to which the vehicle types for SUMO are written.
        vehicle_types: ``vType`` elements.
        step_s: duration of a step.
        seed: the seed of SUMO's random numbers.
        options: further options of SUMO by name, including ``--``.
        refusal: returns the error for a network, vehicle type or option that SUMO refuses, from its reason.

    Raises:
        PlannerForgeError: SUMO refuses one of these; ``refusal`` returns the error.
        WorkerFailure: SUMO stopped inside the block.
    """
    import libsumo

    types_file.write_text("\n".join(["<additional>", *vehicle_types, "</additional>\n"]))
    all_options = {
        "--net-file": net,
        "--additional-files": types_file,
        "--step-length": step_s,
        "--seed": seed,
        "--time-to-teleport": -1,
        "--collision.action": "none",
        **options,
    }
    arguments = [str(part) for option in all_options.items() for part in option]
    try:
        try:
            libsumo.start(["sumo", "--no-step-log", "--no-warnings", *arguments])
        except libsumo.TraCIException as error:
            raise refusal(str(error)) from error
        yield Sumo(libsumo)
    except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
        raise WorkerFailure(f"SUMO stopped: {cited(error)}") from error
    finally:
        libsumo.close()


class Sumo:
    """The running simulation. ``key`` is a vehicle's SUMO id, ``lane`` a lane's (``<edge>_<index>``)."""

    def __init__(self, libsumo: Any) -> None:
        self._libsumo = libsumo
        self._simulation, self._vehicle, self._lane = libsumo.simulation, libsumo.vehicle, libsumo.lane
        self._person = libsumo.person
        self._ignoring_lights: set[str] = set()

    # The simulation

    def step(self) -> None:
        """Simulate one step."""
        self._libsumo.simulationStep()

    def step_s(self) -> float:
        """Return the duration of a step."""
        return float(self._simulation.getDeltaT())

    def vehicles(self) -> tuple[str, ...]:
        """Return the vehicles on the network, ascending.

        A vehicle that was placed far from every lane is missing: SUMO drops it without an error.
        """
        return tuple(self._vehicle.getIDList())

    def arrived(self) -> tuple[str, ...]:
        """Return the vehicles that reached the end of their route in the last step."""
        return tuple(self._simulation.getArrivedIDList())

    # Vehicles come and go

    def add_route(self, route: str, edges: Sequence[str]) -> None:
        """Add a route."""
        self._libsumo.route.add(route, edges)

    def insert(self, key: str, route: str, vehicle_type: str) -> None:
        """Add a vehicle that is placed by hand before the next step."""
        self._vehicle.add(key, route, vehicle_type, depart="now", departLane="0", departPos="0")

    def insert_moving(self, key: str, route: str, vehicle_type: str, station_m: float | None = None) -> None:
        """Add a vehicle to its route's first edge, in the best lane and at the desired speed.

        Its front is ``station_m`` from the start of the edge; None means any free place.
        """
        place = "random_free" if station_m is None else f"{station_m:.2f}"
        self._vehicle.add(key, route, vehicle_type, departLane="best", departPos=place, departSpeed="desired")

    def remove(self, key: str) -> None:
        """Remove a vehicle, if it is still present."""
        if key in self._vehicle.getIDList():
            self._vehicle.remove(key)

    def withdraw(self, key: str) -> None:
        """Withdraw a vehicle that is not on the network, if it still waits for a place there."""
        if key in self._vehicle.getLoadedIDList():
            self._vehicle.remove(key)

    # Pedestrians

    def add_pedestrian(
        self, key: str, edges: Sequence[str], stations_m: tuple[float, float], pedestrian_type: str
    ) -> None:
        """Put a person onto the pavement of the first edge, to walk along the edges to a point on the last edge.

        ``stations_m``: distances of the start and end points from the start of their edges.
        """
        self._person.add(key, edges[0], stations_m[0], typeID=pedestrian_type)
        self._person.appendWalkingStage(key, list(edges), stations_m[1])

    def pedestrians(self) -> tuple[str, ...]:
        """Return the people on the network, ascending."""
        return tuple(sorted(self._person.getIDList()))

    def pedestrian_front(self, key: str) -> tuple[float, float]:
        """Return the position (x, y) of the front of a person."""
        x, y = self._person.getPosition(key)[:2]
        return x, y

    def pedestrian_angle_deg(self, key: str) -> float:
        """Return the direction that a person faces, in SUMO's convention: degrees clockwise from north."""
        return float(self._person.getAngle(key))

    def pedestrian_edge(self, key: str) -> str:
        """Return the edge that a person walks on; those of crossings have ids such as ``:junction_c0``."""
        return str(self._person.getRoadID(key))

    # Vehicles that are placed by hand

    def move_to(
        self, key: str, pose: tuple[float, float, float], hint: LaneHint, *, keep_to_route: bool = False
    ) -> None:
        """Put a vehicle at a pose of :func:`sumo_pose`, where the next step ends.

        Args:
            key: the vehicle.
            pose: front bumper and SUMO's angle.
            hint: the lane that it is on.
            keep_to_route: whether to put it onto the nearest lane of its route instead of exactly at the pose.
        """
        keep = _KEEP_ROUTE if keep_to_route else _KEEP_POSE
        self._vehicle.moveToXY(key, *hint, *pose, keep, _MATCH_REACH_M)

    def takes(self, placing: Callable[[], None], key: str) -> bool:
        """Place a new vehicle by calling a function, and return True if SUMO accepts it; otherwise it is withdrawn.

        SUMO refuses a route or a type that it cannot use, and a pose too far from every lane of the route that the
        vehicle must keep to.
        """
        try:
            placing()
        except self._libsumo.TraCIException:
            self.withdraw(key)
            return False
        return True

    def hold(self, key: str) -> None:
        """Keep SUMO from driving a vehicle that is placed by hand."""
        self._vehicle.setSpeedMode(key, _PLACED_SPEED_MODE)
        self.allow_lane_changes(key, LaneChanges.NONE)

    def stop_at_once(self, key: str) -> None:
        """Have a held vehicle stand where it is until it is placed again."""
        self._vehicle.setSpeed(key, 0.0)

    def cancel_stop(self, key: str) -> None:
        """Undo :meth:`stop_at_once`."""
        self._vehicle.setSpeed(key, _DRIVERS_CHOICE)

    def stays_as_placed(self, key: str) -> bool:
        """Return True if a placed, standing vehicle keeps its pose when it is not placed again.

        SUMO turns a vehicle that stands across its lane along it, and removes one that is off the lanes or at the end
        of its route. A vehicle with its rear on another lane counts as one that does not keep its pose.
        """
        lane = self.lane(key)
        if not lane:
            return False
        station_m, length_m = self.station_m(key), float(self._vehicle.getLength(key))
        at_end = station_m > self.lane_length_m(lane) - _ARRIVAL_REACH_M
        if station_m < length_m or (at_end and lane.rpartition("_")[0] == self.last_edge(key)):
            return False
        front, rear = self._off_center_line(key, station_m), self._off_center_line(key, station_m - length_m)
        ahead = math.atan2(front[1] - rear[1], front[0] - rear[0])
        now = heading_of_angle_rad(self.angle_deg(key))
        x_m, y_m = self.front(key)
        moved_m = math.hypot(
            front[0] - x_m - length_m / 2 * (math.cos(ahead) - math.cos(now)),
            front[1] - y_m - length_m / 2 * (math.sin(ahead) - math.sin(now)),
        )
        return moved_m <= _TURN_REACH_M

    def _off_center_line(self, key: str, station_m: float) -> tuple[float, float]:
        """Return the point (x, y) at a vehicle's lateral distance from its lane's center line, as SUMO computes it."""
        edge, _, index = self.lane(key).rpartition("_")
        x_m, y_m = self._simulation.convert2D(edge, station_m, int(index))
        heading = heading_of_angle_rad(self._lane.getAngle(self.lane(key), station_m))
        left_m = self.offset_m(key)
        return x_m - left_m * math.sin(heading), y_m + left_m * math.cos(heading)

    def show_speed(self, key: str, speed_mps: float) -> None:
        """Set the speed that other drivers see for a vehicle that is placed by hand."""
        self._vehicle.setPreviousSpeed(key, max(speed_mps, 0.0))

    def set_width(self, key: str, width_m: float) -> None:
        """Change the width of a vehicle."""
        self._vehicle.setWidth(key, width_m)

    # Orders to vehicles that SUMO drives

    def ignore_lights(self, key: str) -> None:
        """Have a vehicle ignore red lights and the right of way, regardless of its orders."""
        self._ignoring_lights.add(key)

    def _mode(self, key: str, mode: int) -> int:
        return mode & ~_LIGHTS_AND_RIGHT_OF_WAY if key in self._ignoring_lights else mode

    def release(self, key: str) -> None:
        """Let SUMO drive the vehicle from now on."""
        self._vehicle.setSpeed(key, _DRIVERS_CHOICE)
        self._vehicle.setSpeedMode(key, self._mode(key, _DRIVEN_SPEED_MODE))
        self.allow_lane_changes(key, LaneChanges.DRIVERS_OWN)

    def slow_down(self, key: str, speed_mps: float) -> None:
        """Have a vehicle brake to a speed in the next step, however hard that is."""
        self._vehicle.setSpeedMode(key, self._mode(key, _HARD_BRAKING_SPEED_MODE))
        self._vehicle.setSpeed(key, speed_mps)

    def keep_speed(self, key: str, speed_mps: float) -> None:
        """Have a vehicle keep a speed from the next step on, even above the speed limit."""
        self._vehicle.setSpeedMode(key, self._mode(key, _NO_LIMIT_SPEED_MODE))
        self._vehicle.setSpeed(key, speed_mps)

    def release_speed(self, key: str) -> None:
        """Leave the speed to the driver again."""
        self._vehicle.setSpeedMode(key, self._mode(key, _DRIVEN_SPEED_MODE))
        self._vehicle.setSpeed(key, _DRIVERS_CHOICE)

    def allow_lane_changes(self, key: str, changes: LaneChanges) -> None:
        """Set which lane changes a vehicle performs."""
        self._vehicle.setLaneChangeMode(key, int(changes))

    def change_lane(self, key: str, index: int, within_s: float) -> None:
        """Have a vehicle change to a lane of its edge and stay there for a time."""
        self._vehicle.changeLane(key, index, within_s)

    def pass_by(self, key: str, lane: LaneHint, station_m: float) -> None:
        """Have a vehicle find a route into a lane, by setting a stop in the lane that the vehicle only passes.

        The stop replaces any stop that the vehicle has not reached yet. Nothing happens if SUMO refuses the stop, as it
        does if the vehicle cannot brake for it comfortably.
        """
        edge, index = lane
        try:
            if self._vehicle.getStops(key, 1):
                self._vehicle.replaceStop(key, 0, edge, station_m, index, 0.0)
            else:
                self._vehicle.setStop(key, edge, station_m, index, 0.0)
        except self._libsumo.TraCIException:
            return
        self._vehicle.setStopParameter(key, 0, "speed", _PASSING_MPS)

    # The state of a vehicle

    def front(self, key: str) -> tuple[float, float]:
        """Return the position (x, y) of the front bumper."""
        x, y = self._vehicle.getPosition(key)[:2]
        return x, y

    def angle_deg(self, key: str) -> float:
        """Return a vehicle's angle in SUMO's convention: degrees clockwise from north."""
        return float(self._vehicle.getAngle(key))

    def speed_mps(self, key: str) -> float:
        """Return the speed along the lane."""
        return float(self._vehicle.getSpeed(key))

    def lateral_speed_mps(self, key: str) -> float:
        """Return the speed across the lane, left positive."""
        return float(self._vehicle.getLateralSpeed(key))

    def state(self, key: str, length_m: float) -> tuple[float, float, float, float]:
        """Return the vehicle's centre (x, y) in m, heading in [-π, π] and speed in m/s."""
        x, y = self.front(key)
        heading = math.remainder(heading_of_angle_rad(self._vehicle.getAngle(key)), math.tau)
        back_m = length_m / 2
        return x - back_m * math.cos(heading), y - back_m * math.sin(heading), heading, self.speed_mps(key)

    def width_m(self, key: str) -> float:
        """Return the width of a vehicle."""
        return float(self._vehicle.getWidth(key))

    def decel_mps2(self, key: str) -> float:
        """Return the driver's own deceleration."""
        return float(self._vehicle.getDecel(key))

    def last_edge(self, key: str) -> str:
        """Return the edge on which a vehicle's route ends."""
        return str(self._vehicle.getRoute(key)[-1])

    def is_astray(self, key: str, edges: Sequence[str]) -> bool:
        """Return True if SUMO put a placed vehicle onto another road than its route's ``edges``, or onto no lane.

        The front of a long vehicle swings out of its lane in a tight turn. SUMO removes a vehicle that it drives from a
        place off the lanes.
        """
        return not self.lane(key) or self.last_edge(key) != edges[-1]

    # Where a vehicle is on the lanes

    def lane(self, key: str) -> str:
        """Return the lane that a vehicle is on; empty off the lanes."""
        return str(self._vehicle.getLaneID(key))

    def station_m(self, key: str) -> float:
        """Return the distance of the front bumper from the start of its lane."""
        return float(self._vehicle.getLanePosition(key))

    def offset_m(self, key: str) -> float:
        """Return the lateral offset of a vehicle from the centre of its lane, left positive."""
        return float(self._vehicle.getLateralLanePosition(key))

    def lanes_ahead(self, key: str) -> Iterator[str]:
        """Yield the lanes that follow a vehicle's lane as SUMO plans its drive, including those through junctions."""
        for link in self._vehicle.getNextLinks(key):
            yield from (lane for lane in (link[4], link[0]) if lane)

    def driving_distance_m(self, key: str, lane: LaneHint, station_m: float) -> float:
        """Return the driving distance of a vehicle to a point on a lane; far below 0 if the vehicle is past it."""
        edge, index = lane
        return float(self._vehicle.getDrivingDistance(key, edge, station_m, index))

    def could_change_lane(self, key: str, direction: int) -> bool:
        """Return True if the driver's gaps allow a lane change to the left (1) or right (-1) now."""
        return bool(self._vehicle.couldChangeLane(key, direction))

    # Other vehicles around a vehicle

    def leader(self, key: str) -> tuple[str, float] | None:
        """Return the vehicle ahead and the gap in m beyond the standstill gap, or None if no vehicle is in sight."""
        ahead, gap_m = self._vehicle.getLeader(key) or ("", 0.0)
        return (ahead, gap_m) if ahead else None

    def safe_speed_mps(self, key: str, leader: str, gap_m: float) -> float:
        """Return the largest speed of the next step that SUMO's driver considers safe behind a leader."""
        return float(
            self._vehicle.getFollowSpeed(
                key, self.speed_mps(key), gap_m, self.speed_mps(leader), self._vehicle.getApparentDecel(leader), leader
            )
        )

    def neighbours(self, key: str, *, left: bool, ahead: bool) -> Sequence[tuple[str, float]]:
        """Return the vehicles ahead or behind in the adjacent lane, and the gaps to them beyond the standstill gaps."""
        return tuple(self._vehicle.getNeighbors(key, (0 if left else 1) + (2 if ahead else 0)))

    # Lanes

    def lane_length_m(self, lane: str) -> float:
        """Return the length of a lane."""
        return float(self._lane.getLength(lane))

    def lane_width_m(self, lane: str) -> float:
        """Return the width of a lane."""
        return float(self._lane.getWidth(lane))

    def limit_mps(self, lane: str) -> float:
        """Return the speed limit of a lane."""
        return float(self._lane.getMaxSpeed(lane))

    def lane_count(self, edge: str) -> int:
        """Return the number of lanes of an edge."""
        return int(self._libsumo.edge.getLaneNumber(edge))
