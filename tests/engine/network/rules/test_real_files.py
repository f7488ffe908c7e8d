"""What the rules find in real files, and that they are silent on over 100 good ones: a changed rule shows here."""

import io
import zipfile
from collections import Counter
from importlib.resources import files
from pathlib import Path

import pytest

from plannerforge.engine.network.rules.check import check_file

FILES_WITH = {
    "bound_crosses_itself": 4,
    "bounds_cross": 1,
    "heading_jump": 1,
    "incoming_without_exit": 1,
    "intersection_without_incoming": 34,
    "neighbour_apart": 2,
    "overlapping_lanelets": 1,
    "repeated_points": 15,
    "sign_without_plate": 2,
    "too_tight": 1,
    "unknown_lanelet_at_intersection": 4,
}
"""Files with at least one finding, by rule; docs/rules.md says what they are."""

GOOD_FILES = tuple((Path(__file__).parent / "good_files.txt").read_text(encoding="utf-8").split())
"""Real files without a defect, by name."""


def test_rules_find_the_known_defects_of_100_real_files_and_nothing_else(shared_data: Path) -> None:
    files = sorted((shared_data / "data" / "commonroad").glob("*.xml"))
    chosen = [*files[::2], *files[1:5:2]]
    checked = [check_file(path) for path in chosen]
    found = Counter(rule for file in checked for rule in {finding.rule for finding in file.findings})
    assert len(chosen) == 100
    assert not any(file.unreadable for file in checked)
    assert dict(found) == FILES_WITH
    assert sum(not file.findings for file in checked) == 50


def findings_in(path: Path) -> dict[str, list[str]]:
    """The broken rules of a file by its name; empty where there are none."""
    checked = check_file(path)
    broken = [checked.unreadable] if checked.unreadable else [finding.rule for finding in checked.findings]
    return {path.name: broken} if broken else {}


def test_rules_are_silent_on_94_good_real_files(shared_data: Path) -> None:
    folder = shared_data / "data" / "commonroad"
    false_alarms = [found for name in GOOD_FILES if (found := findings_in(folder / name))]
    assert len(set(GOOD_FILES)) == 94
    assert false_alarms == []


@pytest.fixture(scope="module")
def starter_files(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The scenarios that come with the package."""
    folder = tmp_path_factory.mktemp("starter")
    content = (files("plannerforge.engine.catalog") / "starter.zip").read_bytes()
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        chosen = [name for name in archive.namelist() if name.endswith("-1.xml")]
        return [Path(archive.extract(name, folder)) for name in sorted(chosen)]


def test_rules_are_silent_on_the_starter_catalogue(starter_files: list[Path]) -> None:
    false_alarms = [found for path in starter_files if (found := findings_in(path))]
    assert len(starter_files) >= 32
    assert false_alarms == []
