"""The recording as OpenSCENARIO XML: every vehicle at its recorded place at every step, what is lost told."""

import math
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest
from lxml import etree
from support.builders import Vehicle, driving, town_road

from benchmarks.maps.formats import asam_schema
from plannerforge.engine.scenarios import write_openscenario
from plannerforge.schemas.artifacts import ForeignExport, ForeignExportRequest
from plannerforge.schemas.errors import UnsafeInput

LATE = driving(77, (10.0, 3.5), 9.0, 20, first_step=12)
WALKER = driving(78, (20.0, 9.0), 1.3, 20, kind="pedestrian", size_m=(0.5, 0.5))
BUS = driving(79, (80.0, 3.5), 7.0, 30, heading_rad=0.3, kind="bus", size_m=(12.0, 2.5))


def quiet(share: float, message: str = "") -> None:
    """Progress that is not looked at."""


def exported(source: Path, target: Path) -> ForeignExport:
    request = ForeignExportRequest(scenario_path=str(source), target_path=str(target), roads="town.xodr")
    return write_openscenario(request, quiet)


@pytest.fixture
def play(tmp_path: Path) -> Path:
    """The builders' road with a late car, a pedestrian and a bus."""
    exported(town_road().with_vehicles(LATE, WALKER, BUS).write(tmp_path / "town.xml"), tmp_path / "town.xosc")
    return tmp_path / "town.xosc"


@pytest.mark.parametrize("vehicle", [LATE, WALKER, BUS], ids=lambda vehicle: vehicle.kind)
def test_centres_keep_their_positions_at_every_step(vehicle: Vehicle, play: Path) -> None:
    root = ElementTree.parse(play).getroot()
    name = f"{vehicle.kind}_{vehicle.vehicle_id}"
    ahead = float(root.find(f".//ScenarioObject[@name='{name}']//Center").get("x"))  # type: ignore[union-attr,arg-type]
    group = root.find(f".//EntityRef[@entityRef='{name}']/../..")
    assert group is not None
    vertices = list(group.iter("Vertex"))
    assert len(vertices) == len(vehicle.poses)
    for step, (vertex, (x, y, heading, _)) in enumerate(zip(vertices, vehicle.poses, strict=True)):
        place = vertex.find(".//WorldPosition")
        assert place is not None
        at_x, at_y, at_heading = (float(place.get(key, "nan")) for key in ("x", "y", "h"))
        assert float(vertex.get("time", "nan")) == pytest.approx((vehicle.first_step + step) * 0.1)
        assert at_heading == pytest.approx(heading)
        assert (at_x + ahead * math.cos(at_heading), at_y + ahead * math.sin(at_heading)) == pytest.approx(
            (x, y), abs=1e-3
        )


def test_a_vehicle_is_placed_by_its_rear_axle_and_a_pedestrian_by_its_middle(play: Path) -> None:
    root = ElementTree.parse(play).getroot()
    ahead = {one.get("name"): float(one.find(".//Center").get("x")) for one in root.iter("ScenarioObject")}  # type: ignore[union-attr,arg-type]
    assert 1.0 < ahead["Ego"] < 2.0
    assert 2.0 < ahead["bus_79"] < 6.0
    assert ahead["pedestrian_78"] == 0.0


def test_the_ego_has_its_initial_state_and_no_trajectory(play: Path) -> None:
    root = ElementTree.parse(play).getroot()
    private = root.find(".//Private[@entityRef='Ego']")
    assert private is not None
    assert float(private.find(".//AbsoluteTargetSpeed").get("value")) == 10.0  # type: ignore[union-attr,arg-type]
    assert root.find(".//EntityRef[@entityRef='Ego']") is None


def test_the_roads_match_the_road_file_next_to_it(play: Path) -> None:
    logic = ElementTree.parse(play).getroot().find(".//LogicFile")
    assert logic is not None
    assert logic.get("filepath") == "town.xodr"


def test_the_file_keeps_to_the_schema_of_the_standard(play: Path) -> None:
    asam_schema("OpenSCENARIO_1_2.xsd").assertValid(etree.parse(play))


def test_losses_of_the_format_are_reported(tmp_path: Path) -> None:
    told = exported(town_road().with_vehicles(LATE).write(tmp_path / "town.xml"), tmp_path / "town.xosc").lost
    assert any("goal" in words for words in told)
    assert any("entering later" in words for words in told)


def test_the_same_recording_gives_the_same_bytes(play: Path, tmp_path: Path) -> None:
    exported(tmp_path / "town.xml", tmp_path / "again.xosc")
    assert (tmp_path / "again.xosc").read_bytes() == play.read_bytes()


def test_a_scenario_without_traffic_and_ego_is_a_file_all_the_same(tmp_path: Path) -> None:
    bare = replace(town_road(), vehicles=(), parked=(), problems=())
    exported(bare.write(tmp_path / "bare.xml"), tmp_path / "bare.xosc")
    root = ElementTree.parse(tmp_path / "bare.xosc").getroot()
    assert root.tag == "OpenSCENARIO"
    assert not list(root.iter("ScenarioObject"))


def test_names_of_the_file_stay_text(tmp_path: Path) -> None:
    source = tmp_path / "odd.xml"
    source.write_text(town_road().xml().replace('"ZAM_Builder-1_1_T-1"', "'ZAM_\"&lt;Act/&gt;-1_1_T-1'"))
    exported(source, tmp_path / "odd.xosc")
    root = ElementTree.parse(tmp_path / "odd.xosc").getroot()
    assert "<Act/>" in str(root.find("FileHeader").get("description"))  # type: ignore[union-attr]
    assert len(list(root.iter("Act"))) == 1


@pytest.mark.parametrize("text", ["", "<commonRoad", "<!DOCTYPE a [<!ENTITY b 'c'>]><commonRoad>&b;</commonRoad>"])
def test_a_broken_scenario_is_refused_without_writing_files(text: str, tmp_path: Path) -> None:
    (tmp_path / "bad.xml").write_text(text)
    with pytest.raises(UnsafeInput):
        exported(tmp_path / "bad.xml", tmp_path / "bad.xosc")
    assert not (tmp_path / "bad.xosc").exists()
