"""A manoeuvre at a ring or a junction is named by the directions of the arms, whatever the size of the site."""

import math
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.execution import silent
from plannerforge.engine.generation.generator import generate_scenario
from plannerforge.engine.generation.site_network import prepare_site
from plannerforge.engine.generation.sites import fitting_sites, middle_of
from plannerforge.engine.generation.turns import turn_made
from plannerforge.engine.geometry import resample
from plannerforge.engine.geometry.polyline import headings
from plannerforge.engine.maps.drawn_library import Sketch
from plannerforge.engine.maps.osm import read_osm
from plannerforge.engine.network import LaneletLookup
from plannerforge.engine.network.lanelet_graph import LaneletGraph
from plannerforge.engine.network.net_parser import read_net
from plannerforge.engine.scene.routing import center_line, ego_route
from plannerforge.engine.traffic import OpenEdges
from plannerforge.engine.traffic.motions import GeneratedVehicle
from plannerforge.engine.vehicles import vehicle_classes
from plannerforge.engine.vehicles.motion import Motion
from plannerforge.schemas.errors import NotPossible, with_values
from plannerforge.schemas.generation import GenerationRequest, Turn

pytestmark = pytest.mark.usefixtures("unknown_sites")


def request_in(folder: Path, sketch: Sketch, **changes: Any) -> GenerationRequest:
    sketch.write(folder / "map.osm")
    wish = {"map_path": str(folder / "map.osm"), "map_id": "map_town", "place": "Town", "country": "ZAM"}
    return GenerationRequest.model_validate({**wish, "attribution": "", "folder": str(folder), **changes})


def circle(radius_m: float, angles_deg: list[float]) -> list[tuple[float, float]]:
    return [(radius_m * math.cos(math.radians(one)), radius_m * math.sin(math.radians(one))) for one in angles_deg]


def ring_with_islands(radius_m: float, island_m: float) -> Sketch:
    """Four arms at right angles; before the ring, each splits around an island into an entry and an exit."""
    sketch = Sketch("Town", 50.0, 8.0)
    ring = circle(radius_m, [quarter + aside for quarter in (0.0, 90.0, 180.0, 270.0) for aside in (25.0, 45.0, 65.0)])
    sketch.road([*ring, ring[0]], "secondary", "Ring", junction="roundabout")
    for number, arm in enumerate((0.0, 90.0, 180.0, 270.0)):
        leaves, enters = circle(radius_m, [(arm - 25) % 360, arm + 25])
        splits, ends = circle(radius_m + island_m, [arm])[0], circle(radius_m + island_m + 150.0, [arm])[0]
        sketch.road([leaves, splits], "secondary", f"Street {number}", oneway="yes")
        sketch.road([splits, enters], "secondary", f"Street {number}", oneway="yes")
        sketch.road([splits, ends], "secondary", f"Street {number}")
    return sketch


@pytest.mark.parametrize(("radius_m", "island_m"), [(7.0, 14.0), (16.0, 20.0), (40.0, 25.0)])
def test_ways_round_a_ring_of_any_size_have_the_turn_of_their_arms(
    tmp_path: Path, radius_m: float, island_m: float
) -> None:
    request = request_in(tmp_path, ring_with_islands(radius_m, island_m), scenario_type="roundabout")
    osm = read_osm(tmp_path / "map.osm")
    (site,) = fitting_sites(osm, request)
    built = prepare_site(request, osm, site, tmp_path, silent)
    ways = built.focus.ways
    assert ways is not None
    turns = Counter(turn for turn, _ in ways.through(OpenEdges.of(built.net, "passenger")))
    assert turns == {"left": 4, "right": 4, "straight": 4, "u_turn": 4}


@pytest.mark.parametrize(("aside_deg", "is_near"), [(8.0, True), (-8.0, False)])
def test_a_way_to_an_arm_beside_its_own_turns_by_its_path_around_the_ring(
    tmp_path: Path, aside_deg: float, is_near: bool
) -> None:
    """Two roads come from nearly the same direction; the next exit is to the right, the one before it to the left."""
    sketch = Sketch("Town", 50.0, 8.0)
    ring = circle(20.0, [float(one) for one in range(0, 360, 15)])
    sketch.road([*ring, ring[0]], "secondary", "Ring", junction="roundabout")
    for name, leaves_deg, ends_deg in (
        ("Asked", 180.0, 180.0),
        ("Beside", 180.0 + math.copysign(45.0, aside_deg), 180.0 + aside_deg),
    ):
        near, far = circle(20.0, [leaves_deg])[0], circle(45.0, [ends_deg])[0]
        sketch.road([near, far, *circle(250.0, [ends_deg])], "secondary", name)
    sketch.road([*circle(20.0, [0.0]), *circle(250.0, [0.0])], "secondary", "East Road")
    request = request_in(tmp_path, sketch, scenario_type="roundabout")
    osm = read_osm(tmp_path / "map.osm")
    (site,) = fitting_sites(osm, request)
    built = prepare_site(request, osm, site, tmp_path, silent)
    assert built.focus.ways is not None
    edges = built.net.edges
    (turn,) = (
        turn
        for turn, way in built.focus.ways.through(OpenEdges.of(built.net, "passenger"))
        if (edges[way[0]].name, edges[way[-1]].name) == ("Asked", "Beside")
    )
    assert turn == ("right" if is_near else "left")


@pytest.mark.parametrize("ends", [[(2.0, 30.0), (0.0, 45.0)], [(14.0, 45.0), (-8.0, 45.0)]])
def test_a_road_that_ends_with_the_map_where_its_carriageways_meet_is_no_arm(
    tmp_path: Path, ends: list[tuple[float, float]]
) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    ring = circle(20.0, [float(one) for one in range(0, 360, 15)])
    sketch.road([*ring, ring[0]], "secondary", "Ring", junction="roundabout")
    sketch.road([*circle(20.0, [60.0]), *ends], "secondary", "North Road", oneway="yes")
    sketch.road([ends[-1], *circle(20.0, [120.0])], "secondary", "North Road", oneway="yes")
    for name, arm in (("East Road", 0.0), ("West Road", 180.0)):
        sketch.road([*circle(20.0, [arm]), *circle(250.0, [arm])], "secondary", name)
    request = request_in(tmp_path, sketch, scenario_type="roundabout")
    osm = read_osm(tmp_path / "map.osm")
    (site,) = fitting_sites(osm, request)
    built = prepare_site(request, osm, site, tmp_path, silent)
    assert built.focus.ways is not None
    ways = list(built.focus.ways.through(OpenEdges.of(built.net, "passenger")))
    assert {turn for turn, _ in ways} == {"straight", "u_turn"}
    assert {built.net.edges[way[end]].name for _, way in ways for end in (0, -1)} == {"East Road", "West Road"}


def two_crossings(between_m: float) -> Sketch:
    """A main street with two side streets that cross it close together."""
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-250, 0), (0, 0), (between_m, 0), (250, 0)], "tertiary", "Main Street")
    sketch.road([(0, -200), (0, 0), (0, 200)], "residential", "First Street")
    sketch.road([(between_m, -200), (between_m, 0), (between_m, 200)], "residential", "Second Street")
    return sketch


def test_ways_through_a_named_crossing_turn_there_and_not_at_its_neighbour(tmp_path: Path) -> None:
    streets = [["Main Street"], ["Second Street"]]
    request = request_in(tmp_path, two_crossings(25.0), scenario_type="intersection", streets=streets)
    osm = read_osm(tmp_path / "map.osm")
    built = prepare_site(request, osm, fitting_sites(osm, request)[0], tmp_path, silent)
    assert built.focus.ways is not None
    ways = list(built.focus.ways.through(OpenEdges.of(built.net, "passenger")))
    assert Counter(turn for turn, _ in ways) == {"left": 4, "right": 4, "straight": 4}
    assert all({built.net.edges[edge].name for edge in way} <= {"Main Street", "Second Street"} for _, way in ways)


def test_an_ego_turns_at_the_named_crossing_and_has_its_goal_before_the_next_turn(tmp_path: Path) -> None:
    streets = [["Main Street"], ["Second Street"]]
    wish = {"scenario_type": "intersection", "goal": "through:left", "duration_s": 8.0, "density": "low"}
    request = request_in(tmp_path, two_crossings(25.0), streets=streets, **wish)
    generate_scenario(request, silent)
    loaded = read_scenario(tmp_path / "scenario.xml")
    network = loaded.scenario.lanelet_network
    route = ego_route(network, LaneletGraph.of(network), loaded.problem())
    assert route is not None
    assert route.turns == ("left",)
    (site,) = fitting_sites(read_osm(tmp_path / "map.osm"), request)
    line = np.concatenate([center_line(network, key) for key in route.lanelets])
    assert np.linalg.norm(line - middle_of(site, read_net(tmp_path / "scenario.net.xml")), axis=1).min() < 6.0


def test_a_ring_of_junction_circular_is_built(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    ring = circle(15.0, [float(one) for one in range(0, 360, 30)])
    sketch.road([*ring, ring[0]], "residential", "Square", junction="circular", oneway="yes")
    for number, arm in enumerate((0.0, 90.0, 180.0, 270.0)):
        sketch.road([*circle(15.0, [arm]), *circle(200.0, [arm])], "residential", f"Street {number}")
    request = request_in(tmp_path, sketch, scenario_type="roundabout")
    osm = read_osm(tmp_path / "map.osm")
    (site,) = fitting_sites(osm, request)
    assert prepare_site(request, osm, site, tmp_path, silent).focus.ways is not None


def test_a_ring_with_two_junctions_is_built_as_a_closed_one(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    ring = circle(12.0, [float(one) for one in range(0, 360, 30)])
    sketch.road([*ring, ring[0]], "residential", "Square", junction="roundabout")
    sketch.road([ring[0], (200.0, 10.0)], "residential", "East Street")
    sketch.road([ring[2], (60.0, 200.0)], "residential", "North Street")
    request = request_in(tmp_path, sketch, scenario_type="roundabout")
    osm = read_osm(tmp_path / "map.osm")
    (site,) = fitting_sites(osm, request)
    built = prepare_site(request, osm, site, tmp_path, silent)
    assert built.focus.ways is not None
    inside = built.focus.ways.inside
    assert {turn.to_edge for turn in built.net.connections if {turn.from_edge, turn.to_edge} <= inside} == inside


def test_a_ring_open_in_both_directions_is_refused_as_that(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    ring = circle(15.0, [float(one) for one in range(0, 360, 30)])
    sketch.road([*ring, ring[0]], "residential", "Square", junction="roundabout", oneway="no")
    for number, arm in enumerate((0.0, 90.0, 180.0)):
        sketch.road([*circle(15.0, [arm]), *circle(300.0, [arm])], "residential", f"Street {number}")
    request = request_in(tmp_path, sketch, scenario_type="roundabout", streets=[["Square"]])
    with pytest.raises(NotPossible, match="way/1 is tagged as a roundabout, but is open in both directions") as caught:
        fitting_sites(read_osm(tmp_path / "map.osm"), request)
    changes = caught.value.remedies[0].changes[0].values
    assert changes is not None
    assert fitting_sites(read_osm(tmp_path / "map.osm"), request.model_copy(update=changes))


def test_streets_that_do_not_meet_come_with_the_nearest_crossing(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-300, 0), (0, 0), (300, 0), (600, 0)], "residential", "North Road")
    for x in (-300, 0, 300):
        sketch.road([(x, 0), (x, 200 - 0.5 * x)], "residential", f"Lane {x}")
    sketch.road([(600, 60), (600, 400)], "residential", "Far Road")
    sketch.road([(600, 60), (900, 60)], "residential", "Farther Road")
    streets = [["North Road"], ["Far Road"]]
    request = request_in(tmp_path, sketch, scenario_type="intersection", streets=streets)
    with pytest.raises(NotPossible, match="do not meet") as caught:
        fitting_sites(read_osm(tmp_path / "map.osm"), request)
    assert caught.value.remedies[0] == with_values(place="North Road / Lane 300, Town")


def ring_with_a_bent_arm() -> Sketch:
    """A ring with four arms; the last one bends until it runs beside the arm before it."""
    sketch = Sketch("Town", 50.0, 8.0)
    ring = circle(16.0, [0.0, 45.0, 90.0, 135.0, 180.0, 215.0, 250.0, 305.0])
    sketch.road([*ring, ring[0]], "secondary", "Ring", junction="roundabout")
    for number, angle in enumerate((0.0, 90.0, 180.0)):
        sketch.road([circle(16.0, [angle])[0], circle(180.0, [angle])[0]], "secondary", f"Street {number}")
    begin = circle(16.0, [250.0])[0]
    sketch.road([begin, (begin[0] - 6.0, begin[1] - 12.0), (-30.0, -32.0), (-180.0, -32.0)], "secondary", "Bent Street")
    return sketch


def test_a_u_turn_leads_back_to_its_own_arm_and_not_to_a_road_that_bends_beside_it(tmp_path: Path) -> None:
    request = request_in(tmp_path, ring_with_a_bent_arm(), scenario_type="roundabout")
    osm = read_osm(tmp_path / "map.osm")
    (site,) = fitting_sites(osm, request)
    built = prepare_site(request, osm, site, tmp_path, silent)
    ways = built.focus.ways
    assert ways is not None
    names = [
        (turn, built.net.edges[way[0]].name, built.net.edges[way[-1]].name)
        for turn, way in ways.through(OpenEdges.of(built.net, "passenger"))
    ]
    assert sum(turn == "u_turn" for turn, _, _ in names) == 4
    assert all((turn == "u_turn") == (begins == ends) for turn, begins, ends in names)


def test_the_ego_drives_along_a_requested_street_and_not_along_one_beside_it(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-600, 0), (0, 0), (600, 0)], "secondary", "Main Road")
    for aside in (45, -45):
        sketch.road([(-600, aside), (0, aside), (600, aside)], "secondary", f"Road {aside}")
    wish = {"scenario_type": "rural", "streets": [["Main Road"]], "density": "low", "duration_s": 10.0}
    of_the_street = request_in(tmp_path, sketch, most_rounds=1, **wish)
    for seed in range(4):
        request = of_the_street.model_copy(update={"seed": seed})
        generate_scenario(request, silent)
        loaded = read_scenario(tmp_path / "scenario.xml")
        route = ego_route(
            loaded.scenario.lanelet_network, LaneletGraph.of(loaded.scenario.lanelet_network), loaded.problem()
        )
        assert route is not None
        (site, *_) = fitting_sites(read_osm(tmp_path / "map.osm"), request)
        line = np.concatenate([center_line(loaded.scenario.lanelet_network, key) for key in route.lanelets])
        middle = middle_of(site, read_net(tmp_path / "scenario.net.xml"))
        assert np.abs(line[:, 1] - middle[1]).max() < 10.0


def test_road_classes_that_exclude_a_named_street_are_dropped_by_the_first_suggestion(tmp_path: Path) -> None:
    wish = {"streets": [["Main Street"], ["First Street"]], "road_classes": ["tertiary"]}
    request = request_in(tmp_path, two_crossings(60.0), **wish)
    with pytest.raises(NotPossible, match="First Street") as caught:
        fitting_sites(read_osm(tmp_path / "map.osm"), request)
    assert caught.value.remedies[0] == with_values(road_classes=None)


def two_motorways() -> Sketch:
    """Two motorways side by side, with a link from the first to the second, and one that leads back to the first."""
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-300, 0), (0, 0), (150, 0), (300, 0)], "motorway", ref="A 1", oneway="yes")
    sketch.road([(-300, -60), (150, -60), (300, -60)], "motorway", ref="A 2", oneway="yes")
    sketch.road([(0, 0), (40, -6), (110, -54), (150, -60)], "motorway_link", oneway="yes")
    sketch.road([(0, 0), (40, 12), (110, 12), (150, 0)], "motorway_link", oneway="yes")
    return sketch


def test_a_link_between_two_motorways_is_an_exit_of_one_and_an_entry_of_the_other(tmp_path: Path) -> None:
    request = request_in(tmp_path, two_motorways(), scenario_type="ramp")
    osm = read_osm(tmp_path / "map.osm")
    built = prepare_site(request, osm, fitting_sites(osm, request)[0], tmp_path, silent)
    lookup = LaneletLookup(built.network)
    origin = middle_of(replace(built.site, latitude=50.0, longitude=8.0), built.net)
    begin = origin - (200.0, 0.0)
    across = [(0.0, 0.0), (200.0, 0.0), (240.0, -6.0), (310.0, -54.0), (350.0, -60.0), (470.0, -60.0)]
    beside = [(0.0, 0.0), (200.0, 0.0), (240.0, 12.0), (310.0, 12.0), (350.0, 0.0), (470.0, 0.0)]
    made = {}
    for name, points in (("across", across), ("beside", beside)):
        line = resample(np.array(points) + begin, 400)
        turned = np.append(headings(line), 0.0)
        motion = Motion(line, turned, np.full(len(line), 12.0), np.zeros(len(line)))
        car = GeneratedVehicle("1", vehicle_classes()["car"], motion, True)
        turns: tuple[Turn, ...] = ("exit", "merge", "straight")
        made[name] = [one for one in turns if turn_made(one, car, 399, built.focus, built.network, lookup)]
    assert made == {"across": ["exit", "merge"], "beside": []}
