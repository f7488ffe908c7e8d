"""Synthetic scenarios and map evidence, in metres around a middle, for tests of the bench's judges."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plannerforge.engine.network.net_parser import ROAD_CLASSES, Connection, NetEdge, NetLane, SumoNet
from plannerforge.evals.scoring.made_files import MadeFiles
from plannerforge.evals.scoring.map_evidence import METRES_A_DEGREE, MapEvidence, Mapped
from plannerforge.schemas.generation import MapFacts, SiteType

NOTHING = MapEvidence(())
LATITUDE, LONGITUDE = 50.0, 10.0


@dataclass(frozen=True)
class Road:
    """A one-way road of a net between two junctions, from point to point in m."""

    key: str
    begin: str
    end: str
    points: Sequence[tuple[float, float]] = ((-50.0, 0.0), (50.0, 0.0))
    kind: str = "highway.secondary"
    name: str = ""


def made(roads: Sequence[Road], links: Sequence[tuple[str, ...]] = (), lit: Sequence[str] = ()) -> MadeFiles:
    """Return a scenario with its middle at (0, 0); ``links``: from road, to road, and SUMO's word for the turn (``s``).

    ``lit``: junctions with lights.
    """
    lanes = [NetLane(f"{r.key}_0", r.key, 0, 10.0, 3.2, ROAD_CLASSES, np.array(r.points), False) for r in roads]
    net = SumoNet(
        lanes={lane.lane_id: lane for lane in lanes},
        edges={r.key: NetEdge(r.key, r.begin, r.end, False, r.kind, r.name, (f"{r.key}_0",)) for r in roads},
        connections=tuple(
            Connection(a, b, f"{a}_0", f"{b}_0", None, (*turn, "s")[0], None, -1) for a, b, *turn in links
        ),
        junction_types=dict.fromkeys(lit, "traffic_light"),
        signals={},
        roundabout_edges=(),
        projection="",
        offset_m=(0.0, 0.0),
        lefthand=False,
    )
    return MadeFiles(net, np.zeros(2), LATITUDE, LONGITUDE, ())


def mapped(*offsets_m: tuple[float, float], **tags: str) -> Mapped:
    """Return something at (north, east) of the middle in m."""
    east_m = METRES_A_DEGREE * math.cos(math.radians(LATITUDE))
    places = [(LATITUDE + north / METRES_A_DEGREE, LONGITUDE + east / east_m) for north, east in offsets_m]
    return Mapped(np.array(places), tags)


def around(half_m: float, **tags: str) -> Mapped:
    """Return a square around the middle."""
    return mapped(*((half_m * a, half_m * b) for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1), (1, 1))), **tags)


def map_facts(sites: dict[SiteType, int]) -> MapFacts:
    """Return facts of a map of a square kilometre, with the given number of sites by type."""
    return MapFacts(
        map_id="map_drawn",
        file_name="drawn.osm",
        place="Redfield",
        places=("Redfield",),
        country=None,
        countries_near=(),
        south=LATITUDE,
        west=LONGITUDE,
        north=LATITUDE + 0.01,
        east=LONGITUDE + 0.01,
        streets=(),
        refs=(),
        sites=sites,
        road_km=5.0,
        attribution="drawn",
    )
