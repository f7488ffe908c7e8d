"""Sites that a map promises are built, and a ramp that does not lead where it has to is told as what it is."""

from pathlib import Path
from typing import Any

import pytest

from plannerforge.engine.execution import silent
from plannerforge.engine.generation.generator import generate_scenario
from plannerforge.engine.generation.site_network import prepare_site
from plannerforge.engine.generation.sites import fitting_sites, lacking_turn
from plannerforge.engine.maps.drawn_library import Sketch
from plannerforge.engine.maps.osm import OsmMap, read_osm
from plannerforge.engine.maps.site_search.finder import SiteFinder
from plannerforge.schemas.errors import NotPossible
from plannerforge.schemas.generation import GenerationRequest

pytestmark = pytest.mark.usefixtures("unknown_sites")


def drawn(folder: Path, sketch: Sketch) -> OsmMap:
    sketch.write(folder / "map.osm")
    return read_osm(folder / "map.osm")


def request_in(folder: Path, **changes: Any) -> GenerationRequest:
    wish = {"map_path": str(folder / "map.osm"), "map_id": "map_town", "place": "Town", "country": "ZAM"}
    return GenerationRequest.model_validate({**wish, "attribution": "", "folder": str(folder), **changes})


def two_ramps() -> Sketch:
    """A motorway with an exit, and an entry 3 km behind it."""
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-900, 0), (0, 0), (3000, 0), (4000, 0)], "motorway", "", ref="A 1", oneway="yes")
    sketch.road([(0, 0), (300, -90)], "motorway_link", "Exit Road", oneway="yes")
    sketch.road([(2700, -90), (3000, 0)], "motorway_link", "Entry Road", oneway="yes")
    return sketch


def test_ramps_in_the_ego_s_requested_direction_come_first(tmp_path: Path) -> None:
    osm = drawn(tmp_path, two_ramps())
    for turn in ("merge", "exit"):
        for seed in range(4):
            request = request_in(tmp_path, scenario_type="ramp", goal=f"through:{turn}", seed=seed)
            assert fitting_sites(osm, request)[0].turns == {turn}
            assert lacking_turn(osm, request) is None


@pytest.mark.parametrize("wish", [{"goal": "through:merge"}, {"others": "merging"}])
def test_a_merge_at_an_exit_is_refused_and_a_ramp_that_merges_is_proposed(tmp_path: Path, wish: dict[str, str]) -> None:
    osm = drawn(tmp_path, two_ramps())
    refusal = lacking_turn(osm, request_in(tmp_path, scenario_type="ramp", streets=[["Exit Road"]], **wish))
    assert refusal is not None
    assert refusal.reason == "no_such_turn"
    boxed = refusal.remedies[-1].changes[0].values
    assert boxed is not None
    there = request_in(tmp_path, scenario_type="ramp", bbox=boxed["bbox"], **wish)
    assert [site.turns for site in fitting_sites(osm, there)] == [{"merge"}]


def test_an_exit_alone_offers_its_turns(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-600, 0), (0, 0), (600, 0)], "motorway", "", ref="A 1", oneway="yes")
    sketch.road([(0, 0), (300, -90)], "motorway_link", "Exit Road", oneway="yes")
    drawn(tmp_path, sketch)
    with pytest.raises(NotPossible) as caught:
        generate_scenario(request_in(tmp_path, scenario_type="ramp", goal="through:merge", duration_s=6.0), silent)
    assert caught.value.reason == "no_such_turn"
    assert caught.value.valid == ("goal=through:exit",)


def test_a_site_on_the_requested_streets_comes_before_one_that_they_pass(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-900, 0), (-25, 0), (25, 0), (800, 0), (900, 0)], "primary", "Main Road")
    sketch.road([(-25, 0), (-25, 150)], "residential", "First Road")
    sketch.road([(25, 0), (25, -150)], "residential", "Second Road")
    sketch.road([(800, -150), (800, 0)], "residential", "First Road")
    sketch.road([(800, 0), (800, 150)], "residential", "Second Road")
    osm = drawn(tmp_path, sketch)
    for seed in range(4):
        streets = [["First Road"], ["Second Road"]]
        on, beside = fitting_sites(osm, request_in(tmp_path, scenario_type="intersection", streets=streets, seed=seed))
        assert (on.only_passed, beside.only_passed) == (False, True)
        assert beside.longitude < on.longitude
    built = prepare_site(request_in(tmp_path, streets=streets), osm, beside, tmp_path, silent)
    assert "do not meet here" in built.notes[0]


def test_a_site_outside_the_requested_part_is_offered(tmp_path: Path) -> None:
    osm = drawn(tmp_path, two_ramps())
    first, _ = sorted(SiteFinder(osm).find("ramp"), key=lambda site: site.longitude)
    west = request_in(tmp_path, scenario_type="ramp", bbox=(49.9, first.longitude - 0.02, 50.1, first.longitude - 0.01))
    with pytest.raises(NotPossible) as caught:
        fitting_sites(osm, west)
    boxed = caught.value.remedies[0].changes[0].values
    assert boxed is not None
    there = request_in(tmp_path, scenario_type="ramp", bbox=boxed["bbox"])
    assert [site.position for site in fitting_sites(osm, there)] == [first.position]


def test_streets_that_never_meet_are_reported_with_streets_that_have_the_type_alone(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-300, 0), (0, 0), (300, 0)], "residential", "North Road")
    sketch.road([(0, 0), (0, 300)], "residential", "Short Road")
    sketch.road([(-300, -900), (300, -900)], "residential", "South Road")
    osm = drawn(tmp_path, sketch)
    request = request_in(tmp_path, scenario_type="intersection", streets=[["North Road"], ["South Road"]])
    with pytest.raises(NotPossible, match="do not meet") as caught:
        fitting_sites(osm, request)
    suggested = [remedy.changes[0].values for remedy in caught.value.remedies]
    assert suggested == [{"place": "North Road / Short Road, Town"}, {"place": "North Road, Town"}]


def test_a_ring_with_too_tight_turns_is_drawn_with_tighter_corners(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    north = [(3.0, 4.5), (1.1, 5.3), (-0.8, 5.5), (-3.2, 4.7), (-5.1, 2.9), (-6.0, 0.4), (-5.6, -2.6), (-4.5, -4.3)]
    south = [(-2.7, -5.7), (-0.7, -6.1), (2.0, -5.7), (4.3, -3.9), (5.2, -2.0), (5.5, 0.0), (4.7, 2.5), (3.0, 4.5)]
    sketch.road([*north, *south], "secondary", "Ring", junction="roundabout")
    for number, line in enumerate(
        [
            [(31.8, -38.2), (18.6, -33.2), (7.7, -20.6), (5.3, -12.2), (4.3, -3.9)],
            [(3.0, 4.5), (71.1, 129.1), (110.0, 261.3)],
            [(-0.7, -6.1), (2.7, -19.4), (13.1, -37.7), (36.1, -63.9)],
            [(-6.0, 0.4), (-10.5, -1.7), (-26.2, -27.4), (-32.3, -76.4)],
            [(-5.6, -2.6), (-33.1, -44.6), (-53.6, -66.7), (-64.7, -69.5)],
            [(-57.4, -81.0), (-30.3, -50.1), (-2.7, -5.7)],
            [(105.6, 263.8), (67.1, 132.6), (-0.8, 5.5)],
        ]
    ):
        sketch.road(line, "secondary", f"Arm {number}", oneway="yes")
    osm = drawn(tmp_path, sketch)
    request = request_in(tmp_path, scenario_type="roundabout")
    (site,) = fitting_sites(osm, request)
    built = prepare_site(request, osm, site, tmp_path, silent)
    assert built.net.roundabout_edges
    assert any("tighter" in note for note in built.notes)
