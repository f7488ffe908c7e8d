"""Routes over lanelets: the lanelets of a position and of a goal, and how the ego gets there.

Two kinds of callers need different answers:

* planners drive :func:`find_route`, from the lanelet nearest to the ego to any that the goal's regions touch
  (:func:`goal_lanelets`), continued straight after the goal. It raises an error if there is no route.
* descriptions, facts and edits use :func:`ego_route`, from the lanelets under the ego to those that the goal lists or
  that are under its centre (:func:`goal_center_lanelets`), with its turns. It is None if there is no route.

Networks are commonroad-io's objects. Positions are (2,) in m, headings in rad.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ...schemas.errors import NotPossible
from ..commonroad import center_of, middle_of
from ..geometry import Points, arc_length, point_at, project, without_repeats, wrap_angle
from ..network import LaneletGraph
from .poses import lanelets_of_pose
from .roundabouts import roundabout_of

if TYPE_CHECKING:
    from commonroad.planning.goal import GoalRegion
    from commonroad.planning.planning_problem import PlanningProblem
    from commonroad.scenario.lanelet import Lanelet, LaneletNetwork


@dataclass(frozen=True)
class Route:
    """Lanelets in driving order; a lane change is a step to a neighbour.

    ``lanelets`` continues beyond the goal as straight as the network allows; ``goal_index`` is the index of the goal
    lanelet in it, or None if the goal has no position.
    """

    lanelets: tuple[int, ...]
    goal_index: int | None


def find_route(
    network: "LaneletNetwork", goal: "GoalRegion", position: Points, heading_rad: float, *, ahead_m: float
) -> Route:
    """Return the shortest route from a position to any goal lanelet, continued for ``ahead_m`` metres after the goal.

    Raises:
        NotPossible: the position is not on a lanelet, the goal touches no lanelet, or no route leads there.
    """
    graph = LaneletGraph.of(network)
    starts = start_lanelets(network, position, heading_rad)
    if not goal.state_list:
        raise NotPossible("the planning problem has no goal state")
    goals = goal_lanelets(network, goal)
    if goals is None:
        return Route(straight_on(network, graph, (starts[0],), ahead_m), None)
    if not goals:
        raise NotPossible("the goal region does not touch a lanelet")
    route = graph.shortest_route(starts, goals)
    if route is None:
        raise NotPossible(f"no route leads from lanelet {starts[0]} to the goal on {', '.join(map(str, goals[:6]))}")
    return Route(straight_on(network, graph, route, ahead_m), len(route) - 1)


def start_lanelets(network: "LaneletNetwork", position: Points, heading_rad: float) -> tuple[int, ...]:
    """Return the lanelets of a pose, best fit first (:func:`~.poses.lanelets_of_pose`).

    Raises:
        NotPossible: there is no lanelet.
    """
    starts = lanelets_of_pose(network, position, heading_rad)
    if not starts:
        raise NotPossible(f"the ego at ({position[0]:.1f}, {position[1]:.1f}) m is not on a lanelet")
    return starts


def goal_lanelets(network: "LaneletNetwork", goal: "GoalRegion") -> list[int] | None:
    """Return the lanelets that a goal lists, else those under its regions' centres, else those that it touches, sorted.

    The result is None if a goal state leaves the position free. A planner aims at these lanelets, so a region next to
    the lanes still has a lanelet. The function :func:`goal_center_lanelets` is narrower: of the 195 available public
    planning problems, the two functions differ in one (ZAM_test_0-1, with a second region that only touches lanelets).
    """
    named = goal.lanelets_of_goal_position or {}
    goals: set[int] = set()
    for index, state in enumerate(goal.state_list):
        if named.get(index):
            goals.update(int(key) for key in named[index] if network.find_lanelet_by_id(key) is not None)
        elif getattr(state, "position", None) is None:
            return None
        else:
            goals.update(_lanelets_of(network, state.position))
    return sorted(goals)


def _lanelets_of(network: "LaneletNetwork", shape: object) -> set[int]:
    """Return the lanelets under the centre of a shape, else those that it touches."""
    lanelets: set[int] = set()
    for part in getattr(shape, "shapes", [shape]):
        under = network.find_lanelet_by_position([np.asarray(part.center, dtype=float)])[0]
        if not under:
            outline = part.shapely_object
            under = [lane.lanelet_id for lane in network.lanelets if lane.polygon.shapely_object.intersects(outline)]
        lanelets.update(int(key) for key in under)
    return lanelets


def straight_on(
    network: "LaneletNetwork", graph: LaneletGraph, route: tuple[int, ...], ahead_m: float
) -> tuple[int, ...]:
    """Return the route extended by its straightest successors, ``ahead_m`` long or up to the network's end."""
    longer, passed, length = list(route), set(route), 0.0
    while length < ahead_m:
        following = [key for key in graph.successors.get(longer[-1], ()) if key not in passed]
        if not following:
            break
        current = network.find_lanelet_by_id(longer[-1])
        nearest = min(following, key=lambda key: (_turn(current, network.find_lanelet_by_id(key)), key))
        longer.append(nearest)
        passed.add(nearest)
        length += graph.length_m[nearest]
    return tuple(longer)


def _turn(current: "Lanelet", following: "Lanelet") -> float:
    """Return how far the heading changes from the end of one lanelet to the end of the next, in rad."""
    last = current.center_vertices[-1] - current.center_vertices[-2]
    center = following.center_vertices
    step = point_at(center, float(arc_length(center)[-1]))[1]
    return round(abs(wrap_angle(step - math.atan2(last[1], last[0]))), 3)


TURN_RAD = math.radians(40.0)
"""A heading change beyond this inside the lanelets of a junction is a turn (chosen)."""
BACK_RAD = math.radians(150.0)
"""A turn beyond this leads back where the ego came from (chosen; as for generated egos)."""
PART_RAD = math.radians(25.0)
"""Lanes of a carriageway that diverge or merge at a larger angle do so at a junction (chosen; as for crossings)."""
_APART_M = 40.0
"""Forks on a route that are farther apart are two junctions (chosen): left and later right is not straight on."""


@dataclass(frozen=True)
class EgoRoute:
    """Lanelets from the ego's start to its goal, both included, and the ego's turns.

    ``turns_rad``: heading change at each junction, from its first lanelet to its last, left positive; ``bend_rad``: the
    heading change of the whole route, from the heading at the start to that at the goal. ``length_m``: the
    distance along the lanes from the start to the goal's region, or to the end of the last lanelet.
    """

    lanelets: tuple[int, ...]
    turns_rad: tuple[float, ...]
    changes_lane: bool
    bend_rad: float = 0.0
    length_m: float = 0.0

    @property
    def turns(self) -> tuple[str, ...]:
        """The turns ``left``, ``right`` and ``back``, in order, one for each junction where the route turns."""
        turned = [angle for angle in self.turns_rad if abs(angle) > TURN_RAD]
        return tuple("back" if abs(angle) > BACK_RAD else "left" if angle > 0 else "right" for angle in turned)

    @property
    def goes_straight(self) -> bool:
        """Whether the route has no turn, keeps its lane, and ends roughly in its initial direction."""
        return not self.turns and not self.changes_lane and abs(self.bend_rad) <= TURN_RAD

    @property
    def words(self) -> str:
        """A description of the route: its turns, else a bend of its road, and whether it changes lanes."""
        if self.turns:
            way = f"turns {', then '.join(self.turns)}"
        elif abs(self.bend_rad) > TURN_RAD:
            side = "left" if self.bend_rad > 0 else "right"
            way = f"follows its road, which bends {side} by {math.degrees(abs(self.bend_rad)):.0f}°"
        else:
            way = "straight on"
        return way + (", with a lane change" if self.changes_lane else "")


def lanelets_at(network: "LaneletNetwork", point: Points) -> tuple[int, ...]:
    """Return all lanelets that the point is on, ascending."""
    return tuple(sorted(network.find_lanelet_by_position([np.asarray(point, dtype=float)])[0]))


def center_line(network: "LaneletNetwork", lanelet_id: int) -> Points:
    """Return the lanelet's centre line without repeated vertices, shape (n, 2)."""
    return without_repeats(network.find_lanelet_by_id(lanelet_id).center_vertices)


def goal_center_lanelets(network: "LaneletNetwork", problem: "PlanningProblem") -> tuple[int, ...]:
    """Return the lanelets that a goal lists, or those under the centre of its region; may be empty.

    Descriptions and edits use these lanelets; a goal without a position has none. Unlike in :func:`goal_lanelets`, a
    region that only touches lanelets has none. If some goal states list lanelets, the regions of other goal states do
    not count.
    """
    named: set[int] = set()
    for keys in (problem.goal.lanelets_of_goal_position or {}).values():
        named.update(int(key) for key in keys)
    if not named:
        for center in goal_centers(problem):
            named.update(lanelets_at(network, center))
    known = {lanelet.lanelet_id for lanelet in network.lanelets}
    return tuple(sorted(named & known))


def goal_centers(problem: "PlanningProblem") -> list[Points]:
    """Return the centres of the goal's regions, one per goal state that has one."""
    regions = [getattr(state, "position", None) for state in problem.goal.state_list]
    return [np.asarray(center_of(region), dtype=float) for region in regions if region is not None]


def ego_route(network: "LaneletNetwork", graph: LaneletGraph, problem: "PlanningProblem") -> EgoRoute | None:
    """Return the ego's route to its goal; None if the goal has no position or cannot be reached from the start."""
    state = problem.initial_state
    point, heading = np.asarray(center_of(state.position), dtype=float), middle_of(state.orientation)
    starts = lanelets_of_pose(network, point, heading)
    goals = goal_center_lanelets(network, problem)
    lanelets = graph.shortest_route(starts, goals) if starts and goals else None
    if lanelets is None:
        return None
    hops = list(pairwise(lanelets))
    changes = any(following not in graph.successors[current] for current, following in hops)
    centers = goal_centers(problem)
    named = bool(problem.goal.lanelets_of_goal_position)
    goal = None if named or not centers else centers[0]
    bend_rad = _bend(network, lanelets, point, goal)
    length_m = _length_m(network, graph, lanelets, point, goal)
    return EgoRoute(lanelets, _turns(network, graph, lanelets, point, goal), changes, bend_rad, length_m)


def _length_m(
    network: "LaneletNetwork", graph: LaneletGraph, lanelets: tuple[int, ...], start: Points, goal: Points | None
) -> float:
    """Return the distance along a route's lanes; a lane change goes on at the same place in the next lane."""
    total_m, place = 0.0, start
    for index, key in enumerate(lanelets):
        line = center_line(network, key)
        if len(line) < 2:
            continue
        following = lanelets[index + 1] if index + 1 < len(lanelets) else None
        if following is not None and following not in graph.successors[key]:
            continue
        begin = 0.0 if index and lanelets[index] in graph.successors[lanelets[index - 1]] else project(line, place)[0]
        _, end = _driven(network, lanelets, index, start, goal)
        total_m += end - begin
        place = line[-1]
    return max(total_m, 0.0)


def path_ahead(
    network: "LaneletNetwork", graph: LaneletGraph, start: int, route: tuple[int, ...], ahead_m: float
) -> tuple[Points, tuple[int, ...]]:
    """Return the centre line from the start lanelet along the route, then along the straightest successors.

    Returns:
        Points (n, 2) and their lanelets, up to at least ``ahead_m`` from the start if the map is large enough.
    """
    chosen, line, length = [start], center_line(network, start), 0.0
    while length < ahead_m:
        onward = [key for key in graph.successors[chosen[-1]] if key not in chosen]
        if not onward:
            break
        following = next((key for key in onward if key in route), None)
        if following is None:
            following = straightest_ahead(line, {key: center_line(network, key) for key in onward})
        chosen.append(following)
        line = without_repeats(np.vstack([line, center_line(network, following)]))
        length += graph.length_m[following]
    return line, tuple(chosen)


def straightest_ahead(line: Points, onward: Mapping[int, Points]) -> int:
    """Return the lanelet that continues a line most straight, by the lanelets' centre lines."""
    arriving = math.atan2(*(line[-1] - line[-2])[::-1]) if len(line) > 1 else 0.0

    def turn(key: int) -> tuple[float, int]:  # towards the far end of the lanelet, not its first metres
        leaving = math.atan2(*(onward[key][-1] - onward[key][0])[::-1])
        return abs(wrap_angle(leaving - arriving)), key

    return min(onward, key=turn)


def straightest_behind(line: Points, before: Mapping[int, Points]) -> int:
    """Return the lanelet that leads most straight to the start of a line, by the lanelets' centre lines."""

    def turn(key: int) -> tuple[float, int]:
        first = before[key]
        if len(first) < 2 or len(line) < 2:
            return math.inf, key
        arriving, leaving = first[-1] - first[0], line[1] - line[0]
        return abs(wrap_angle(math.atan2(*arriving[::-1]) - math.atan2(*leaving[::-1]))), key

    return min(before, key=turn)


def _turns(
    network: "LaneletNetwork", graph: LaneletGraph, lanelets: tuple[int, ...], start: Points, goal: Points | None
) -> tuple[float, ...]:
    """Return the heading change at each junction, from its first lanelet to its last, between start and goal.

    There is one total for each junction, so a route through a roundabout is at most one turn. At a roundabout, it is
    the angle between the arms (``_round``), since the lanes at a small ring bend away from their road.
    """
    sums: list[float] = []
    since_fork_m, left_at_rad, was_inside = math.inf, 0.0, False
    named = _in_intersections(network)
    rings = _round(network, graph, lanelets, start, goal)
    for index, key in enumerate(lanelets):
        if (ring := next((one for one in rings if one.first <= index <= one.last), None)) is not None:
            if index == ring.first:
                sums.append(ring.turned_rad)
            since_fork_m = math.inf
            continue
        begin, end = _driven(network, lanelets, index, start, goal)
        line = center_line(network, key)
        is_inside = key in named or (len(line) > 1 and _leaves_fork(network, graph, key))
        is_inside = is_inside or (was_inside and len(line) > 1 and _continues_inside(network, graph, key))
        was_inside = is_inside
        if len(line) < 2 or not is_inside:
            if len(line) < 2 or not _joins(network, graph, key):
                since_fork_m += graph.length_m[key]
                continue
            since_fork_m += max(end - begin - _APART_M, 0.0)
            begin = max(begin, end - _APART_M)  # before that, it is the approach road
        enters_at_rad = point_at(line, begin)[1]
        if since_fork_m > _APART_M:
            sums.append(0.0)
        else:  # a bend between two forks of a junction belongs to the turn
            sums[-1] += wrap_angle(enters_at_rad - left_at_rad)
        left_at_rad = point_at(line, end)[1]
        sums[-1] += wrap_angle(left_at_rad - enters_at_rad)
        since_fork_m = 0.0
    return tuple(sums)


@dataclass(frozen=True)
class _Round:
    """A route's passage around a roundabout: its first and last lanelet there, as indices, and the turn's angle."""

    first: int
    last: int
    turned_rad: float


def _round(
    network: "LaneletNetwork", graph: LaneletGraph, lanelets: tuple[int, ...], start: Points, goal: Points | None
) -> list[_Round]:
    """Return the passages of a route around roundabouts.

    The directions of the arms are those of the route over one diameter of the roundabout before and after it. They are
    properties of the roads, so they count in full even if the ego starts or ends close to the roundabout. The lanelets
    that the ego drives on these stretches belong to the roundabout.
    """
    found: list[_Round] = []
    ends_m, parts = [0.0], []
    for index, key in enumerate(lanelets):
        begin, end = _driven(network, lanelets, index, start, goal)
        ends_m.append(ends_m[-1] + max(end - begin, 0.0))
        line = center_line(network, key)
        if len(line) < 2:
            continue
        stations = arc_length(line)
        inside = (stations > begin) & (stations < end)
        parts.append(np.vstack([point_at(line, begin)[0], line[inside], point_at(line, max(begin, end))[0]]))
    line = without_repeats(np.vstack(parts)) if parts else np.zeros((0, 2))
    index = 0 if len(line) > 1 else len(lanelets)
    while index < len(lanelets):
        ring = roundabout_of(network, graph, lanelets[index])
        if not ring:
            index += 1
            continue
        last = index
        while last + 1 < len(lanelets) and lanelets[last + 1] in ring:
            last += 1
        points = np.vstack([center_line(network, key) for key in ring])
        diameter_m = float(np.ptp(points, axis=0).max())
        enters_m, leaves_m = ends_m[index], ends_m[last + 1]
        first_m, last_m = max(enters_m - diameter_m, 0.0), min(leaves_m + diameter_m, ends_m[-1])
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        joint, heading = point_at(line, enters_m)
        approach = _approach(network, graph, lanelets[:index], diameter_m)
        arriving = _arm(joint if approach is None else approach, joint, heading, middle)
        joint, heading = point_at(line, leaves_m)
        exit_ = _exit(network, graph, lanelets[last + 1 :], diameter_m)
        leaving = _arm(joint if exit_ is None else exit_, joint, heading + math.pi, middle)
        turned = wrap_angle(leaving + math.pi - arriving)
        before = next(one for one in range(len(lanelets)) if ends_m[one + 1] > first_m or one == index)
        behind = next((one for one in range(last, len(lanelets)) if ends_m[one + 1] >= last_m), last)
        found.append(_Round(before, behind, turned))
        index = behind + 1
    return found


def _approach(
    network: "LaneletNetwork", graph: LaneletGraph, lanelets: tuple[int, ...], before_m: float
) -> Points | None:
    """Return the point so far before the end of lanelets, also on the road that leads to them; None without any."""
    if not lanelets:
        return None
    chain, line = [lanelets[0]], without_repeats(np.vstack([center_line(network, key) for key in lanelets]))
    while float(arc_length(line)[-1]) < before_m:
        leading = [key for key in graph.predecessors[chain[-1]] if key not in chain and key not in lanelets]
        if not leading:
            break
        chain.append(min(leading, key=lambda key: (_bend_between(network, key, chain[-1]), key)))
        line = without_repeats(np.vstack([center_line(network, chain[-1]), line]))
    if len(line) < 2:
        return None
    return point_at(line, max(float(arc_length(line)[-1]) - before_m, 0.0))[0]


def _bend_between(network: "LaneletNetwork", before: int, after: int) -> float:
    """Return the absolute heading change from the end of one lanelet to the start of the next, in rad."""
    one, two = center_line(network, before), center_line(network, after)
    if len(one) < 2 or len(two) < 2:
        return math.pi
    return round(abs(wrap_angle(point_at(two, 0.0)[1] - point_at(one, float(arc_length(one)[-1]))[1])), 3)


def _exit(network: "LaneletNetwork", graph: LaneletGraph, lanelets: tuple[int, ...], after_m: float) -> Points | None:
    """Return the point so far after the start of lanelets, also on the road straight on from them; None without any."""
    if not lanelets:
        return None
    onward = straight_on(network, graph, lanelets, after_m)
    line = without_repeats(np.vstack([center_line(network, key) for key in onward]))
    return point_at(line, after_m)[0] if len(line) > 1 else None


def _arm(outside: Points, joint: Points, heading_rad: float, middle: Points) -> float:
    """Return the direction of an arm towards its roundabout.

    Before a ring, lanes bend to one side, but lie on the other side of the middle of their road. The mean of their
    direction and of that to the middle of the ring is the direction of the arm.
    """
    along, inwards = joint - outside, middle - outside
    is_outside = float(np.linalg.norm(along)) > 1.0
    own = math.atan2(along[1], along[0]) if is_outside else heading_rad
    return own + wrap_angle(math.atan2(inwards[1], inwards[0]) - own) / 2


def _driven(
    network: "LaneletNetwork", lanelets: tuple[int, ...], index: int, start: Points, goal: Points | None
) -> tuple[float, float]:
    """Return the stations in m between which the route is on one of its lanelets."""
    line = center_line(network, lanelets[index])
    if len(line) < 2:
        return 0.0, 0.0
    begin = project(line, start)[0] if index == 0 else 0.0
    is_last = index == len(lanelets) - 1 and goal is not None
    end = project(line, goal)[0] if is_last and goal is not None else float(arc_length(line)[-1])
    return begin, end


def _bend(network: "LaneletNetwork", lanelets: tuple[int, ...], start: Points, goal: Points | None) -> float:
    """Return the change of the lane's heading from the start to the end of the route, left positive."""
    first, last = center_line(network, lanelets[0]), center_line(network, lanelets[-1])
    if len(first) < 2 or len(last) < 2:
        return 0.0
    begin, _ = _driven(network, lanelets, 0, start, goal)
    _, end = _driven(network, lanelets, len(lanelets) - 1, start, goal)
    return wrap_angle(point_at(last, end)[1] - point_at(first, begin)[1])


def _in_intersections(network: "LaneletNetwork") -> frozenset[int]:
    """Return the lanelets that the file's intersections list as leading from an arm to the left, ahead or right."""
    arms = [arm for intersection in network.intersections for arm in intersection.incomings]
    ways = [way for arm in arms for way in (arm.successors_left, arm.successors_straight, arm.successors_right) if way]
    return frozenset(int(key) for way in ways for key in way)


def _leaves_fork(network: "LaneletNetwork", graph: LaneletGraph, key: int) -> bool:
    """Return True if a lanelet follows a fork, or a dedicated lane next to lanes that lead elsewhere."""
    before = graph.predecessors[key]
    if any(len(graph.successors[one]) > 1 for one in before):
        return True
    others = {
        after for lane in graph.parallel_lanes(before) for after in graph.successors[lane]
    } - graph.parallel_lanes([key])
    own = _heading_after(center_line(network, key))
    return any(abs(wrap_angle(_heading_after(center_line(network, one)) - own)) > PART_RAD for one in others)


def _continues_inside(network: "LaneletNetwork", graph: LaneletGraph, key: int) -> bool:
    """Return True if a lanelet after one of a junction is still inside it: it crosses lanes that it does not join.

    SUMO's networks divide a left turn where a car waits for oncoming traffic.
    """
    import shapely

    own = graph.parallel_lanes([key])
    near = {*own, *graph.predecessors[key], *graph.successors[key]}
    siblings = {after for before in graph.predecessors[key] for after in graph.successors[before]}
    siblings |= {before for after in graph.successors[key] for before in graph.predecessors[after]}
    center = shapely.LineString(center_line(network, key))
    for other in network.find_lanelet_by_shape(network.find_lanelet_by_id(key).polygon):
        if other in near or other in siblings:
            continue
        crossed = center_line(network, other)
        if len(crossed) > 1 and center.crosses(shapely.LineString(crossed)):
            return True
    return False


def _joins(network: "LaneletNetwork", graph: LaneletGraph, key: int) -> bool:
    """Return True if a lanelet's end meets a lanelet from elsewhere, such as a side street that joins a road."""
    row = graph.parallel_lanes([key])
    others = {before for after in graph.successors[key] for before in graph.predecessors[after]} - row
    own = _heading_after(center_line(network, key)[::-1])
    return any(abs(wrap_angle(_heading_after(center_line(network, one)[::-1]) - own)) > PART_RAD for one in others)


def _heading_after(line: Points) -> float:
    """Return the heading of a line one junction length after its start, or at its end."""
    return point_at(line, min(_APART_M, float(arc_length(line)[-1])))[1] if len(line) > 1 else 0.0
