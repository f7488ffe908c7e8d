"""The bench over a folder of scenarios: what it finds, how it goes on, and what it counts."""

import json
from pathlib import Path
from typing import Any

import pytest
from support.builders import Problem, town_road

from benchmarks.loop.database import (
    AUTHORS,
    Journal,
    Turn,
    authors_scenarios,
    figures_of,
    kind_of,
    measure,
    scenarios_in,
    table_of,
    top_folder,
    turns_for,
)
from plannerforge.evals.scoring.common import built_in


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A scenario, a broken file, and files of SUMO that lie beside."""
    below = tmp_path / "scenarios" / "hand-crafted"
    below.mkdir(parents=True)
    (tmp_path / "scenarios" / "SUMO").mkdir()
    road = town_road()
    road.__class__(**{**vars(road), "problems": (Problem(),)}).write(below / "whole.xml")
    (tmp_path / "scenarios" / "SUMO" / "broken.xml").write_text("<commonRoad><lanelet>")
    (below / "whole.net.xml").write_text("<net></net>")
    (below / "vehicles.xml").write_text("<routes></routes>")
    return tmp_path


async def measured(folder: Path, journal: Journal) -> Any:
    return await measure(
        folder, ["idm"], journal, prediction="constant_velocity", traffic="recorded", limit=None, workers=1
    )


@pytest.mark.anyio
async def test_broken_files_are_refused_by_name_and_no_file_is_lost(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    journal = Journal.read(tmp_path / "rows.jsonl")
    figures = await measured(folder, journal)
    assert (figures["scenarios"], figures["refused"], figures["lost"]) == (2, 1, 0)
    assert figures["beyond_limits"] == 0.0
    told = capsys.readouterr().err
    assert "broken.xml: unsafe_input" in told
    assert "| idm | SUMO | 1 | refused 1 |" in told


@pytest.mark.anyio
async def test_entries_of_the_journal_are_not_run_again(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    first = await measured(folder, Journal.read(path))
    kept = path.read_bytes()
    path.write_bytes(kept + b'{"turn": "idm", "half')
    assert await measured(folder, Journal.read(path)) == first
    assert path.read_bytes() == kept


def test_a_run_that_ends_by_an_error_of_ours_is_lost(tmp_path: Path) -> None:
    turn = Turn("frenetix", built_in("frenetix:Default"), [tmp_path / "a.xml"], "constant_velocity", "recorded")
    journal = Journal(tmp_path / "rows.jsonl")
    config_id, prediction, traffic, path = turn.key(tmp_path / "a.xml")
    journal.add(
        {"turn": "frenetix", "config_id": config_id, "prediction": prediction, "traffic": traffic, "path": path}
        | {"kind": "x", "error": "worker_failure: it died", "refused": False, "clock_s": 2.0}
    )
    figures = figures_of([turn], journal)
    assert (figures["lost"], figures["runs_per_second"]) == (1, 0.5)
    assert "| frenetix | x | 1 | lost 1 |" in table_of([turn], journal)
    assert json.loads((tmp_path / "rows.jsonl").read_text())["error"]


def test_scenarios_are_distinguished_by_location_or_content(folder: Path, tmp_path: Path) -> None:
    top = top_folder(folder)
    assert top == folder / "scenarios"
    found = scenarios_in(top, None)
    assert [path.name for path in found] == ["broken.xml", "whole.xml"]
    assert [kind_of(path, top) for path in found] == ["SUMO", "hand-crafted"]
    stated = tmp_path / "flat.xml"
    stated.write_text('<commonRoad source="Next Generation Simulation (NGSIM)">')
    assert kind_of(stated, tmp_path) == "NGSIM"


def test_the_authors_scenarios_are_run_as_they_ran_them(tmp_path: Path) -> None:
    names = sorted(authors_scenarios())
    assert len(names) == 280
    path = tmp_path / f"{names[0]}.xml"
    turns = list(turns_for([path, tmp_path / "other.xml"], ["fiss"], "constant_velocity", "recorded"))
    assert [turn.name for turn in turns] == ["fiss", f"{AUTHORS} fop", f"{AUTHORS} fiss"]
    settings = turns[1].configuration.settings
    assert (settings.vehicle, settings.replan_steps, settings.search) == (3, 1, 0)
    assert (turns[1].prediction, list(turns[1].files)) == ("ground_truth", [path])
