"""The input of the modification bench's judges: the base, the written file, and the content of SUMO.

Vehicle types come from the file that SUMO started with, routes from SUMO's own record, and the net is the one kept with
every scenario.

CommonRoad's schema cannot express a road user that enters after time 0: the ``initialState`` of a ``dynamicObstacle``
is at time 0, and a ``phantomObstacle``, which may begin later, is not a real road user and has no type. CommonRoad's
own reader accepts any time. So a vehicle that the request lets enter later causes one unavoidable error, which is
reported separately.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from lxml import etree

from plannerforge.engine.commonroad import LoadedScenario, Track, read_scenario, recorded_tracks, schema_errors
from plannerforge.engine.cosimulation import ROUTES_FILE, TYPES_FILE
from plannerforge.engine.edits.apply import NET_FILE
from plannerforge.engine.geometry import Points
from plannerforge.engine.scene import Scene
from plannerforge.schemas.modification import ModificationOutcome

from ..tracks import fronts

Truth = Mapping[str, Any]
"""The ground truth of an edit in the corpus's form."""
ENTRY = "initialState/time/exact"
SAME_LINE_M = 0.3
"""A lanelet's centre line this close to a lane's is the same lane."""
MARGIN_M = 1.0
"""A vehicle up to this far from a lane is still on its route."""
ENDS = (0.1, 0.5, 0.9)
"""The shares of a lanelet's length at which it must be on a lane to be that lane."""


@dataclass(frozen=True)
class Written:
    """The base as read, the ground truth of all edits, the report, the resulting file, and SUMO's record.

    ``old`` and ``new``: the trajectories of both files.
    """

    base: Path
    scene: Scene
    truths: tuple[Truth, ...]
    outcome: ModificationOutcome
    xml: Path
    loaded: LoadedScenario
    old: Mapping[int, Track]
    new: Mapping[int, Track]
    sumo: "_SumoRecord"

    @classmethod
    def of(cls, base: Path, scene: Scene, truths: tuple[Truth, ...], outcome: ModificationOutcome) -> "Written":
        """Read the new file and the files kept next to it."""
        if outcome.xml is None:
            raise ValueError("a dry run wrote nothing to check")
        loaded = read_scenario(outcome.xml)
        tracks = recorded_tracks(loaded.scenario)
        return cls(
            base, scene, truths, outcome, outcome.xml, loaded, scene.tracks, tracks, _SumoRecord.of(outcome.xml.parent)
        )

    def added(self) -> tuple[int, ...]:
        """Return ids of the road users that the base lacks."""
        return tuple(key for key in self.new if key not in self.old)

    def vehicles_of_edit(self, index: int) -> frozenset[int]:
        """Return the ids of the vehicles that the edit at an index refers to, by the ground truth.

        Only if that leaves it open, as for a vehicle that another edit adds, the report decides.
        """
        truth, reports = self.truths[index], self.outcome.edits
        if "vehicle_id" in truth:
            return frozenset([int(truth["vehicle_id"])])
        selector = truth.get("selector", {})
        added = [*selector.get("include_new", ()), *([selector["edit"]] if selector.get("by") == "new" else ())]
        named = truth.get("vehicle_ids")
        if named is None:
            return frozenset(reports[index].vehicles)
        return frozenset(named).union(*(reports[edit].vehicles for edit in added))

    def vehicles_to_remove(self) -> frozenset[int]:
        """Return ids of all road users that the edits remove."""
        going = [index for index, truth in enumerate(self.truths) if truth["op"] == "remove_vehicle"]
        return frozenset().union(*(self.vehicles_of_edit(index) for index in going))


def entry_step(scene: Scene, truth: Truth) -> int:
    """Return the requested entry step of the vehicles that an edit adds."""
    return round((truth.get("depart_s") or 0.0) / scene.step_s)


def is_valid(written: Written) -> bool:
    """Return True if there is no new schema error, except that of vehicles that enter later on request.

    commonroad-io has already read the file.
    """
    tree = etree.parse(written.loaded.path)
    excused = {str(key) for key in enter_later_on_request(written)}
    for obstacle in tree.getroot():
        entry = obstacle.find(ENTRY) if obstacle.get("id") in excused else None
        if entry is not None:
            entry.text = "0"
    return _anonymous(schema_errors(tree), written.loaded) <= _known(written)


def is_strictly_valid(written: Written) -> bool:
    """Return True if there is no schema error that the source does not have."""
    return _anonymous(schema_errors(written.loaded.path), written.loaded) <= _known(written)


def enter_later_on_request(written: Written) -> frozenset[int]:
    """Return the ids of the added vehicles that enter after time 0 because an edit requests it, at that step or later.

    Another check judges whether they enter as soon as possible.
    """
    later: set[int] = set()
    for truth, report in zip(written.truths, written.outcome.edits, strict=True):
        asked = entry_step(written.scene, truth)
        if truth["op"] == "add_vehicle" and asked > 0:
            added = [key for key in report.vehicles if key in written.added()]
            later.update(key for key in added[: truth["count"]] if written.new[key].first_step >= asked)
    return frozenset(later)


def _known(written: Written) -> set[str]:
    return _anonymous(schema_errors(written.scene.loaded.path), written.scene.loaded)


def _anonymous(errors: list[str], loaded: LoadedScenario) -> set[str]:
    """Return errors without the file's id: an id that breaks the pattern does so in both files, but differs."""
    return {error.replace(loaded.declared_id, "") for error in errors}


@dataclass(frozen=True)
class _Lane:
    """A lane of the net: its middle line, and its width in m."""

    line: shapely.LineString
    width_m: float


@dataclass(frozen=True)
class _SumoRecord:
    """Attributes of each vehicle's type and the edges of its route, by vehicle id; lanes by edge and by way across.

    ``across``: the lanes through a junction from one edge to the next.
    """

    types: Mapping[int, Mapping[str, str]]
    routes: Mapping[int, tuple[str, ...]]
    lanes: Mapping[str, tuple[_Lane, ...]]
    across: Mapping[tuple[str, str], tuple[_Lane, ...]]

    @classmethod
    def of(cls, folder: Path) -> "_SumoRecord":
        """Read the files of a folder; without a simulation no vehicle has a type or a route."""
        types, routes = dict[int, Mapping[str, str]](), dict[int, tuple[str, ...]]()
        if (folder / ROUTES_FILE).exists():
            known = {str(one.get("id")): dict(one.attrib) for one in _elements(folder / TYPES_FILE, "vType")}
            for vehicle in _elements(folder / ROUTES_FILE, "vehicle"):
                if str(vehicle.get("id")).isdigit():
                    types[int(vehicle.get("id"))] = known[str(vehicle.get("type"))]
                    routes[int(vehicle.get("id"))] = tuple(str(vehicle.find("route").get("edges")).split())
        lanes, across = _net(folder / NET_FILE)
        return cls(types, routes, lanes, across)

    def leads_over(self, vehicle_id: int, center_line: Points) -> bool:
        """Return True if a vehicle's route has a lane along a lanelet's centre line (n, 2)."""
        line = shapely.LineString(center_line)
        points = [line.interpolate(share, normalized=True) for share in ENDS]
        return any(
            all(lane.line.distance(point) <= SAME_LINE_M for point in points) for lane in self._lanes_of(vehicle_id)
        )

    def share_on_route(self, track: Track) -> float:
        """Return the share of states with the centre or front on the lanes of the vehicle's route, or within 1 m."""
        lanes = self._lanes_of(track.obstacle_id)
        area = shapely.union_all([lane.line.buffer(lane.width_m / 2 + MARGIN_M) for lane in lanes])
        centres, ahead = (shapely.contains_xy(area, *points.T) for points in (track.positions, fronts(track)))
        return float(np.mean(centres | ahead))

    def _lanes_of(self, vehicle_id: int) -> list[_Lane]:
        edges = self.routes.get(vehicle_id, ())
        found = [lane for edge in edges for lane in self.lanes.get(edge, ())]
        return found + [lane for pair in pairwise(edges) for lane in self.across.get(pair, ())]


def _net(path: Path) -> tuple[dict[str, tuple[_Lane, ...]], dict[tuple[str, str], tuple[_Lane, ...]]]:
    root = etree.parse(path).getroot()
    by_lane = {str(lane.get("id")): _lane(lane) for lane in root.iter("lane")}
    lanes = {
        str(edge.get("id")): tuple(by_lane[str(lane.get("id"))] for lane in edge.iter("lane"))
        for edge in root.iter("edge")
    }
    across = dict[tuple[str, str], tuple[_Lane, ...]]()
    for connection in root.iter("connection"):
        via = by_lane.get(str(connection.get("via")))
        if via is not None:
            pair = (str(connection.get("from")), str(connection.get("to")))
            across[pair] = (*across.get(pair, ()), via)
    return lanes, across


def _lane(element: Any) -> _Lane:
    points = [tuple(map(float, point.split(",")[:2])) for point in str(element.get("shape")).split()]
    return _Lane(shapely.LineString(points), float(element.get("width", "3.2")))


def _elements(path: Path, tag: str) -> list[Any]:
    return list(etree.parse(path).getroot().iter(tag))
