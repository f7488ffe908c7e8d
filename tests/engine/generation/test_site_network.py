"""A site is judged before traffic is made for it."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from plannerforge.engine.execution.executor import silent
from plannerforge.engine.generation import generator, site_network
from plannerforge.engine.generation.site_network import SITE_LOST, UNKNOWN_SIDE, SiteNetwork, prepare_site
from plannerforge.engine.generation.sites import RADIUS_M, fitting_sites
from plannerforge.engine.maps.drawn_library import LIBRARY, Sketch
from plannerforge.engine.maps.map_file import read_map_file
from plannerforge.engine.maps.osm import OsmMap
from plannerforge.engine.maps.site_search.finder import Site
from plannerforge.engine.network.road_network import RoadNetwork
from plannerforge.engine.traffic.demand import lane_km_of
from plannerforge.schemas.errors import NotPossible
from plannerforge.schemas.generation import GenerationRequest, RequestedGoal, ScenarioType, VehicleDemand

pytestmark = pytest.mark.usefixtures("unknown_sites")


def request_for_fahrhausen(country: str | None = "DEU") -> GenerationRequest:
    return GenerationRequest(
        map_path=str(LIBRARY / "fahrhausen.osm"),
        map_id="map_fahrhausen",
        place="Fahrhausen",
        country=country,
        attribution="",
        scenario_type="intersection",
        goal=RequestedGoal.of("steps:50"),
        folder="",
    )


def site_at(folder: Path, country: str | None = "DEU") -> SiteNetwork:
    request = request_for_fahrhausen(country)
    osm = read_map_file(Path(request.map_path))
    return prepare_site(request, osm, fitting_sites(osm, request)[0], folder, silent)


def crowded_site(folder: Path) -> SiteNetwork:
    """The same for more cars than high density has there."""
    crowd = (VehicleDemand(vehicle_class="car", least=90, most=90),)
    request = request_for_fahrhausen().model_copy(update={"vehicles": crowd})
    osm = read_map_file(Path(request.map_path))
    return prepare_site(request, osm, fitting_sites(osm, request)[0], folder, silent)


def test_a_good_site_has_its_net_and_no_errors(tmp_path: Path) -> None:
    site = site_at(tmp_path)
    assert site.net_path.exists()
    assert not [finding for finding in site.findings if finding.severity == "error"]


@pytest.mark.parametrize(
    ("country", "lefthand", "noted"), [("GBR", True, False), ("WSM", True, False), (None, False, True)]
)
def test_traffic_keeps_to_the_side_of_the_country_and_an_unknown_country_is_noted(
    tmp_path: Path, country: str | None, lefthand: bool, noted: bool
) -> None:
    site = site_at(tmp_path, country)
    assert ('lefthand="true"' in site.net_path.read_text()) == lefthand
    assert (UNKNOWN_SIDE in site.notes) == noted


def test_a_site_is_cut_out_wider_for_more_vehicles_than_its_roads_hold(tmp_path: Path) -> None:
    usual = site_at(tmp_path)
    wider = crowded_site(_empty(tmp_path / "crowded"))
    assert usual.radius_m == RADIUS_M["intersection"] < wider.radius_m
    assert lane_km_of(wider.net) > 1.3 * lane_km_of(usual.net)
    assert wider.notes == (
        *usual.notes,
        f"cut out {wider.radius_m:.0f} m around the site, not 200 m, to make room for 91 vehicles",
    )


def test_a_site_keeps_its_usual_width_if_a_wider_one_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    build = site_network.build_network

    def refuses_wide(request: Any, osm: Any, site: Any, radius_m: float, *rest: Any) -> SiteNetwork:
        if radius_m > RADIUS_M["intersection"]:
            raise NotPossible("too many nodes")
        return build(request, osm, site, radius_m, *rest)

    monkeypatch.setattr(site_network, "build_network", refuses_wide)
    site = crowded_site(tmp_path)
    assert site.radius_m == RADIUS_M["intersection"]
    assert site.notes[-1].endswith(": too many nodes")


def test_a_wider_site_that_breaks_a_rule_is_replaced_by_the_usual_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    judge = site_network.judged

    def refuses_wide(built: SiteNetwork, *rest: Any) -> SiteNetwork:
        if built.radius_m > RADIUS_M["intersection"]:
            raise NotPossible("the road network is wrong")
        return judge(built, *rest)

    monkeypatch.setattr(site_network, "judged", refuses_wide)
    site = crowded_site(tmp_path)
    assert site.radius_m == RADIUS_M["intersection"]
    assert site.notes[-1].endswith(": the road network is wrong")


def _empty(folder: Path) -> Path:
    folder.mkdir()
    return folder


def spoil(monkeypatch: pytest.MonkeyPatch, change: Callable[[RoadNetwork], RoadNetwork]) -> None:
    """Let every network be built with a change."""
    build = site_network.build_network

    def built(*arguments: object) -> SiteNetwork:
        site = build(*arguments)  # type: ignore[arg-type]
        return replace(site, network=change(site.network))

    monkeypatch.setattr(site_network, "build_network", built)


def test_a_site_with_a_network_that_breaks_a_rule_is_refused_with_the_rule(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def swap(network: RoadNetwork) -> RoadNetwork:
        key, lanelet = next(iter(network.lanelets.items()))
        swapped = replace(lanelet, left=lanelet.right, right=lanelet.left)
        return replace(network, lanelets={**network.lanelets, key: swapped})

    spoil(monkeypatch, swap)
    with pytest.raises(NotPossible, match=r"bounds_swapped \(1\)"):
        site_at(tmp_path)


@pytest.mark.parametrize("kind", ["urban", "intersection", "highway", "any"])
def test_a_type_excluded_by_the_road_classes_is_refused_with_the_remaining_types(kind: ScenarioType) -> None:
    request = request_for_fahrhausen().model_copy(update={"scenario_type": kind, "road_classes": ("track",)})
    with pytest.raises(NotPossible, match=f"has no .*{'any type' if kind == 'any' else kind}") as caught:
        fitting_sites(read_map_file(Path(request.map_path)), request)
    assert caught.value.valid == ()
    made_of = "class track" in caught.value.message
    assert made_of == (kind != "highway"), "where the whole map holds none, the classes are not to blame"


def refused(folder: Path, **changes: object) -> NotPossible:
    request = request_for_fahrhausen().model_copy(update={"folder": str(folder), **changes})
    with pytest.raises(NotPossible) as caught:
        generator.generate_scenario(request, silent)
    return caught.value


def test_if_all_sites_are_lost_the_other_types_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(site_network, "why_not_realised", lambda site, net: f"the {site.kind} is lost")
    monkeypatch.setattr(generator, "MOST_LOST", 2)
    error = refused(tmp_path)
    assert re.fullmatch(
        r"\d+ sites? lost when the road network is built: intersection at 5\d\.\d{5}, \S+; .*", error.message
    )
    assert "urban" in error.valid
    assert "intersection" not in error.valid


def test_lost_sites_use_no_attempts_and_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    looked_at: list[Site] = []
    fitting = generator.fitting_sites

    def spread_out(osm: OsmMap, request: GenerationRequest) -> list[Site]:
        return fitting(osm, request)[:1] * (generator.MOST_SITES + 2)

    def prepared(request: GenerationRequest, osm: OsmMap, site: Site, *rest: Any) -> SiteNetwork:
        looked_at.append(site)
        if len(looked_at) <= generator.MOST_SITES + 1:
            raise NotPossible("swallowed", reason=SITE_LOST)
        return prepare_site(request, osm, site, *rest)

    monkeypatch.setattr(generator, "fitting_sites", spread_out)
    monkeypatch.setattr(generator, "prepare_site", prepared)
    request = request_for_fahrhausen().model_copy(update={"folder": str(tmp_path), "duration_s": 6.0})
    made = generator.generate_scenario(request, silent)
    note = next(note for note in made.notes if note.startswith("skipped: "))
    assert f"{generator.MOST_SITES + 1} sites lost when the road network is built: intersection at" in note
    assert note.endswith(f"{generator.MOST_SITES + 1 - generator.SHOWN_LOST} more")


def test_the_number_of_skipped_sites_is_bounded_in_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    looked_at: list[Site] = []

    def prepared(request: GenerationRequest, osm: OsmMap, site: Site, *rest: Any) -> SiteNetwork:
        looked_at.append(site)
        raise NotPossible("swallowed", reason=SITE_LOST)

    fitting = generator.fitting_sites
    monkeypatch.setattr(generator, "fitting_sites", lambda osm, request: fitting(osm, request)[:1] * 500)
    monkeypatch.setattr(generator, "prepare_site", prepared)
    assert refused(tmp_path).reason == SITE_LOST
    assert len(looked_at) == generator.MOST_LOST


def test_a_site_that_a_joined_junction_swallows_is_built_of_junctions_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    verdicts = iter(["swallowed", None])
    monkeypatch.setattr(site_network, "why_not_realised", lambda site, net: next(verdicts))
    notes = site_at(tmp_path).notes
    assert any("were not joined, because the site was lost" in note for note in notes)


def test_a_site_without_another_gets_all_the_rounds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rounds: list[int] = []

    def no_room(request: object, demand: object, aim: object, site: object, round_number: int, *_: object) -> None:
        rounds.append(round_number)
        raise NotPossible("no room")

    first = generator.fitting_sites
    monkeypatch.setattr(generator, "generate_traffic", no_room)
    monkeypatch.setattr(generator, "fitting_sites", lambda osm, request: first(osm, request)[:1])
    refused(tmp_path)
    assert rounds == list(range(generator.MOST_ROUNDS))


def test_a_site_with_only_the_ego_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(generator, "without_spares", lambda ranked, demand: ranked[:1])
    error = refused(tmp_path, duration_s=6.0, most_sites=1)
    assert error.message == "no vehicle but the ego found room on the roads of this site"


def test_a_repeatedly_requested_site_is_built_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    built: list[Path] = []
    build = site_network.build_network

    def noting(request: Any, osm: Any, site: Any, radius_m: float, folder: Path, *rest: Any) -> SiteNetwork:
        built.append(folder)
        return build(request, osm, site, radius_m, folder, *rest)

    monkeypatch.setattr(site_network, "build_network", noting)
    first, again = (site_at(_empty(tmp_path / name)) for name in "ab")
    assert built == [tmp_path / "a"]
    assert again.net_path.read_bytes() == first.net_path.read_bytes()
    assert replace(again, net_path=first.net_path) == first
    site_at(_empty(tmp_path / "c"), country="GBR")
    assert built[1:] == [tmp_path / "c"], "traffic keeps to the other side there"


def test_a_refusal_of_a_site_is_reported_again_without_building_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: list[Path] = []

    def refuses(request: Any, osm: Any, site: Any, radius_m: float, folder: Path, *rest: Any) -> SiteNetwork:
        tried.append(folder)
        raise NotPossible("no road here is open to cars", valid=["other"], next_step="go elsewhere", reason="closed")

    monkeypatch.setattr(site_network, "build_network", refuses)
    told = []
    for name in "ab":
        with pytest.raises(NotPossible) as refusal:
            site_at(_empty(tmp_path / name))
        told.append(refusal.value)
    assert tried == [tmp_path / "a"]
    assert told[0] is not told[1]
    assert {(error.text, error.reason) for error in told} == {(told[0].text, "closed")}


def test_the_last_sites_of_a_map_stay_cached(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    built: list[str | None] = []
    build = site_network.build_network

    def noting(request: GenerationRequest, *rest: Any) -> SiteNetwork:
        built.append(request.country)
        return build(request, *rest)

    monkeypatch.setattr(site_network, "build_network", noting)
    monkeypatch.setattr(site_network, "MOST_KNOWN", 2)
    for number, country in enumerate(["DEU", "AUT", "DEU", "CHE", "DEU", "AUT"]):
        site_at(_empty(tmp_path / str(number)), country)
    assert built == ["DEU", "AUT", "CHE", "AUT"]


def test_a_site_across_the_border_has_the_law_of_its_own_country(tmp_path: Path) -> None:
    sketch = Sketch("Alsace", 48.72, 7.50)
    for x in (0.0, 38_000.0):
        sketch.road([(x - 400, 0), (x, 0), (x + 400, 0)], "secondary", f"Road {x:.0f}")
        sketch.road([(x, -400), (x, 0), (x, 400)], "tertiary", f"Lane {x:.0f}")
    sketch.write(tmp_path / "map.osm")
    osm = read_map_file(tmp_path / "map.osm")
    ids = {}
    for x in (0, 38_000):
        request = request_for_fahrhausen().model_copy(
            update={
                "map_path": str(tmp_path / "map.osm"),
                "scenario_type": "intersection",
                "streets": ((f"Road {x}",), (f"Lane {x}",)),
                "country": "FRA",
                "bbox": None,
            }
        )
        built = prepare_site(request, osm, fitting_sites(osm, request)[0], tmp_path, silent)
        ids[x] = built.metadata.benchmark_id[:3], any("statutory default of France" in note for note in built.notes)
    assert ids == {0: ("FRA", True), 38_000: ("DEU", False)}
