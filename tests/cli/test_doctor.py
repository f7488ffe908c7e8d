"""``plannerforge doctor``: what is there is found, what is not is told with what mends it."""

import json
import socket
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from plannerforge.cli import doctor
from plannerforge.cli.hosts import BACKUP, HOSTS, install, start_command
from plannerforge.engine.catalog.vector_index import ensure_generation
from plannerforge.schemas.catalog import EMBEDDINGS_EXTRA
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
    assert "896" in found["text ranking"]["found"]


def test_missing_parts_are_reported_with_their_remedy(
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


def test_a_model_that_needs_an_extra_names_it(
    settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trial = doctor.TRIALS["text ranking"]
    without = "import sys; sys.modules |= dict.fromkeys(('torch', 'sentence_transformers'))"
    monkeypatch.setattr(doctor, "TRIALS", {"text ranking": replace(trial, program=without + trial.program)})
    other = settings.model_copy(update={"embedding_model": "owner/model"})
    ranking = looked_at(other, tmp_path)["text ranking"]
    assert ranking.state == "fault"
    assert "owner/model" in ranking.found
    assert EMBEDDINGS_EXTRA in ranking.mend


def test_a_damaged_database_is_a_fault(settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "TRIALS", {})
    settings.workspace.mkdir()
    (settings.workspace / "workspace.sqlite").write_bytes(b"no database at all" * 500)
    assert looked_at(settings, tmp_path)["records"].state == "fault"


def test_map_services_are_queried_only_if_allowed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "TRIALS", {})
    closed = "http://127.0.0.1:9"  # nobody listens on the discard port
    settings = Settings(
        workspace=tmp_path, maps_online="online", nominatim_url=closed, overpass_urls=(f"{closed}/api",)
    )
    services = looked_at(settings, tmp_path)["map services"]
    assert services.state == "note"
    assert "0 of 2" in services.found


def written(home: Path, entry: dict[str, Any]) -> Path:
    path = HOSTS["cursor"].file(home, "linux")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"mcpServers": {"plannerforge": entry}}), encoding="utf-8")
    return path


def test_a_host_that_reaches_the_server_by_http_is_right(
    settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "TRIALS", {})
    with socket.create_server(("127.0.0.1", 0)) as listener:
        here = f"http://127.0.0.1:{listener.getsockname()[1]}/mcp"
        written(tmp_path, {"type": "http", "url": here})
        found = looked_at(settings, tmp_path)["Cursor"]
        assert (found.state, found.found.endswith(f"HTTP at {here}")) == ("ok", True)
    silent = looked_at(settings, tmp_path)["Cursor"]
    assert (silent.state, silent.mend) == ("note", "plannerforge serve --http")
    written(tmp_path, {"url": "https://name:secret@forge.example/mcp?key=secret"})
    away = looked_at(settings, tmp_path)["Cursor"]
    assert (away.state, "secret" in away.found) == ("ok", False)


@pytest.mark.parametrize(
    "entry",
    [
        {"url": "forge.example/mcp"},
        {"url": "http://127.0.0.1:many/mcp"},
        {"url": "http://127.0.0.1:8765/mcp", "command": sys.executable},
        {},
    ],
)
def test_a_host_with_a_wrong_entry_is_a_fault(
    entry: dict[str, Any], settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "TRIALS", {})
    written(tmp_path, entry)
    found = looked_at(settings, tmp_path)["Cursor"]
    assert (found.state, found.mend) == ("fault", "plannerforge install cursor")


@pytest.mark.parametrize(
    ("command", "before"), [("/gone/plannerforge", []), ("/gone/python3", ["-P", "-m", "plannerforge"])]
)
def test_a_missing_program_is_named_again(
    command: str, before: list[str], settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "TRIALS", {})
    entry = {"command": command, "args": [*before, "serve", "--roots", "/data"], "env": {"A": "1"}}
    path = written(tmp_path, entry)
    assert doctor.run_doctor(settings, as_json=True, fix=True, home=tmp_path) == 0
    mended = json.loads(path.read_text(encoding="utf-8"))["mcpServers"]["plannerforge"]
    assert [mended["command"], *mended["args"]] == list(start_command(["--roots", "/data"]))
    assert mended["env"] == {"A": "1"}
    kept = path.with_name(path.name + BACKUP).read_text(encoding="utf-8")
    assert json.loads(kept)["mcpServers"]["plannerforge"] == entry


@pytest.mark.parametrize(
    "entry",
    [
        {"command": "/gone/docker", "args": ["run", "plannerforge", "serve"]},
        {"command": "/gone/plannerforge", "args": ["--version"]},
        {"url": "https://forge.example/mcp"},
        {"command": sys.executable, "args": ["serve"]},
    ],
)
def test_an_entry_of_another_form_is_left_alone(
    entry: dict[str, Any], settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "TRIALS", {})
    path = written(tmp_path, entry)
    before = path.read_bytes()
    doctor.run_doctor(settings, as_json=True, fix=True, home=tmp_path)
    assert path.read_bytes() == before


def test_the_user_s_folders_are_not_created_and_the_nearest_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(doctor, "TRIALS", {})
    (tmp_path / "scenarios").mkdir()
    settings = Settings(
        workspace=tmp_path / "new" / "workspace",
        roots=(tmp_path / "scenarois" / "mine",),
        map_folders=(tmp_path / "maps",),
        maps_online="offline",
    )
    before = looked_at(settings, tmp_path)
    assert f"{tmp_path / 'scenarois' / 'mine'} (nearest: {tmp_path / 'scenarios'})" in before["roots"].found
    assert f"{tmp_path / 'maps'} (nearest: {tmp_path})" in before["map folders"].found
    assert f"the folders above it from {tmp_path} on" in before["workspace"].mend
    assert doctor.run_doctor(settings, as_json=False, fix=True, home=tmp_path) == 0
    assert f"created {settings.workspace}" in capsys.readouterr().out.replace("\n", "")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["new", "scenarios"]


def test_a_damaged_text_index_is_a_fault_that_is_removed(
    settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "TRIALS", {})
    index = settings.workspace / "index"
    ensure_generation(index, {"one": "a truck"}, "ones", lambda texts: np.ones((len(texts), 1), dtype=np.float32))
    assert looked_at(settings, tmp_path)["index files"].state == "ok"
    (index / "vectors.sqlite").write_bytes(b"no database at all" * 500)
    (generation,) = (path for path in index.iterdir() if path.is_dir())
    (generation / "chroma" / "chroma.sqlite3").write_bytes(b"")
    damaged = looked_at(settings, tmp_path)["index files"]
    assert damaged.state == "fault"
    assert all(name in damaged.found for name in ("vectors.sqlite", generation.name))
    assert doctor.run_doctor(settings, as_json=True, fix=True, home=tmp_path) == 0
    assert [path.name for path in index.iterdir()] == ["writer.sqlite"]


def test_an_index_check_that_ends_by_a_signal_means_damage(
    settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "TRIALS", {})
    (settings.workspace / "index" / "generation").mkdir(parents=True)
    monkeypatch.setattr(doctor, "LOOK_AT_INDEX", "import os; os.abort()")
    assert "generation" in looked_at(settings, tmp_path)["index files"].found
    monkeypatch.setattr(doctor, "LOOK_AT_INDEX", "import no_such_library")
    assert looked_at(settings, tmp_path)["index files"].state == "note"
    doctor.run_doctor(settings, as_json=True, fix=True, home=tmp_path)
    assert (settings.workspace / "index" / "generation").is_dir(), "what was not looked at is not removed"


def test_a_host_entry_with_a_missing_program_is_a_fault(
    settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "TRIALS", {})
    install(HOSTS["cursor"], [sys.executable, "serve"], home=tmp_path)
    install(HOSTS["codex"], ["/gone/plannerforge", "serve"], home=tmp_path)
    found = looked_at(settings, tmp_path)
    assert (found["Cursor"].state, found["Codex"].state) == ("ok", "fault")
    assert "Zed" not in found
