"""``plannerforge doctor``: what is there is found, what is not is told with what mends it."""

import json
import sys
from pathlib import Path

import pytest

from plannerforge.server.commands import doctor
from plannerforge.server.commands.hosts import HOSTS, install
from plannerforge.server.settings import Settings


def looked_at(settings: Settings, home: Path) -> dict[str, doctor.Diagnosis]:
    return {each.name: each for each in doctor.diagnoses(settings, home)}


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return Settings(workspace=tmp_path / "workspace", maps_online="offline")


def test_this_installation_is_sound(settings: Settings, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert doctor.run_doctor(settings, as_json=True, fix=True, home=tmp_path) == 0
    found = {each["name"]: each for each in json.loads(capsys.readouterr().out)}
    assert {"SUMO", "planner cores", "text ranking", "text index", "workspace", "records"} <= set(found)
    assert [each for each in found.values() if each["state"] == "fault"] == []
    assert "1.28" in found["SUMO"]["found"]
    assert "384" in found["text ranking"]["found"]


def test_what_is_missing_is_told_with_what_mends_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = {
        "SUMO": doctor.Trial("import no_such_library", "install it"),
        "planner cores": doctor.Trial("import os; os.abort()", "install that"),
    }
    monkeypatch.setattr(doctor, "TRIALS", broken)
    monkeypatch.setattr("shutil.which", lambda name: None)
    settings = Settings(workspace=tmp_path / "workspace", roots=(tmp_path / "away",), maps_online="offline")
    found = looked_at(settings, tmp_path)
    assert (found["SUMO"].state, found["SUMO"].mend) == ("fault", "install it")
    assert "no_such_library" in found["SUMO"].found
    assert "signal 6" in found["planner cores"].found
    assert (found["compiler"].state, found["workspace"].state, found["roots"].state) == ("note", "note", "note")
    assert doctor.run_doctor(settings, as_json=False, fix=False, home=tmp_path) == 1
    assert "2 fault(s)" in capsys.readouterr().out


def test_a_damaged_database_is_a_fault(settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "TRIALS", {})
    settings.workspace.mkdir()
    (settings.workspace / "workspace.sqlite").write_bytes(b"no database at all" * 500)
    assert looked_at(settings, tmp_path)["records"].state == "fault"


def test_map_services_are_asked_only_where_they_may_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "TRIALS", {})
    closed = "http://127.0.0.1:9"  # nobody listens on the discard port
    settings = Settings(
        workspace=tmp_path, maps_online="online", nominatim_url=closed, overpass_urls=(f"{closed}/api",)
    )
    services = looked_at(settings, tmp_path)["map services"]
    assert services.state == "note"
    assert "0 of 2" in services.found


def test_a_host_that_starts_what_is_gone_is_a_fault(
    settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "TRIALS", {})
    install(HOSTS["cursor"], [sys.executable, "serve"], home=tmp_path)
    install(HOSTS["codex"], ["/gone/plannerforge", "serve"], home=tmp_path)
    found = looked_at(settings, tmp_path)
    assert (found["Cursor"].state, found["Codex"].state) == ("ok", "fault")
    assert "Zed" not in found
