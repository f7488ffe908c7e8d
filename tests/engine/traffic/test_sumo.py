"""One module of the engine calls libsumo, and what it hides stays hidden."""

import ast
import math
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import libsumo
import pytest
from support.builders import town_road

from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.network.sumo_export.writer import sumo_net
from plannerforge.engine.scene.scene import Scene
from plannerforge.engine.traffic.sumo import heading_of_angle_rad, sumo_angle_deg, sumo_pose, sumo_running, vehicle_type
from plannerforge.schemas.errors import NotPossible, WorkerFailure

CHECKOUT = Path(__file__).resolve().parents[3]


def imported(path: Path) -> set[str]:
    """The packages that a file imports, at any depth of its code."""
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    plain = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    named = {node.module or "" for node in nodes if isinstance(node, ast.ImportFrom) and not node.level}
    return {name.partition(".")[0] for name in plain | named}


def test_only_the_adapter_imports_libsumo() -> None:
    folders = ("engine", "workflows", "tools", "server", "resources", "prompts", "schemas", "agent", "evals", "cli")
    files = [path for folder in folders for path in (CHECKOUT / folder).rglob("*.py")]
    assert len(files) > 100
    naming = [path for path in files if re.search("libsumo|traci", path.read_text(encoding="utf-8"))]
    importing = [str(path.relative_to(CHECKOUT)) for path in naming if {"libsumo", "traci"} & imported(path)]
    assert importing == ["engine/traffic/sumo.py"]


@pytest.fixture
def running(tmp_path: Path) -> Any:
    """Opens a simulation over a town road; ``types`` and anything else as in ``sumo_running``."""
    scene = Scene.of(read_scenario(town_road().write(tmp_path / "base.xml")))
    net = tmp_path / "scenario.net.xml"
    net.write_text(sumo_net(scene.layout, scene.lane_speeds_mps, scene.signals), encoding="utf-8")

    def run(*types: str, **more: Any) -> Any:
        settings = {"step_s": 0.1, "seed": 0, "options": {}} | more
        return sumo_running(net, tmp_path / "types.add.xml", types, **settings)

    return run


def test_sumo_s_refusal_is_reported_in_the_caller_s_words(running: Any) -> None:
    with pytest.raises(WorkerFailure, match="SUMO did not start"), running("<vType/>"):
        pass
    refusal = {"refusal": lambda why: NotPossible(f"not here: {why}")}
    with pytest.raises(NotPossible, match="not here"), running("<vType/>", **refusal):
        pass
    with running() as sumo:
        sumo.step()


def test_an_error_of_sumo_inside_the_block_is_a_failure_and_ends_the_simulation(running: Any) -> None:
    with pytest.raises(WorkerFailure, match="Vehicle 'nowhere' is not known"), running() as sumo:
        sumo.speed_mps("nowhere")
    with pytest.raises(libsumo.FatalTraCIError, match="network"):
        libsumo.simulation.getTime()


@pytest.mark.parametrize("heading_rad", [0.0, 1.0, math.pi / 2, 3.0, -3.0, -math.pi / 2])
def test_angles_and_headings_are_each_others_inverse(heading_rad: float) -> None:
    turned = heading_of_angle_rad(sumo_angle_deg(heading_rad)) - heading_rad
    assert math.remainder(turned, math.tau) == pytest.approx(0.0, abs=1e-12)
    assert 0.0 <= sumo_angle_deg(heading_rad) < 360.0


def test_a_pose_is_the_front_bumper_and_degrees_clockwise_from_north() -> None:
    assert sumo_pose(10.0, 5.0, 0.0, 4.0) == pytest.approx((12.0, 5.0, 90.0))
    assert sumo_pose(10.0, 5.0, math.pi / 2, 4.0) == pytest.approx((10.0, 7.0, 0.0))


def test_attributes_of_a_type_are_quoted() -> None:
    element = vehicle_type("t1", vClass='a"<&', length="4.508")
    assert ElementTree.fromstring(element).attrib == {"id": "t1", "vClass": 'a"<&', "length": "4.508"}
    assert vehicle_type("t1", length="4.508") == '<vType id="t1" length="4.508"/>'
