import math
from pathlib import Path

import pytest

from plannerforge.engine.maps.drawn_library import Sketch
from plannerforge.engine.maps.osm import read_osm
from plannerforge.engine.maps.site_search.finder import SiteFinder


def finder(folder: Path, sketch: Sketch) -> SiteFinder:
    path = folder / "map.osm"
    sketch.write(path)
    return SiteFinder(read_osm(path))


def crossing(side: str, **tags: str) -> Sketch:
    """A main road of 2 km with a side road in its middle."""
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-1000, 0), (0, 0), (500, 0), (1000, 0)], "primary", "Main Road", **tags)
    sketch.road([(0, 0), (0, 150)], side, "Side Road")
    return sketch


def test_a_ramp_joins_a_motorway_a_slip_lane_does_not(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-500, 0), (0, 0), (500, 0)], "motorway", "", oneway="yes")
    sketch.road([(0, 0), (200, -30)], "motorway_link", "", oneway="yes")
    assert finder(tmp_path, sketch).kinds()["ramp"] == 1
    assert "ramp" not in finder(tmp_path, crossing("primary_link")).kinds()


def test_a_ramp_is_called_after_the_road_that_its_link_leads_to(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-500, 0), (0, 0), (500, 0)], "motorway", "", ref="A 1", oneway="yes")
    sketch.road([(0, 0), (200, -60)], "motorway_link", "", oneway="yes")
    sketch.road([(200, -160), (200, -60), (200, 100)], "secondary", "Mill Road")
    assert finder(tmp_path, sketch).find("ramp")[0].streets == ("A 1", "Mill Road")


def test_a_ramp_has_the_name_of_its_road(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-500, 0), (0, 0), (500, 0)], "motorway", "", ref="A 1", oneway="yes")
    sketch.road([(0, 0), (200, -60)], "motorway_link", "", oneway="yes")
    sketch.road([(100, -400), (100, 400)], "secondary", "Bridge Road")
    sketch.road([(450, -400), (450, 400)], "secondary", "Far Road")
    assert finder(tmp_path, sketch).find("ramp")[0].streets == ("A 1", "Bridge Road")


def test_an_urban_site_is_at_a_motorway_only_without_other_junctions_and_streets(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-500, 0), (500, 0)], "motorway", "", ref="A 1", oneway="yes")
    sketch.road([(-200, 60), (0, 60), (200, 60)], "residential", "Motorway Road")
    sketch.road([(0, 60), (0, 90)], "residential", "Short Road")
    assert [site.streets for site in finder(tmp_path, sketch).find("urban")] == [("Motorway Road", "Short Road")]
    sketch.road([(0, 90), (0, 300), (0, 400)], "residential", "Main Road")
    assert [site.streets for site in finder(tmp_path, sketch).find("urban")] == [("Main Road",)]
    sketch.road([(-200, 400), (0, 400), (200, 400)], "residential", "Quiet Road")
    assert [site.streets for site in finder(tmp_path, sketch).find("urban")] == [("Main Road", "Quiet Road")]


def test_roads_of_the_remaining_classes_are_searched(tmp_path: Path) -> None:
    sketch = crossing("residential")
    sketch.road([(500, -400), (500, 0), (500, 400)], "primary", "Other Road")
    sketch.write(tmp_path / "all.osm")
    osm = read_osm(tmp_path / "all.osm")
    crossings = [SiteFinder(osm, classes).find("intersection") for classes in ((), ("primary",), ("motorway",))]
    assert [len(found) for found in crossings] == [2, 1, 0]
    assert SiteFinder(osm, ("motorway",)).longest_road() is None


def test_a_link_makes_no_crossing(tmp_path: Path) -> None:
    assert "intersection" not in finder(tmp_path, crossing("primary_link")).kinds()


def test_a_link_with_a_street_s_name_makes_a_crossing_with_another_street(tmp_path: Path) -> None:
    sketch = crossing("primary_link")
    sketch.road([(0, 150), (0, 400)], "residential", "Side Road")
    found = finder(tmp_path, sketch)
    assert not any("Main Road" in site.streets for site in found.find("intersection"))
    (site,) = found.find_by_links("intersection")
    assert (site.streets, site.by_links) == (("Main Road", "Side Road"), True)
    assert found.narrowed(site, lambda part: "Main Road" in part.streets).by_links
    assert not finder(tmp_path, crossing("primary_link")).find_by_links("intersection")


def test_a_trunk_road_makes_a_highway_and_a_ramp_only_without_a_motorway(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-500, 0), (0, 0), (500, 0)], "trunk", "", oneway="yes", maxspeed="100")
    sketch.road([(0, 0), (200, -60)], "trunk_link", "", oneway="yes")
    assert {"highway", "ramp"} <= set(finder(tmp_path, sketch).kinds())
    sketch.road([(2000, 0), (2020, 0)], "motorway", "", oneway="yes")
    assert not {"highway", "ramp"} & set(finder(tmp_path, sketch).kinds())


def test_without_a_signed_limit_a_trunk_road_is_a_highway_if_no_street_meets_it(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-500, 0), (0, 0), (500, 0)], "trunk", "", oneway="yes")
    assert "highway" in finder(tmp_path, sketch).kinds()
    sketch.road([(0, 0), (0, 300)], "residential", "Side Road")
    assert "highway" not in finder(tmp_path, sketch).kinds()


def test_driveways_make_a_crossing_only_if_no_streets_meet(tmp_path: Path) -> None:
    assert finder(tmp_path, crossing("service")).kinds()["intersection"] == 1
    both = crossing("service")
    both.road([(500, 0), (500, 150)], "residential", "Other Road")
    assert [site.streets for site in finder(tmp_path, both).find("intersection")] == [("Main Road", "Other Road")]


@pytest.mark.parametrize("tags", [{"sidewalk": "both"}, {"maxspeed": "50"}])
def test_pavements_and_low_limits_are_not_rural(tmp_path: Path, tags: dict[str, str]) -> None:
    assert finder(tmp_path, crossing("service")).kinds()["rural"] > 1
    assert "rural" not in finder(tmp_path, crossing("service", **tags)).kinds()


def test_a_fast_road_among_houses_is_not_rural(tmp_path: Path) -> None:
    sketch = crossing("service", maxspeed="70")
    for x in range(-1000, 1001, 200):
        sketch.road([(x, 100), (x + 150, 100)], "residential", f"Lane {x}")
    assert "rural" not in finder(tmp_path, sketch).kinds()


def ring(
    *parts: tuple[int, int], arms: int = 3, kind: str = "secondary", radius_m: float = 20.0, **tags: str
) -> Sketch:
    """A ring of 12 corners, drawn in parts (from, to corner), with roads outwards at every third."""
    sketch = Sketch("Town", 50.0, 8.0)
    corners = [(radius_m * math.cos(k * math.pi / 6), radius_m * math.sin(k * math.pi / 6)) for k in range(12)]
    for begin, end in parts:
        line = [corners[k % 12] for k in range(begin, end + 1)]
        sketch.road(line, kind, "", **{"junction": "roundabout", **tags})
    for number in range(arms):
        x, y = corners[3 * number]
        sketch.road([(x, y), (6 * x, 6 * y)], "secondary", f"Arm {number}")
    return sketch


@pytest.mark.parametrize("parts", [[(0, 12)], [(0, 6), (6, 12)], [(3, 9), (9, 12), (0, 3)]])
def test_a_ring_is_found_in_one_way_or_in_several(tmp_path: Path, parts: list[tuple[int, int]]) -> None:
    assert finder(tmp_path, ring(*parts)).kinds()["roundabout"] == 1


def test_a_ring_drawn_against_its_direction_is_a_roundabout(tmp_path: Path) -> None:
    assert finder(tmp_path, ring((0, 6), (6, 12), oneway="-1")).kinds()["roundabout"] == 1


@pytest.mark.parametrize(
    "sketch",
    [
        ring((0, 9)),
        ring((0, 5), (6, 12)),
        ring((0, 12), arms=1),
        ring((0, 6), (6, 12), oneway="no"),
        ring((0, 12), oneway="no"),
        ring((0, 12), oneway=";;;"),
        ring((0, 12), kind="secondary_link"),
    ],
    ids=["three quarters", "gap", "one entry", "both directions", "one way in both", "unknown direction", "links"],
)
def test_an_open_ring_is_not_a_roundabout(tmp_path: Path, sketch: Sketch) -> None:
    assert "roundabout" not in finder(tmp_path, sketch).kinds()


def test_a_circle_that_no_car_can_drive_is_not_a_roundabout(tmp_path: Path) -> None:
    assert "roundabout" in finder(tmp_path, ring((0, 12), radius_m=5.0)).kinds()
    assert "roundabout" not in finder(tmp_path, ring((0, 12), radius_m=2.7)).kinds()


def test_a_ring_as_long_as_a_town_is_not_a_roundabout(tmp_path: Path) -> None:
    sketch = ring()
    line = [(300 * math.cos(k * math.pi / 6), 300 * math.sin(k * math.pi / 6)) for k in range(13)]
    sketch.road(line, "secondary", "", junction="roundabout")
    for x, y in line[:3]:
        sketch.road([(x, y), (2 * x, 2 * y)], "secondary", "")
    assert "roundabout" not in finder(tmp_path, sketch).kinds()


def test_a_position_without_a_road_next_to_it_gives_no_site(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(0, 0), (20, 0), (40, 0)], "residential", "Short Road")
    sketch.road([(20, 0), (20, 30)], "residential", "Side Road")
    assert finder(tmp_path, sketch).kinds() == {}
    sketch.road([(40, 0), (90, 0)], "residential", "Long Road")
    assert finder(tmp_path, sketch).kinds() == {"intersection": 1, "urban": 1}


def test_a_street_of_a_few_metres_is_not_an_urban_site(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(0, 0), (200, 0)], "residential", "Long Road")
    sketch.road([(0, 500), (10, 500)], "residential", "Short Road")
    assert [site.streets for site in finder(tmp_path, sketch).find("urban")] == [("Long Road",)]


def one_way_with_signal(x: float, **tags: str) -> Sketch:
    """A street eastwards that a side street meets at x = 0, with a traffic signal at x."""
    sketch = Sketch("Town", 50.0, 8.0)
    line = sorted([(-200.0, 0.0), (0.0, 0.0), (x, 0.0), (200.0, 0.0)])
    sketch.road(list(dict.fromkeys(line)), "secondary", "Main Street", **tags)
    sketch.road([(0, 0), (0, 150)], "secondary", "Side Street")
    sketch.mark((x, 0.0), highway="traffic_signals")
    return sketch


@pytest.mark.parametrize("x", [0.0, -20.0])
def test_a_signal_at_a_junction_or_before_it_is_its_own(tmp_path: Path, x: float) -> None:
    assert finder(tmp_path, one_way_with_signal(x, oneway="yes")).kinds()["signalised_intersection"] == 1


@pytest.mark.parametrize("x", [20.0, -40.0])
def test_a_signal_behind_a_junction_or_far_before_it_is_not(tmp_path: Path, x: float) -> None:
    assert "signalised_intersection" not in finder(tmp_path, one_way_with_signal(x, oneway="yes")).kinds()


def wide_crossing(*signals: tuple[float, float]) -> Sketch:
    """Two roads with separate carriageways that cross, with signals at these points of the carriageways."""
    sketch = Sketch("Town", 50.0, 8.0)
    points = sorted({-300.0, -10.0, 10.0, 300.0, *(x for x, y in signals if y == -10.0)})
    sketch.road([(x, -10.0) for x in points], "primary", "Long Road", oneway="yes")
    sketch.road([(x, 10.0) for x in (300.0, 10.0, -10.0, -300.0)], "primary", "Long Road", oneway="yes")
    points = sorted({-300.0, -10.0, 10.0, 300.0, *(y for x, y in signals if x == 10.0)})
    sketch.road([(10.0, y) for y in points], "primary", "Wide Road", oneway="yes")
    sketch.road([(-10.0, y) for y in (300.0, 10.0, -10.0, -300.0)], "primary", "Wide Road", oneway="yes")
    for point in signals:
        sketch.mark(point, highway="traffic_signals")
    return sketch


def test_signals_at_far_stop_lines_of_two_roads_are_the_junction_s(tmp_path: Path) -> None:
    found = finder(tmp_path, wide_crossing((-50.0, -10.0), (10.0, -45.0))).find("signalised_intersection")
    assert [site.streets for site in found] == [("Long Road", "Wide Road")]
    for signals in ([(-50.0, -10.0)], [(50.0, -10.0), (10.0, 45.0)], [(-90.0, -10.0), (10.0, -90.0)]):
        assert not finder(tmp_path, wide_crossing(*signals)).find("signalised_intersection")


def test_a_signal_on_a_slip_road_is_of_the_junction_that_it_leads_to(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-300, 0), (-30, 0), (0, 0), (300, 0)], "primary", "Main Road", oneway="yes")
    sketch.road([(-30, 0), (-10, -10), (0, 0)], "primary_link", "", oneway="yes")
    sketch.road([(0, 0), (0, 300)], "primary", "Side Road")
    sketch.mark((-10, -10), highway="traffic_signals")
    found = finder(tmp_path, sketch)
    assert not found.find("signalised_intersection")
    (site,) = found.find_by_links("signalised_intersection")
    assert site.by_links
    assert {"Main Road", "Side Road"} <= set(site.streets)


def test_a_signal_near_a_junction_counts_if_traffic_comes_from_there(tmp_path: Path) -> None:
    assert finder(tmp_path, one_way_with_signal(20.0)).kinds()["signalised_intersection"] == 1


def staggered() -> Sketch:
    """A main road with two side roads, 50 m apart, so that their junctions are one site."""
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-500, 0), (-25, 0), (25, 0), (500, 0)], "primary", "Main Road")
    sketch.road([(-25, 0), (-25, 150)], "residential", "First Road")
    sketch.road([(25, 0), (25, -150)], "residential", "Second Road")
    return sketch


def test_a_site_is_narrowed_to_its_junctions_on_a_street(tmp_path: Path) -> None:
    found = finder(tmp_path, staggered())
    (site,) = found.find("intersection")
    narrow = found.narrowed(site, lambda part: "Second Road" in part.streets)
    assert narrow.streets == ("Main Road", "Second Road")
    assert narrow.longitude > site.longitude
    assert not narrow.only_passed
    assert found.narrowed(site, lambda part: "Main Road" in part.streets) == site


def test_a_site_without_a_requested_junction_is_next_to_the_place(tmp_path: Path) -> None:
    found = finder(tmp_path, staggered())
    (site,) = found.find("intersection")
    narrow = found.narrowed(site, lambda part: {"First Road", "Second Road"} <= set(part.streets))
    assert narrow.only_passed
    assert narrow.position == site.position


def test_a_track_makes_no_junction(tmp_path: Path) -> None:
    assert "intersection" not in finder(tmp_path, crossing("track")).kinds()


def test_a_light_where_a_road_only_splits_is_not_a_signalised_junction(tmp_path: Path) -> None:
    def lit(*, crossed: bool) -> Sketch:
        sketch = Sketch("Town", 50.0, 8.0)
        sketch.road([(-300, 0), (0, 0), (300, 0)], "secondary", "Main Road", oneway="yes")
        sketch.road([(0, 0), (0, 200)], "secondary", "Side Road", **({} if crossed else {"oneway": "yes"}))
        sketch.mark((0, 0), highway="traffic_signals")
        return sketch

    assert finder(tmp_path, lit(crossed=True)).kinds()["signalised_intersection"] == 1
    assert "signalised_intersection" not in finder(tmp_path, lit(crossed=False)).kinds()


def test_a_ramp_knows_whether_its_link_joins_or_leaves(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-900, 0), (0, 0), (600, 0), (900, 0)], "motorway", "", ref="A 1", oneway="yes")
    sketch.road([(0, 0), (200, -60)], "motorway_link", "", oneway="yes")
    sketch.road([(400, -60), (600, 0)], "motorway_link", "", oneway="yes")
    exit_, entry = sorted(finder(tmp_path, sketch).find("ramp"), key=lambda site: site.longitude)
    assert exit_.turns == {"exit"}
    assert entry.turns == {"merge"}


def test_trunk_roads_that_cross_make_an_intersection_but_a_fork_does_not(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-500, 0), (0, 0), (500, 0)], "trunk", "West Road", oneway="yes")
    sketch.road([(0, 0), (400, 200)], "trunk", "Other Road", oneway="yes")
    assert "intersection" not in finder(tmp_path, sketch).kinds()
    sketch.road([(0, -400), (0, 0)], "trunk", "Other Road", oneway="yes")
    assert finder(tmp_path, sketch).kinds()["intersection"] == 1


def test_beside_a_motorway_the_ramps_and_stretches_of_an_expressway_are_found_on_request(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-500, 0), (0, 0), (500, 0)], "trunk", "Ring Expressway", oneway="yes", motorroad="yes")
    sketch.road([(0, 0), (200, -60)], "motorway_link", "", oneway="yes")
    assert not finder(tmp_path, sketch).find_besides_motorways("ramp")
    sketch.road([(2000, 0), (3000, 0)], "motorway", "", oneway="yes")
    found = finder(tmp_path, sketch)
    assert [site.turns for site in found.find_besides_motorways("ramp")] == [{"exit"}]
    assert found.find_besides_motorways("highway")
    assert not found.find_besides_motorways("intersection")
