"""Of the sites of a map, those are chosen that show what a request names."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from plannerforge.engine.execution.executor import silent
from plannerforge.engine.generation.site_network import prepare_site
from plannerforge.engine.generation.sites import count_sites, fitting_sites, middle_of, with_streets_that_meet
from plannerforge.engine.maps.drawn_library import Sketch
from plannerforge.engine.maps.osm import OsmMap, OsmWay, ground_distance_m, read_osm
from plannerforge.engine.maps.site_search.finder import SiteFinder
from plannerforge.engine.traffic.motions import GeneratedVehicle
from plannerforge.engine.vehicles.classes import vehicle_classes
from plannerforge.engine.vehicles.motion import Motion
from plannerforge.schemas.errors import NotPossible
from plannerforge.schemas.generation import GenerationRequest, RequestedGoal


def drawn(folder: Path, sketch: Sketch) -> OsmMap:
    sketch.write(folder / "map.osm")
    return read_osm(folder / "map.osm")


def request(folder: Path, **asked: object) -> GenerationRequest:
    known = {"map_path": str(folder / "map.osm"), "map_id": "map_a", "place": "Town", "country": "ZAM"}
    return GenerationRequest.model_validate({**known, "attribution": "", "folder": "", **asked})


def test_a_ramp_of_the_requested_road_is_preferred_to_one_that_leads_to_it(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-800, 0), (0, 0), (800, 0)], "motorway", "", ref="A 1", oneway="yes")
    sketch.road([(0, 0), (300, -400), (300, -1000)], "motorway_link", "", oneway="yes")
    sketch.road([(-800, -1000), (300, -1000), (2000, -1000), (2800, -1000)], "motorway", "", ref="A 2", oneway="yes")
    sketch.road([(2000, -1000), (2200, -1100), (2200, -1200)], "motorway_link", "", oneway="yes")
    osm = drawn(tmp_path, sketch)
    sites = fitting_sites(osm, request(tmp_path, scenario_type="ramp", streets=(("A 2",),)))
    assert sites
    assert all(site.streets[0] == "A 2" for site in sites)
    assert all(abs(site.latitude - osm.nodes[site.mark].latitude) < 1e-3 for site in sites)
    assert not any(abs(site.latitude - 50.0) < 1e-3 for site in sites)


@pytest.mark.parametrize("seed", range(6))
def test_a_site_in_a_corner_of_the_requested_box_comes_last(tmp_path: Path, seed: int) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    for east, north in ((0, 0), (500, 100), (950, 950)):
        sketch.road([(east - 100, north), (east, north), (east + 90, north)], "secondary", f"Main Road {east}")
        sketch.road([(east, north), (east, north + 100)], "residential", f"Side Road {east}")
    osm = drawn(tmp_path, sketch)
    square = (50.0 - 0.009, 8.0 - 0.014, 50.0 + 0.009, 8.0 + 0.014)
    sites = fitting_sites(osm, request(tmp_path, scenario_type="intersection", bbox=square, seed=seed))
    assert len(sites) == 3
    assert "Main Road 950" in sites[-1].streets


def test_a_ring_of_links_is_found_if_no_other_is(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    corners = [(20 * math.cos(k * math.pi / 6), 20 * math.sin(k * math.pi / 6)) for k in range(13)]
    sketch.road(corners, "secondary_link", "", junction="roundabout")
    sketch.road([corners[0], (300, 0)], "secondary", "East Road")
    sketch.road([corners[6], (-300, 0)], "secondary_link", "West Road")
    osm = drawn(tmp_path, sketch)
    (site,) = fitting_sites(osm, request(tmp_path, scenario_type="roundabout", streets=(("West Road",),)))
    assert site.by_links
    assert site.streets[0] == "West Road"


def streets_apart() -> Sketch:
    """Lima Street crosses Rosa Luxemburg Street, not Rosa Street; Old Lima Street crosses Rosa Street."""
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-300, 0), (0, 0), (300, 0)], "secondary", "Lima")
    sketch.road([(0, -300), (0, 0), (0, 300)], "secondary", "Luis Rosa")
    sketch.road([(-300, 900), (0, 900), (300, 900)], "secondary", "Rosa")
    sketch.road([(100, 1200), (0, 900), (0, 600)], "secondary", "Pine Street")
    return sketch


def test_a_street_with_a_longer_name_is_taken_if_the_requested_ones_do_not_meet(tmp_path: Path) -> None:
    osm = drawn(tmp_path, streets_apart())
    wish = {"streets": (("Lima",), ("Rosa",)), "longer_streets": ((), ("Luis Rosa", "Rosa Park"))}
    asked = request(tmp_path, **wish)
    meeting, notes = with_streets_that_meet(osm, asked)
    assert meeting.streets == (("Lima",), ("Luis Rosa",))
    assert len(notes) == 1
    assert {"Lima", "Luis Rosa"} <= set(fitting_sites(osm, meeting)[0].streets)
    assert count_sites(asked, silent).count == 1


@pytest.mark.parametrize(
    ("streets", "longer"),
    [
        ((("Rosa",), ("Pine Street",)), (("Luis Rosa",), ())),  # the requested streets meet
        ((("Lima",), ("Pine Street",)), ((), ("Rosa",))),  # no other streets meet
        ((("Lima",), ("Pine Street",)), ()),
    ],
)
def test_the_requested_streets_are_kept_if_they_meet_or_no_others_do(
    tmp_path: Path, streets: tuple[tuple[str, ...], ...], longer: tuple[tuple[str, ...], ...]
) -> None:
    asked = request(tmp_path, streets=streets, longer_streets=longer, scenario_type="roundabout")
    assert with_streets_that_meet(drawn(tmp_path, streets_apart()), asked) == (asked, [])


@pytest.mark.parametrize("seed", range(4))
def test_sites_on_the_first_name_come_before_those_on_another_name(tmp_path: Path, seed: int) -> None:
    asked = request(tmp_path, streets=(("Luis Rosa", "Lima", "Rosa"),), seed=seed)
    sites = fitting_sites(drawn(tmp_path, streets_apart()), asked)
    assert ["Luis Rosa" in site.streets for site in sites] == sorted(
        ("Luis Rosa" in site.streets for site in sites), reverse=True
    )
    assert {"Luis Rosa" in site.streets for site in sites} == {True, False}


@pytest.mark.parametrize("seed", range(4))
def test_the_crossing_of_two_streets_comes_before_a_ring_that_both_reach(tmp_path: Path, seed: int) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    corners = [(20 * math.cos(k * math.pi / 6), 20 * math.sin(k * math.pi / 6)) for k in range(13)]
    sketch.road(corners, "secondary", "", junction="roundabout")
    sketch.road([corners[0], (300, 0), (500, 0)], "secondary", "East Road")
    sketch.road([corners[3], (0, 300), (300, 0), (300, -200)], "secondary", "Bow Street")
    sketch.road([corners[6], (-300, 0)], "secondary", "West Road")
    osm = drawn(tmp_path, sketch)
    asked = request(tmp_path, streets=(("East Road",), ("Bow Street",)), seed=seed)
    first, *others = fitting_sites(osm, asked)
    assert first.kind != "roundabout"
    assert [site.kind for site in others] == ["roundabout"]


def test_a_street_that_another_one_continues_is_an_urban_site_where_they_join(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-300, 0), (0, 0)], "residential", "West Street")
    sketch.road([(0, 0), (0, 300)], "residential", "North Street")
    sketch.road([(0, 300), (300, 300)], "residential", "East Street")
    sketch.road([(-300, -80), (-300, 0), (-300, 200)], "residential", "Pine Street")
    sketch.area([(-400, -400), (400, -400), (400, 400), (-400, 400), (-400, -400)], "residential")
    osm = drawn(tmp_path, sketch)
    asked = request(tmp_path, streets=(("West Street",), ("North Street",)), scenario_type="any")
    (site,) = fitting_sites(osm, asked)
    assert set(site.streets) == {"West Street", "North Street"}
    with pytest.raises(NotPossible):
        fitting_sites(osm, request(tmp_path, streets=(("West Street",), ("East Street",)), scenario_type="any"))


def test_a_ring_keeps_the_links_that_are_its_arms(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    corners = [(30 * math.cos(k * math.pi / 6), 30 * math.sin(k * math.pi / 6)) for k in range(13)]
    sketch.road(corners, "primary", "", junction="roundabout")
    sketch.road([corners[0], (300, 0)], "primary", "East Road")
    sketch.road([corners[6], (-300, 0)], "primary", "West Road")
    sketch.road([corners[3], (0, 300)], "trunk_link", "")
    osm = drawn(tmp_path, sketch)
    asked = request(tmp_path, scenario_type="roundabout")
    (site,) = fitting_sites(osm, asked)
    built = prepare_site(asked, osm, site, tmp_path, silent)
    assert built.focus.ways is not None
    assert len(built.focus.ways.entries) == len(built.focus.ways.exits) == 3


def test_a_type_that_cannot_have_the_goal_is_proposed_without_it(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-800, 0), (0, 0), (800, 0)], "motorway", "", ref="A 1", oneway="yes")
    osm = drawn(tmp_path, sketch)
    goal = RequestedGoal.of("through:exit")
    with pytest.raises(NotPossible) as refusal:
        fitting_sites(osm, request(tmp_path, scenario_type="ramp", streets=(("A 1",),), goal=goal))
    assert refusal.value.remedies[0].changes[0].values == {"scenario_type": "highway", "goal": None}


def test_an_ego_that_starts_or_ends_near_the_named_junction_does_not_pass_it(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-200, 0), (0, 0), (50, 0), (250, 0)], "secondary", "Main Road")
    sketch.road([(0, 0), (0, 150)], "residential", "First Road")
    sketch.road([(50, 0), (50, 150)], "residential", "Second Road")
    osm = drawn(tmp_path, sketch)
    asked = request(tmp_path, scenario_type="intersection", streets=(("Main Road",), ("First Road",)))
    (site,) = fitting_sites(osm, asked)
    built = prepare_site(asked, osm, site, tmp_path, silent)
    first = middle_of(site, built.net)

    def passes(begin_m: float, end_m: float) -> bool:
        along = np.linspace(begin_m, end_m, 81)
        still = np.zeros(81)
        motion = Motion(first + np.stack([along, still - 1.6], axis=1), still, still + 10.0, still)
        return built.focus.is_on_spot(GeneratedVehicle("1", vehicle_classes()["car"], motion, True), 80)

    assert passes(-60.0, 30.0)
    assert not passes(25.0, 110.0)
    assert not passes(-110.0, -25.0)


def test_a_street_among_houses_without_a_junction_there_is_an_urban_site_of_its_own(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-400, 0), (0, 0), (400, 0)], "residential", "Main Road")
    sketch.road([(0, 0), (0, 300)], "residential", "Side Road")
    sketch.road([(1500, 0), (1600, 0), (2500, 0), (3500, 0)], "tertiary", "Long Road")
    sketch.road([(1600, 80), (1600, 90)], "residential", "")
    osm = drawn(tmp_path, sketch)
    (site,) = fitting_sites(osm, request(tmp_path, scenario_type="urban", streets=(("Long Road",),)))
    assert site.streets == ("Long Road",)


def test_names_in_a_list_are_each_the_road_s(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-400, 0), (0, 0), (400, 0)], "secondary", "East Road;West Road")
    sketch.road([(0, 0), (0, 300)], "residential", "Side Road")
    osm = drawn(tmp_path, sketch)
    for name in ("East Road;West Road", "West Road"):
        streets = ((name,), ("Side Road",))
        assert fitting_sites(osm, request(tmp_path, scenario_type="intersection", streets=streets))


def two_streets() -> Sketch:
    """A street, and another one that ends 50 m from its middle."""
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(0, -300), (0, 0), (0, 300)], "residential", "Long Street")
    sketch.road([(30, 40), (300, 40)], "residential", "Side Street")
    return sketch


def called(name: str) -> Callable[[OsmWay], bool]:
    return lambda way: way.tags.get("name") == name


BOTH = (("Long Street",), ("Side Street",))


@pytest.mark.parametrize("highway", ["residential", "tertiary_link"])
@pytest.mark.parametrize("kind", ["any", "intersection"])
def test_streets_that_a_short_road_without_a_name_connects_meet_there(tmp_path: Path, highway: str, kind: str) -> None:
    sketch = two_streets()
    sketch.road([(0, 0), (30, 40)], highway, "")
    osm = drawn(tmp_path, sketch)
    site = fitting_sites(osm, request(tmp_path, scenario_type=kind, streets=BOTH))[0]
    assert not site.only_passed
    assert {"Long Street", "Side Street"} <= set(site.streets)
    assert ground_distance_m(site.position, osm.nodes[site.mark].position) < 60.0


@pytest.mark.parametrize(("highway", "name"), [("residential", "Third Street"), ("service", "")])
def test_streets_that_another_street_or_a_driveway_connects_do_not_meet(
    tmp_path: Path, highway: str, name: str
) -> None:
    sketch = two_streets()
    sketch.road([(0, 0), (30, 40)], highway, name)
    osm = drawn(tmp_path, sketch)
    with pytest.raises(NotPossible) as refusal:
        fitting_sites(osm, request(tmp_path, scenario_type="signalised_intersection", streets=BOTH))
    assert refusal.value.reason == "no_such_site"
    sites = SiteFinder(osm).meetings("intersection", called("Long Street"), called("Side Street"))
    assert not sites


def test_streets_that_end_at_a_roundabout_have_it_as_their_intersection(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    corners = [(20 * math.cos(k * math.pi / 6), 20 * math.sin(k * math.pi / 6)) for k in range(13)]
    sketch.road(corners, "secondary", "", junction="roundabout")
    for number, name in ((0, "Long Street"), (6, "Side Street"), (3, "Third Street")):
        sketch.road([corners[number], (15 * corners[number][0], 15 * corners[number][1])], "secondary", name)
    osm = drawn(tmp_path, sketch)
    sites = fitting_sites(osm, request(tmp_path, scenario_type="intersection", streets=BOTH))
    assert [site.kind for site in sites] == ["roundabout"]
    with pytest.raises(NotPossible):
        fitting_sites(osm, request(tmp_path, scenario_type="signalised_intersection", streets=BOTH))


@pytest.mark.parametrize("seed", range(6))
def test_where_two_streets_cross_comes_before_a_ramp_that_leads_to_both(tmp_path: Path, seed: int) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-800, 0), (0, 0), (800, 0)], "motorway", "Long Street", oneway="yes")
    sketch.road([(0, 0), (150, -100), (300, -100)], "motorway_link", "", oneway="yes")
    sketch.road([(300, -100), (600, -100), (900, -100)], "secondary", "Side Street")
    sketch.road([(600, -300), (600, -100), (600, -40)], "secondary", "Long Street")
    osm = drawn(tmp_path, sketch)
    sites = fitting_sites(osm, request(tmp_path, streets=BOTH, seed=seed))
    assert sites[0].kind != "ramp"
    assert any(site.kind == "ramp" for site in sites)


def test_a_ramp_of_a_requested_expressway_is_found_beside_a_motorway(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-500, 0), (0, 0), (500, 0)], "trunk", "Ring Expressway", oneway="yes")
    sketch.road([(0, 0), (200, -60)], "motorway_link", "", oneway="yes")
    sketch.road([(2000, 0), (2500, 0), (3000, 0)], "motorway", "", ref="A 1", oneway="yes")
    sketch.road([(2500, 0), (2700, -60)], "motorway_link", "", oneway="yes")
    osm = drawn(tmp_path, sketch)
    asked = request(tmp_path, scenario_type="ramp", goal="through:exit", streets=(("Ring Expressway",),))
    assert [site.streets[0] for site in fitting_sites(osm, asked)] == ["Ring Expressway"]
