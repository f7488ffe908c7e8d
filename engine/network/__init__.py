"""Road networks: SUMO nets to lanelets and lanelets to SUMO nets, the graph of lanelets, the rules.

``build_road_network``: All lanes of a SUMO net that road vehicles may use, as lanelets.
``remove_hairpins``: Delete the connections of all lanes that have no valid bounds from a net, in place.
``Digraph``: A directed graph, and the searches in it: cheapest and shortest routes, costs, what can be reached.
``GeoReference``: How coordinates of a network lie on earth: a PROJ string and an offset in m.
``lights_begin_at``: A net whose lights are after some simulated time as they were at its beginning.
``net_over_lanelets``: The ``.net.xml`` over a lanelet network, and its driven lanelets as plain values.
``LaneletGraph``: Lanelet ids with their lengths in m, successors, predecessors and neighbours of the same direction.
``MOTOR_CLASSES``: SUMO's classes of motor vehicles on roads.
``NetEdge``: A road in one direction between two junctions, or the inside of a junction (``internal``).
``SumoNet``: A SUMO net as plain values.
``read_net``: Read a SUMO net from a file that is not trusted.
``cap_speeds``: Lower the speed limits of a net, in place, to what the curves of its lanes allow; how many changed.
``convert_osm``: Turn an OSM extract into a SUMO net; netconvert's warnings.
``remove_edges``: Take edges out of a net, in place; netconvert's warnings.
``Crossing``: A crossing of a SUMO net from one corner to another.
``Pavement``: A pavement of a SUMO net, in the direction of its road.
``WalkNet``: Where people walk in a SUMO net: pavements, crossings, corners.
``draw_walkways``: Pavements, crossings and corners as lanelets for pedestrians.
``yield_at_crossings``: Give pedestrians the right of way at all crossings of a net without lights, in place.
``read_walk_net``: The pavements, corners and crossings of a SUMO net.
``Walkway``: A lanelet for pedestrians in both directions.
``stated_frictions``: The coefficients of friction that the lanes of a net state; None among them if a lane states none.
``run_netconvert``: Run netconvert with the options and those for good geometry inside junctions; its warnings.
``station_m``: Arc length in m for a position word, a fraction or metres, at least a centimetre inside the lanelet.
``ROAD_DECIMALS``: Decimals of the coordinates of a road network in a file.
``Incoming``: One arm of an intersection.
``LaneletLookup``: Finds lanelets of one network by position and heading.
``RoadLanelet``: A lanelet with the SUMO lane that it was made from.
``RoadNetwork``: All lanelets by id, with signs, lights and intersections.
``SpeedSign``: A speed limit in m/s that holds on some lanelets.
``TrafficLight``: A light at the end of one lanelet, its cycle in steps.
``WIDEST_TURN_RAD``: The angle between a vehicle and a lanelet from which on it does not drive along it.
``check_file``: Run all rules on a CommonRoad file.
``check_network``: What the rules find in a network, errors before warnings, otherwise in the order of the rules.
``summarise_findings``: Findings of one severity in words, one text a rule.
``NetLayout``: The mapping lanelet ↔ SUMO edge and lane, fixed before anything is written.
``LONG_LANELET_M``: On a lanelet no longer than this, slowing down for its curve alone gains little.
``SlowPlaces``: Arc lengths in m on a lane where it is driven slower, and the speeds in m/s there.
``USUAL_SPEED_MPS``: Speed of a lanelet for which nothing is posted: 50 km/h.
``lowered_by_curves``: Speeds in m/s by lanelet, each no more than the sharpest curve of the lanelet allows.
``posted_speeds``: The lowest speed limit in m/s that signs of a lanelet post, for lanelets that have one.
``slow_places``: Where the curves of a polyline are driven slower than a speed, and how fast.
``straight_speeds``: Speed of every lanelet in m/s as if it were straight.
``Signal``: One traffic light of a lanelet network, with SUMO's letters for its phases.
``signals_of``: The working lights of a lanelet network that stand at a lanelet and have a cycle, by ascending id.
``sumo_net``: The text of the ``.net.xml`` of a layout with its traffic lights.
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
