"""A recorded scenario prepared for simulation: its SUMO net, its vehicles on their lanelets, its ego.

``Scene``: a recorded scenario ready to be edited and simulated; ``Scene.of`` builds it from a loaded file.
``Ego``: a planning problem's start: position in m, heading in rad, speed in m/s, and the lanelets there.
``NOT_DRIVEN``: obstacle types that SUMO's vehicles cannot represent.
``obstacle_of``: returns the id of the obstacle that a track belongs to.
``MapMatcher``: the drivable lanelets of a network, ready for queries by position: which lanelets a track drove on.
``LaneMatch``: the lanelets of a track, by index into the track.
``EgoLane``: the lane that the ego follows; describes where a vehicle is.
``ego_lane``: returns the ``EgoLane`` from the ego's start along its route to its goal; None if the ego does not start
on a lanelet.
``leader_and_follower``: returns the ids of the nearest vehicles ahead and behind along the ego's lane, or None.
``is_own_recording``: returns whether a track starts at the ego's position, heading and speed.
``find_route``: returns the shortest ``Route`` from a position to any goal lanelet, continued straight for a length.
``Route``: lanelets in driving order, and the index of the goal.
``ego_route``: returns the ``EgoRoute`` of a planning problem; None if the goal has no position or cannot be reached.
``EgoRoute``: lanelets from the ego's start to its goal, and the turns in rad at its junctions.
``has_roundabout``: whether lanelets form a circular junction.
``sides_of``: a lanelet's neighbours on the left and on the right, and whether each leads in its direction.
``BACK_RAD``: a turn beyond this leads back where the ego came from.
``TURN_RAD``: a heading change beyond this inside the lanelets of a junction is a turn.
``goal_lanelets``: returns a goal's lanelets for planners, including touched ones; None for a free position.
``goal_center_lanelets``: returns the lanelets that a goal lists, or those under the centre of its region; may be empty.
``goal_centers``: returns the centres (2,) in m of a goal's regions, one per goal state that has one.
``start_lanelets``: returns the lanelets of a pose; raises ``NotPossible`` if there are none.
``lanelets_of_pose``: returns the lanelets that a pose is on, best fit first; may be empty.
``lanelets_at``: returns all lanelets that a point is on, ascending.
``straight_on``: returns a route extended by its straightest successors for a length in m.
``path_ahead``: returns the centre line (n, 2) in m from a lanelet along a route, then along the straightest successors.
``center_line``: returns a lanelet's centre line (n, 2) in m without repeated vertices.
``straightest_ahead``: returns the lanelet that continues a line most straight.
``straightest_behind``: returns the lanelet that leads most straight to the start of a line.
``straightness``: returns the cosine between the end of one polyline and the start of another, rounded to a tenth.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .ego_relations import EgoLane, ego_lane, is_own_recording, leader_and_follower
    from .map_matching import LaneMatch, MapMatcher, straightness
    from .occupancies import obstacle_of
    from .poses import lanelets_of_pose
    from .roundabouts import has_roundabout, sides_of
    from .routing import (
        BACK_RAD,
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
        straightest_ahead,
        straightest_behind,
    )
    from .scene import NOT_DRIVEN, Ego, Scene

__getattr__, __dir__ = lazy_face(__name__, __file__)
