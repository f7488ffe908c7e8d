"""Road networks: converts SUMO nets to lanelets and back, provides the graph of lanelets, and checks rules.

``build_road_network``: Return all lanes of a SUMO net that road vehicles may use, as lanelets.
``remove_hairpins``: Delete the connections of all lanes without valid bounds from a net, in place.
``Digraph``: A directed graph with searches: cheapest and shortest routes, costs, reachable nodes.
``GeoReference``: The location of a network's coordinates on earth: a PROJ string and an offset in m.
``lights_begin_at``: Return a net with lights that, after some simulated time, are as they were at its beginning.
``net_over_lanelets``: Return the ``.net.xml`` over a lanelet network, and its driven lanelets as plain values.
``LaneletGraph``: Lanelet ids with their lengths in m, successors, predecessors and neighbours of the same direction.
``MOTOR_CLASSES``: SUMO's classes of motor vehicles on roads.
``NetEdge``: A road in one direction between two junctions, or the inside of a junction (``internal``).
``SumoNet``: A SUMO net as plain values.
``read_net``: Read a SUMO net from an untrusted file.
``cap_speeds``: Lower the speed limits of a net, in place, to what its curves allow; return how many changed.
``convert_osm``: Convert an OSM extract to a SUMO net; return netconvert's warnings.
``remove_edges``: Remove edges from a net, in place; return netconvert's warnings.
``Crossing``: A crossing of a SUMO net from one corner to another.
``Pavement``: A pavement of a SUMO net, in the direction of its road.
``WalkNet``: The footways of a SUMO net: pavements, crossings, corners.
``draw_walkways``: Return pavements, crossings and corners as lanelets for pedestrians.
``yield_at_crossings``: Give pedestrians right of way at all crossings without lights of a net, in place.
``read_walk_net``: Read the pavements, corners and crossings of a SUMO net.
``Walkway``: A lanelet for pedestrians in both directions.
``stated_frictions``: Return the friction coefficients of a net's lanes; None among them if a lane has none.
``run_netconvert``: Run netconvert with options for good geometry inside junctions; return its warnings.
``station_m``: Return the arc length in m for a position word, a fraction or metres, at least 1 cm inside the lanelet.
``ROAD_DECIMALS``: Decimals of the coordinates of a road network in a file.
``Incoming``: One arm of an intersection.
``LaneletLookup``: Finds lanelets of one network by position and heading.
``RoadLanelet``: A lanelet with the SUMO lane that it was made from.
``RoadNetwork``: All lanelets by id, with signs, lights and intersections.
``SpeedSign``: A speed limit in m/s that applies to some lanelets.
``TrafficLight``: A light at the end of one lanelet, its cycle in steps.
``WIDEST_TURN_RAD``: A vehicle at a larger angle to a lanelet does not drive along it.
``check_file``: Run all rules on a CommonRoad file.
``check_network``: Return the rules' findings about a network, errors before warnings, otherwise in rule order.
``summarise_findings``: Summarise the findings of one severity, one text per rule.
``NetLayout``: The mapping lanelet ↔ SUMO edge and lane, fixed before anything is written.
``LONG_LANELET_M``: On shorter lanelets, slowing down only for the curve gains little.
``SlowPlaces``: Arc lengths in m on a lane where vehicles drive more slowly, and the speeds in m/s there.
``USUAL_SPEED_MPS``: Speed of a lanelet without a posted limit: 50 km/h.
``lowered_by_curves``: Return speeds in m/s by lanelet, each at most what the lanelet's sharpest curve allows.
``posted_speeds``: Return the lowest speed limit in m/s that signs post, for lanelets that have one.
``slow_places``: Return where a polyline's curves require less than a speed, and the speeds there.
``straight_speeds``: Return the speed of every lanelet in m/s as if it were straight.
``Signal``: One traffic light of a lanelet network, with SUMO's letters for its phases.
``signals_of``: Return the working lights of a lanelet network that belong to a lanelet and have a cycle, by id.
``sumo_net``: Return the text of the ``.net.xml`` of a layout with its traffic lights.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .lanelet_builder import build_road_network, remove_hairpins
    from .lanelet_graph import Digraph, LaneletGraph
    from .lanelet_net import GeoReference, lights_begin_at, net_over_lanelets
    from .net_parser import MOTOR_CLASSES, NetEdge, SumoNet, read_net
    from .netconvert import cap_speeds, convert_osm, remove_edges, run_netconvert, stated_frictions
    from .positions import station_m
    from .road_network import (
        ROAD_DECIMALS,
        WIDEST_TURN_RAD,
        Incoming,
        LaneletLookup,
        RoadLanelet,
        RoadNetwork,
        SpeedSign,
        TrafficLight,
        Walkway,
    )
    from .rules.check import check_file, check_network, summarise_findings
    from .sumo_export.layout import NetLayout
    from .sumo_export.speeds import (
        LONG_LANELET_M,
        USUAL_SPEED_MPS,
        SlowPlaces,
        lowered_by_curves,
        posted_speeds,
        slow_places,
        straight_speeds,
    )
    from .sumo_export.writer import Signal, signals_of, sumo_net
    from .walk_net import Crossing, Pavement, WalkNet, draw_walkways, read_walk_net, yield_at_crossings

__getattr__, __dir__ = lazy_face(__name__, __file__)
