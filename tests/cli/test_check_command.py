"""``plannerforge check``: a table for people, JSON for programs, an exit code for both."""

import json
from pathlib import Path

import pytest
from support.road_defects import DEFECTS
from support.roads import good_road, write
from typer.testing import CliRunner, Result

from plannerforge.cli.program import application


@pytest.fixture(autouse=True)
def _wide(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")


def check(*arguments: str) -> Result:
    return CliRunner().invoke(application, ["check", *arguments])


def road(folder: Path, *defects: str) -> str:
    folder.mkdir(exist_ok=True)
    root = good_road()
    for name in defects:
        DEFECTS[name](root)
    return str(write(root, folder))


def test_a_good_file_passes(tmp_path: Path) -> None:
    result = check(road(tmp_path))
    assert result.exit_code == 0
    assert "1 file(s): 1 without a finding, 0 error(s), 0 warning(s)" in result.stdout


def test_an_error_fails_and_is_shown_with_file_rule_and_ids(tmp_path: Path) -> None:
    result = check(road(tmp_path / "good"), road(tmp_path / "bad", "unknown_successor", "gap_at_join"))
    assert result.exit_code == 1
    row = next(line for line in result.stdout.splitlines() if "unknown_successor" in line)
    for words in ("road.xml", "error", "6 99", "successor 99 is not in the file"):
        assert words in row
    assert "2 file(s): 1 without a finding, 1 error(s), 1 warning(s)" in result.stdout


def test_warnings_alone_pass(tmp_path: Path) -> None:
    result = check(road(tmp_path, "gap_at_join"))
    assert result.exit_code == 0
    assert "gap_at_join" in result.stdout


def test_json_contains_every_finding(tmp_path: Path) -> None:
    result = check(road(tmp_path, "gap_at_join"), "--json")
    (file,) = json.loads(result.stdout)
    (finding,) = file["findings"]
    assert finding == {
        "rule": "gap_at_join",
        "severity": "warning",
        "elements": [4, 6],
        "where": [120.0, 0.0],
        "message": "3.00 m between its end and the beginning of 6",
    }


def test_an_unreadable_file_fails_and_its_markup_is_plain_text(tmp_path: Path) -> None:
    path = tmp_path / "bad.xml"
    path.write_text("<commonRoad><lanelet id='[red]'/></commonRoad>")
    result = check(str(path))
    assert result.exit_code == 1
    assert "[red]" in result.stdout
    assert "1 unreadable" in result.stdout


def test_a_file_that_is_not_there_is_refused() -> None:
    assert check("nowhere.xml").exit_code == 2
