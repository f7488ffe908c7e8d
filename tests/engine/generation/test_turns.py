"""What an ego is asked to do at its site, and what its path to the goal then does."""

import math
import random
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from lxml import etree
from shapely.geometry import box
from support.generation import make, request_for
from support.roads import network_of_streets, street

from plannerforge.engine.execution.executor import silent
from plannerforge.engine.generation.generator import generate_scenario
from plannerforge.engine.generation.site_network import prepare_site
from plannerforge.engine.generation.site_ways import SiteWays
from plannerforge.engine.generation.sites import fitting_sites
from plannerforge.engine.generation.turning_trips import TurningTrips
from plannerforge.engine.generation.turns import leads_without_change, ramp_ways
from plannerforge.engine.maps import read_map_file
from plannerforge.engine.network.net_parser import read_net
from plannerforge.engine.network.netconvert import convert_osm
from plannerforge.engine.scenarios.facts import read_facts
from plannerforge.engine.traffic import WARM_UP_S, OpenEdges
from plannerforge.engine.vehicles import vehicle_classes
from plannerforge.schemas.errors import InvalidRequest, NotPossible, with_values
from plannerforge.schemas.generation import TURNS_AT, GenerationRequest
from plannerforge.schemas.scenarios import ReadFactsRequest


def turned_deg(folder: Path) -> float:
    """From the ego's heading at the start to that of the goal, left positive."""
    problem = etree.parse(folder / "scenario.xml").getroot().find("planningProblem")
    assert problem is not None
    start = float(str(problem.findtext("initialState/orientation/exact")))
    bounds = [float(str(problem.findtext(f"goalState/orientation/interval{end}"))) for end in ("Start", "End")]
    return math.degrees(math.remainder(sum(bounds) / 2 - start, 2 * math.pi))


@pytest.mark.parametrize(("turn", "degrees"), [("left", 90.0), ("right", -90.0), ("straight", 0.0)])
def test_the_ego_makes_the_requested_turn_on_streets_at_right_angles(tmp_path: Path, turn: str, degrees: float) -> None:
    made = make("Quadratstadt", tmp_path, scenario_type="intersection", goal=f"through:{turn}", duration_s=15.0, seed=1)
    assert turned_deg(tmp_path) == pytest.approx(degrees, abs=20.0)
    assert made.site.scenario_type == "intersection"


ONE_CAR = ({"vehicle_class": "car", "least": 1, "most": 1},)


def test_a_turn_that_no_drawn_car_makes_is_made_reproducibly(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("one", "two")]
    for folder in folders:
        folder.mkdir()
        wish = {"scenario_type": "intersection", "goal": "through:left", "duration_s": 8.0, "vehicles": ONE_CAR}
        made = make("Quadratstadt", folder, **wish, seed=0)
    assert turned_deg(folders[0]) == pytest.approx(90.0, abs=20.0)
    assert any("turn 'left'" in note for note in made.notes)  # lacking in the usual traffic
    assert len({(folder / "scenario.xml").read_bytes() for folder in folders}) == 1


def test_a_refused_turn_comes_with_calls_that_keep_it_first(tmp_path: Path) -> None:
    request = request_for(
        "Kreiselheim", tmp_path, scenario_type="roundabout", goal="through:u_turn", duration_s=3.0, vehicles=ONE_CAR
    )
    with pytest.raises(NotPossible) as refusal:
        generate_scenario(request, silent)
    remedies = refusal.value.remedies
    lasting_s = remedies[0].changes[0].values["duration_s"]
    assert lasting_s >= 20
    assert (remedies[0], remedies[-1]) == (with_values(duration_s=lasting_s), with_values(goal=None, ego=None))


def test_every_route_over_a_crossing_is_known_with_its_turn(tmp_path: Path) -> None:
    nodes = {"1": (0, 0), "2": (150, 0), "3": (0, 150), "4": (-150, 0), "5": (0, -150)}
    places = [f'<node id="{k}" lat="{y / 111195:.7f}" lon="{x / 111195:.7f}"/>' for k, (x, y) in nodes.items()]
    roads = [
        f'<way id="{end}0"><nd ref="{end}"/><nd ref="1"/><tag k="highway" v="residential"/></way>' for end in "2345"
    ]
    (tmp_path / "site.osm").write_text(f'<osm version="0.6">{"".join([*places, *roads])}</osm>')
    convert_osm(tmp_path / "site.osm", tmp_path / "site.net.xml", lefthand=False)
    net = read_net(tmp_path / "site.net.xml")
    ways = list(SiteWays(net, frozenset({"1"})).through(OpenEdges.of(net, "passenger")))
    assert Counter(turn for turn, _ in ways) == {"left": 4, "right": 4, "straight": 4}
    assert ("left", ("20", "-50")) in ways


def test_every_way_on_and_off_a_main_road_is_known(tmp_path: Path) -> None:
    nodes = {
        "1": (-200, 0),
        "2": (0, 0),
        "3": (200, 0),
        "4": (300, -40),
        "5": (400, 0),
        "6": (600, 0),
        "7": (300, -140),
    }
    places = [f'<node id="{k}" lat="{y / 111195:.7f}" lon="{x / 111195:.7f}"/>' for k, (x, y) in nodes.items()]
    tag = '<tag k="highway" v="{}"/><tag k="oneway" v="yes"/>'
    drawn = {"10": ("1", "2", "motorway"), "20": ("2", "3", "motorway"), "30": ("3", "5", "motorway")}
    drawn |= {"40": ("5", "6", "motorway"), "50": ("2", "4", "motorway_link"), "60": ("4", "5", "motorway_link")}
    drawn |= {"70": ("4", "7", "secondary")}
    roads = [
        f'<way id="{key}"><nd ref="{start}"/><nd ref="{end}"/>{tag.format(kind)}</way>'
        for key, (start, end, kind) in drawn.items()
    ]
    (tmp_path / "site.osm").write_text(f'<osm version="0.6">{"".join([*places, *roads])}</osm>')
    convert_osm(tmp_path / "site.osm", tmp_path / "site.net.xml", lefthand=False)
    net = read_net(tmp_path / "site.net.xml")
    edges = OpenEdges.of(net, "passenger")
    assert [way[1:] for way in ramp_ways("exit", net, edges)] == [("50", "70")]
    assert list(ramp_ways("merge", net, edges)) == []  # 10, 50, 60, 40 leaves the motorway and comes back to it
    assert list(ramp_ways("straight", net, edges)) == []


@pytest.mark.parametrize("turn", ["exit", "merge"])
def test_a_ramp_that_no_drawn_car_takes_is_driven_all_the_same(tmp_path: Path, turn: str) -> None:
    made = make(
        "Neuland", tmp_path, goal=f"through:{turn}", vehicles=ONE_CAR, duration_s=12.0, seed=3, most_rounds=None
    )
    assert made.site.scenario_type == "ramp"
    assert any(f"turn '{turn}'" in note for note in made.notes)


def test_a_turn_alone_chooses_a_type_of_site_that_has_it(tmp_path: Path) -> None:
    made = make("Neuland", tmp_path, goal="through:merge", duration_s=12.0, seed=1)
    assert "merge" in TURNS_AT[made.site.scenario_type]
    assert made.site.scenario_type == "ramp"


def test_a_turn_that_the_site_lacks_is_refused_with_its_turns(tmp_path: Path) -> None:
    request = request_for("Kreiselheim", tmp_path, scenario_type="roundabout", goal="through:merge")
    with pytest.raises(InvalidRequest, match=r"'merge' at roundabout sites.*through:left"):
        generate_scenario(request, silent)


def test_an_unprotected_left_turn_has_oncoming_lanes_and_no_light(tmp_path: Path) -> None:
    make(
        "Quadratstadt", tmp_path, scenario_type="intersection", goal="through:unprotected_left", duration_s=15.0, seed=1
    )
    facts = read_facts(ReadFactsRequest(path=tmp_path / "scenario.xml"), silent)
    assert {"ego_turns_left", "unprotected_left"} <= set(facts.features)


def test_at_a_signalised_junction_no_left_turn_is_unprotected(tmp_path: Path) -> None:
    request = request_for(
        "Quadratstadt", tmp_path, scenario_type="signalised_intersection", goal="through:unprotected_left"
    )
    with pytest.raises(InvalidRequest):
        generate_scenario(request, silent)


def test_an_ego_turns_back_round_a_ring(tmp_path: Path) -> None:
    make(
        "Kreiselheim",
        tmp_path,
        scenario_type="roundabout",
        goal="through:u_turn",
        density="high",
        duration_s=20.0,
        seed=4,
    )
    assert abs(turned_deg(tmp_path)) > 150.0


def test_only_a_goal_in_another_lane_needs_a_lane_change() -> None:
    ends = [(0.0, 0.0, 50.0), (0.0, 50.0, 100.0), (3.5, 0.0, 50.0), (3.5, 50.0, 100.0)]
    lines = [np.array([(start, y), ((start + end) / 2, y), (end, y)]) for y, start, end in ends]
    network = network_of_streets(
        *(street(key, line, (key + 1,) if key % 2 else ()) for key, line in enumerate(lines, start=1))
    )
    ahead, beside = box(70.0, -1.7, 80.0, 1.7), box(70.0, 1.8, 80.0, 5.2)
    reached = [
        leads_without_change(network.lanelets[1], region, network, farthest_m)
        for region, farthest_m in ((ahead, 100.0), (beside, 100.0), (ahead, 40.0))
    ]
    assert reached == [True, False, False]


def in_its_town(folder: Path, **changes: object) -> GenerationRequest:
    usual = {"scenario_type": "roundabout", "goal": "through:u_turn", "vehicles": ONE_CAR, "duration_s": 8.0}
    return request_for("Kreiselheim", folder, **usual | changes)


def test_a_recording_lasts_as_long_as_the_turn_needs_unless_the_call_states_its_duration(tmp_path: Path) -> None:
    made = generate_scenario(in_its_town(tmp_path, longest_s=60.0), silent)
    assert 8.0 < made.duration_s <= 60.0
    assert abs(turned_deg(tmp_path)) > 150.0
    with pytest.raises(NotPossible) as refusal:
        generate_scenario(in_its_town(tmp_path), silent)
    first = refusal.value.remedies[0].changes[0].values
    assert first.keys() == {"duration_s"}
    assert first["duration_s"] >= made.duration_s


def test_vehicles_for_a_turn_enter_the_site_one_after_the_other_during_the_recording(tmp_path: Path) -> None:
    request = in_its_town(tmp_path, duration_s=40.0)
    osm = read_map_file(Path(request.map_path))
    site = prepare_site(request, osm, fitting_sites(osm, request)[0], tmp_path, silent)
    car = vehicle_classes()["car"]
    trips = TurningTrips(site.net, 30.0, random.Random(1), site.focus, "u_turn", car, 40.0, 4).late_trips()
    edges, ways = OpenEdges.of(site.net, car.sumo_class), site.focus.ways
    assert ways is not None
    assert len(trips) == 4
    assert [trip.at_s for trip in trips] == sorted(trip.at_s for trip in trips)
    for trip in trips:
        entry = next(edge for edge in trip.edges if edge in ways.entries)
        approach = trip.edges[: trip.edges.index(entry) + 1]
        enters_s = trip.at_s + edges.travel_s(approach) - trip.station_m / edges.speed_mps[approach[0]]
        assert WARM_UP_S - 4.0 <= enters_s <= WARM_UP_S + 40.0
        assert trip.at_s <= WARM_UP_S
