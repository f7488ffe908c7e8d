"""The sensors between a scenario and a planner in an imperfect world: what they report about the road users and the
ego.

``Sensors``: The sensors of one run, which report the road users at each planning step.
``Percept``: What the sensors report at one planning step: road users, and the error of the ego's own pose.
``PoseError``: The difference between the pose that the ego believes it has and its true one.
``walls_of``: Returns the walls of a scenario's buildings, which hide road users.
``seen_shares``: Returns the share of each body's outline that is in view, and the body that hides most of it.
``RoadUsers``: The protocol of road users that can be sensed: moving and standing ones, as tracks.
``Bodies``: Rectangles as arrays, some of which hide what is behind them.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .sensors import Percept, PoseError, RoadUsers, Sensors
    from .visibility import Bodies, seen_shares, walls_of

__getattr__, __dir__ = lazy_face(__name__, __file__)
