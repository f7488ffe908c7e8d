"""The check before a scenario is handed out sees defects of the road network."""

import zipfile
from pathlib import Path

import numpy as np
import pytest
from lxml import etree

from plannerforge.engine.catalog import starter
from plannerforge.engine.generation.checks import check_scenario, faults_of
from plannerforge.engine.geometry.rectangles import BoxTrack
from plannerforge.engine.network.rules.check import check_file

FAR_AWAY = BoxTrack(np.full((2, 2), 1e6), np.zeros(2), (4.5, 1.8))


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    with zipfile.ZipFile(Path(str(starter.__file__)).with_name("starter.zip")) as archive:
        name = next(one for one in sorted(archive.namelist()) if "Fahrhausen" in one and not one.endswith(".net.xml"))
        return Path(archive.extract(name, tmp_path))


def test_a_good_scenario_has_a_network_without_findings(scenario: Path) -> None:
    checks = check_scenario(scenario, FAR_AWAY, check_file(scenario).findings)
    assert checks.network_errors == ()
    assert checks.network_warnings == ()


def test_an_error_in_the_network_makes_a_scenario_unusable(scenario: Path) -> None:
    tree = etree.parse(scenario)
    element = tree.find("lanelet/predecessor")
    assert element is not None
    parent = element.getparent()
    assert parent is not None
    parent.remove(element)
    tree.write(scenario)
    checks = check_scenario(scenario, FAR_AWAY, check_file(scenario).findings)
    (error,) = checks.network_errors
    assert error.startswith("one_way_succession (1): ")
    broken, _ = faults_of(checks)
    assert broken == [f"the road network is wrong: {error}"]
