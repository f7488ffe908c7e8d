"""Scenarios made from maps: site, network, traffic, ego and goal, file, checks.

``generate_scenario``: Make one scenario in the request's folder; an operation for a worker.
``check_scenario``: What others will find in a written scenario: schema, goal, collisions, feasibility, road network.
``convert_map``: Convert an OpenStreetMap extract to a SUMO net on which cars can drive, with notes on the settings.
``count_sites``: The number of different sites of a map that fit a request; an operation for a worker.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .checks import check_scenario
    from .generator import generate_scenario
    from .site_network import convert_map
    from .sites import count_sites

__getattr__, __dir__ = lazy_face(__name__, __file__)
