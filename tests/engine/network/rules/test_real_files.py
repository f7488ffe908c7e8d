"""What the rules find in real files, and that they are silent on good ones: a changed rule shows here."""

import io
import zipfile
from collections.abc import Iterable
from importlib.resources import files
from pathlib import Path

import pytest

from plannerforge.engine.network.rules.check import check_file

FOLDER = Path(__file__).parent
GOOD_FILES = (FOLDER / "good_files.txt").read_text(encoding="utf-8").split()
"""Real files without a defect, by name."""

DEFECTS = {
    name: rules
    for name, *rules in map(str.split, (FOLDER / "known_defects.txt").read_text(encoding="utf-8").splitlines())
}
"""The rules that real files break, by the file's name; docs/rules.md says what the defects are."""


def there(shared_data: Path, names: Iterable[str]) -> list[Path]:
    """Those of the known real files that the shared folder holds; it may change, but most of them have to be there."""
    paths = [shared_data / "data" / "commonroad" / name for name in names]
    found = [path for path in paths if path.is_file()]
    assert len(found) > len(paths) / 2
    return found


def findings_in(path: Path) -> dict[str, list[str]]:
    """The broken rules of a file by its name; empty where there are none."""
    checked = check_file(path)
    broken = [checked.unreadable] if checked.unreadable else [finding.rule for finding in checked.findings]
    return {path.name: broken} if broken else {}


def test_rules_find_exactly_the_known_defects_of_real_files(shared_data: Path) -> None:
    broken = {path.name: sorted(set(findings_in(path).get(path.name, ()))) for path in there(shared_data, DEFECTS)}
    assert broken == {name: DEFECTS[name] for name in broken}


def test_rules_are_silent_on_good_real_files(shared_data: Path) -> None:
    false_alarms = [found for path in there(shared_data, GOOD_FILES[::6]) if (found := findings_in(path))]
    assert false_alarms == []


@pytest.fixture(scope="module")
def starter_files(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Every fourth of the scenarios that come with the package: they are made alike."""
    folder = tmp_path_factory.mktemp("starter")
    content = (files("plannerforge.engine.catalog") / "starter.zip").read_bytes()
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        chosen = [name for name in archive.namelist() if name.endswith("-1.xml")]
        return [Path(archive.extract(name, folder)) for name in sorted(chosen)[::4]]


def test_rules_are_silent_on_the_starter_catalogue(starter_files: list[Path]) -> None:
    false_alarms = [found for path in starter_files if (found := findings_in(path))]
    assert starter_files
    assert false_alarms == []
