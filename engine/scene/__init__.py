"""A recorded scenario made ready to be simulated: its SUMO net, its vehicles on their lanelets, its ego.

``EgoLane``: The lane that the ego follows.
``ego_lane``: The lane from the ego's start along its way to its goal.
``is_own_recording``: Whether a track begins as the ego does, in place, heading and speed.
``leader_and_follower``: The nearest vehicles ahead and behind along the ego's lane.
``LaneMatch``: Lanelets of a track.
``MapMatcher``: The drivable lanelets of a network, ready for queries by place.
``straightness``: Cosine between the end of one polyline and the beginning of another, rounded to a tenth.
``EgoRoute``: Lanelets from the ego's start to its goal, both included, and how the ego has to drive.
``Route``: Lanelets in driving order.
``TURN_RAD``: A heading change beyond this inside the lanelets of a junction is a turn.
``aligned_lanelets``: Those of the lanelets that lead in the direction of the heading (within 90°), best aligned first.
``center_line``: The lanelet's centre line without repeated vertices, shape (n, 2).
``ego_route``: The ego's way to its goal.
``find_route``: The shortest route from a position to any goal lanelet, continued until ``ahead_m`` metres lie behind
    the goal.
``goal_centers``: Centres of the goal's regions, one per goal state that has one.
``goal_lanelets``: Lanelets of a goal for planners: those that its regions touch, too; None for a free position.
``lanelets_at``: All lanelets that the point lies on, ascending.
``path_ahead``: Centre line from the start lanelet on, along the route and then the straightest successors.
``start_lanelets``: Lanelets under a position, the one that fits the heading best first.
``goal_center_lanelets``: Lanelets that a goal names, or that lie under the centre of its region; may be empty.
``straight_on``: The route with the straightest successors behind it, until they are ``ahead_m`` long or the network
    ends.
``Ego``: A planning problem's start, the middle of an uncertain one.
``NOT_DRIVEN``: Obstacle types that SUMO's vehicles cannot stand for.
``Scene``: The base scenario of an edit.
``obstacle_of``: The id of the obstacle that a track stands for, which is the track's own unless it is of an occupied
    region.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .ego_relations import EgoLane as EgoLane
    from .ego_relations import ego_lane as ego_lane
    from .ego_relations import is_own_recording as is_own_recording
    from .ego_relations import leader_and_follower as leader_and_follower
    from .map_matching import LaneMatch as LaneMatch
    from .map_matching import MapMatcher as MapMatcher
    from .map_matching import straightness as straightness
    from .routing import TURN_RAD as TURN_RAD
    from .routing import EgoRoute as EgoRoute
    from .routing import Route as Route
    from .routing import aligned_lanelets as aligned_lanelets
    from .routing import center_line as center_line
    from .routing import ego_route as ego_route
    from .routing import find_route as find_route
    from .routing import goal_center_lanelets as goal_center_lanelets
    from .routing import goal_centers as goal_centers
    from .routing import goal_lanelets as goal_lanelets
    from .routing import lanelets_at as lanelets_at
    from .routing import path_ahead as path_ahead
    from .routing import start_lanelets as start_lanelets
    from .routing import straight_on as straight_on
    from .scene import NOT_DRIVEN as NOT_DRIVEN
    from .scene import Ego as Ego
    from .scene import Scene as Scene
    from .scene import obstacle_of as obstacle_of

__getattr__, __dir__ = lazy_face(__name__, __file__)
