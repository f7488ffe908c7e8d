"""Road networks: converts SUMO nets to lanelets and back, provides the graph of lanelets, and checks rules.

``build_road_network``: Returns all lanes of a SUMO net that road vehicles may use, as lanelets.
``remove_hairpins``: Deletes the connections of all lanes without valid bounds from a net, in place.
``Digraph``: A directed graph with searches: cheapest and shortest routes, costs, reachable nodes.
``GeoReference``: The location of a network's coordinates on earth: a PROJ string and an offset in m.
``lights_begin_at``: Returns a net with lights that are in their initial states after a given simulated time.
``net_over_lanelets``: Returns the ``.net.xml`` over a lanelet network, and the lanelets for vehicles as plain values.
``LaneletGraph``: Lanelet ids with their lengths in m, successors, predecessors and neighbours of the same direction.
``MOTOR_CLASSES``: SUMO's vehicle classes for motor vehicles on roads.
``NetEdge``: A road in one direction between two junctions, or the inside of a junction (``internal``).
``SumoNet``: A SUMO net as plain values.
``read_net``: Reads a SUMO net from an untrusted file.
``cap_speeds``: Lowers the speed limits of a net, in place, to what its curves allow; returns how many changed.
``convert_osm``: Converts an OSM extract to a SUMO net; returns netconvert's warnings.
``add_connections``: Connects the lanes of edges with those of the next edge in a net, in place; returns the warnings.
``remove_edges``: Removes edges from a net, in place; returns netconvert's warnings.
``Crossing``: A crossing of a SUMO net from one corner to another.
``Pavement``: A pavement of a SUMO net, in the direction of its road.
``WalkNet``: The footways of a SUMO net: pavements, crossings, corners.
``draw_walkways``: Returns pavements, crossings and corners as lanelets for pedestrians.
``yield_at_crossings``: Gives pedestrians right of way at all crossings without lights in a net, in place.
``read_walk_net``: Reads the pavements, corners and crossings of a SUMO net.
``Walkway``: A lanelet for pedestrians in both directions.
``stated_frictions``: Returns the friction coefficients of a net's lanes, with None for lanes that have none.
``run_netconvert``: Runs netconvert with options for good geometry inside junctions; returns its warnings.
``station_m``: Returns the arc length in m for a position word, a fraction or metres, at least 1 cm inside the lanelet.
``ROAD_DECIMALS``: The number of decimals of a road network's coordinates in a file.
``Incoming``: One arm of an intersection.
``LaneletLookup``: Finds lanelets of one network by position and heading.
``RoadLanelet``: A lanelet with the SUMO lane that it was made from.
``RoadNetwork``: All lanelets by id, with signs, lights and intersections.
``SpeedSign``: A speed limit in m/s, and the lanelets that it applies to.
``TrafficLight``: A light at the end of one lanelet, its cycle in steps.
``WIDEST_TURN_RAD``: A vehicle at a larger angle to a lanelet does not drive along it.
``check_file``: Runs all rules on a CommonRoad file.
``check_network``: Returns the rules' findings on a network: errors before warnings, and each in the order of the rules.
``summarise_findings``: Summarises the findings of one severity, with one text per rule.
``NetLayout``: The mapping lanelet ↔ SUMO edge and lane, fixed before anything is written.
``LONG_LANELET_M``: The length below which slowing down only for a lanelet's curve gains little.
``SlowPlaces``: Arc lengths in m on a lane where vehicles drive more slowly, and the speeds in m/s there.
``USUAL_SPEED_MPS``: The speed of a lanelet without a posted limit: 50 km/h.
``lowered_by_curves``: Returns speeds in m/s by lanelet, each at most what the lanelet's sharpest curve allows.
``posted_speeds``: Returns the lowest posted speed limit in m/s of each lanelet that has one.
``slow_places``: Returns where a polyline's curves require less than a given speed, and the speeds at these points.
``straight_speeds``: Returns the speed of every lanelet in m/s as if it were straight.
``Signal``: One traffic light of a lanelet network, with SUMO's letters for its phases.
``signals_of``: Returns the working lights of a lanelet network that belong to a lanelet and have a cycle, by id.
``sumo_net``: Returns the text of the ``.net.xml`` of a layout with its traffic lights.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .lanelet_builder import build_road_network, remove_hairpins
    from .lanelet_graph import Digraph, LaneletGraph
    from .lanelet_net import GeoReference, lights_begin_at, net_over_lanelets
    from .net_parser import MOTOR_CLASSES, NetEdge, SumoNet, read_net
    from .netconvert import add_connections, cap_speeds, convert_osm, remove_edges, run_netconvert, stated_frictions
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
