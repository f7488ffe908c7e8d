"""A recorded scenario made ready to be simulated: its SUMO net, its vehicles on their lanelets, its ego.

``Scene``: A recorded scenario ready to be edited and simulated; ``Scene.of`` makes it from a loaded file.
``Ego``: A planning problem's start: position in m, heading in rad, speed in m/s, and the lanelets there.
``NOT_DRIVEN``: Obstacle types that SUMO's vehicles cannot stand for.
``obstacle_of``: The id of the obstacle that a track stands for.
``MapMatcher``: The drivable lanelets of a network, ready for queries by position: which lanelets a track drove on.
``LaneMatch``: Lanelets of a track, by index.
``EgoLane``: The lane that the ego follows; says in words where a vehicle is.
``ego_lane``: The ``EgoLane`` from the ego's start along its route to its goal; None where it starts on no lanelet.
``leader_and_follower``: Ids of the nearest vehicles ahead and behind along the ego's lane, or None.
``is_own_recording``: Whether a track begins as the ego does, in place, heading and speed.
``find_route``: The shortest ``Route`` from a position to any goal lanelet, led on straight for a length in m.
``Route``: Lanelets in driving order, and where among them the goal is.
``ego_route``: The ``EgoRoute`` of a planning problem; None where the goal has no place or cannot be reached.
``EgoRoute``: Lanelets from the ego's start to its goal, and the turns in rad at its junctions.
``TURN_RAD``: A heading change beyond this inside the lanelets of a junction is a turn.
``goal_lanelets``: Lanelets of a goal for planners: those that its regions touch, too; None for a free position.
``goal_center_lanelets``: Lanelets that a goal names, or that lie under the centre of its region; may be empty.
``goal_centers``: Centres (2,) in m of a goal's regions, one per goal state that has one.
``start_lanelets``: The lanelets of a pose; ``NotPossible`` if there are none.
``lanelets_of_pose``: The lanelets that a position and heading lie on, the one that fits best first; may be empty.
``lanelets_at``: All lanelets that a point lies on, ascending.
``straight_on``: A route with the straightest successors behind it, for a length in m.
``path_ahead``: Centre line (n, 2) in m from a lanelet on, along a route and then the straightest successors.
``center_line``: A lanelet's centre line (n, 2) in m without repeated vertices.
``straightness``: Cosine between the end of one polyline and the beginning of another, rounded to a tenth.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .ego_relations import EgoLane, ego_lane, is_own_recording, leader_and_follower
    from .map_matching import LaneMatch, MapMatcher, straightness
    from .occupancies import obstacle_of
    from .poses import lanelets_of_pose
    from .routing import (
        TURN_RAD,
        EgoRoute,
        Route,
        center_line,
        ego_route,
        find_route,
        goal_center_lanelets,
        goal_centers,
        goal_lanelets,
        lanelets_at,
        path_ahead,
        start_lanelets,
        straight_on,
    )
    from .scene import NOT_DRIVEN, Ego, Scene

__getattr__, __dir__ = lazy_face(__name__, __file__)
