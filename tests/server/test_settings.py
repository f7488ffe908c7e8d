"""Settings: flag over environment over file, and nothing misspelt goes unnoticed."""

import os
from pathlib import Path
from typing import Literal, get_args, get_origin

import pytest
from pydantic import ValidationError

from plannerforge.server.settings import Settings, settings_file


def write_file(text: str) -> None:
    settings_file().parent.mkdir(parents=True, exist_ok=True)
    settings_file().write_text(text)


def test_flag_wins_over_environment_and_environment_over_file(monkeypatch: pytest.MonkeyPatch) -> None:
    assert Settings().workers == 2
    write_file("workers = 3\njournal_mb = 7\n")
    assert Settings().workers == 3
    monkeypatch.setenv("PLANNERFORGE_WORKERS", "4")
    assert Settings().workers == 4
    assert Settings(workers=5).workers == 5
    assert Settings(workers=5).journal_mb == 7


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("wrokers = 3", "wrokers"),
        ("workers = 0", "workers"),
        ("tools = 'few'", "tools"),
        ("log_level = 'LOUD'", "log_level"),
    ],
)
def test_wrong_file_is_refused_by_name(text: str, named: str) -> None:
    write_file(text)
    with pytest.raises(ValidationError) as caught:
        Settings()
    assert [detail["loc"] for detail in caught.value.errors()] == [(named,)]


CHOICES = {name: field for name, field in Settings.model_fields.items() if get_origin(field.annotation) is Literal}


def test_a_word_of_a_setting_may_be_in_any_case(monkeypatch: pytest.MonkeyPatch) -> None:
    assert set(CHOICES) == {"maps_online", "tools", "log_level", "log_format"}
    for name, field in CHOICES.items():
        for word in get_args(field.annotation):
            for spelled in (word.upper(), word.title(), f" {word.lower()} "):
                assert getattr(Settings(**{name: spelled}), name) == word
    monkeypatch.setenv("PLANNERFORGE_MAPS_ONLINE", "Cache")
    write_file("log_level = 'info'\n")
    assert (Settings().maps_online, Settings().log_level) == ("cache", "INFO")


def test_wrong_variable_is_refused_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PLANNERFORGE_WORKERS", "many")
    with pytest.raises(ValidationError, match="workers"):
        Settings()


def test_folders_in_a_variable_are_separated_as_in_path(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    monkeypatch.setenv("PLANNERFORGE_ROOTS", f"{one}{os.pathsep}{two}")
    monkeypatch.setenv("PLANNERFORGE_MAP_FOLDERS", str(one))
    settings = Settings()
    assert (settings.roots, settings.map_folders) == ((one, two), (one,))


def test_folders_in_a_variable_may_be_a_json_list(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "settings.md").read_text(encoding="utf-8")
    assert """PLANNERFORGE_ROOTS='["/a", "/b"]'""" in page
    monkeypatch.setenv("PLANNERFORGE_ROOTS", '["/a", "/b"]')
    assert Settings(workspace=tmp_path).roots == (Path("/a"), Path("/b"))
    monkeypatch.setenv("PLANNERFORGE_ROOTS", '["/a", ')
    with pytest.raises(ValueError, match="begins like a JSON list"):
        Settings(workspace=tmp_path)


def test_folders_in_the_file_are_a_list(tmp_path: Path) -> None:
    write_file(f'roots = ["{tmp_path}"]')
    assert Settings().roots == (tmp_path,)


def test_roots_default_to_workspace_and_start_folder(tmp_path: Path) -> None:
    workspace, start = tmp_path / "workspace", tmp_path / "start"
    assert set(Settings(workspace=workspace).limits(start).roots) == {workspace, start}
    named = Settings(workspace=workspace, roots=(tmp_path / "data",)).limits(start)
    assert set(named.roots) == {workspace, tmp_path / "data"}, "named roots replace the start folder"


def test_limits_are_in_bytes_and_seconds(tmp_path: Path) -> None:
    limits = Settings(worker_memory_mb=1024, file_mb=2, operation_timeout_s=9, workers=3).limits(tmp_path)
    assert (limits.worker_memory_bytes, limits.file_bytes) == (1024**3, 2 * 1024**2)
    assert (limits.operation_timeout_s, limits.worker_count) == (9, 3)


def test_the_embedding_model_is_the_packaged_one_a_folder_or_a_name_on_the_hub(tmp_path: Path) -> None:
    folder = tmp_path / "model"
    folder.mkdir()
    (folder / "config.json").write_text("{}")
    for value in ("packaged", "all-MiniLM-L6-v2", "intfloat/e5-small", str(folder)):
        assert Settings(embedding_model=value).embedding_model == value
    for wrong in ("all-MiniLM", str(tmp_path), "./nowhere"):
        with pytest.raises(ValidationError, match="embedding_model"):
            Settings(embedding_model=wrong)


def test_every_setting_states_its_purpose() -> None:
    assert [name for name, field in Settings.model_fields.items() if not field.description] == []


def test_addresses_of_map_services_are_checked_and_listed_in_any_way(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PLANNERFORGE_OVERPASS_URLS", "https://one.example/api/, http://two.example:8080/api")
    monkeypatch.setenv("PLANNERFORGE_NOMINATIM_URL", "https://names.example/")
    services = Settings().map_services()
    assert services.overpass_urls == ("https://one.example/api", "http://two.example:8080/api")
    assert services.hosts == ("names.example", "one.example", "two.example:8080")
    assert services.mode == "offline"  # as conftest.py sets it
    monkeypatch.setenv("PLANNERFORGE_OVERPASS_URLS", '["https://one.example/api"]')
    assert Settings().overpass_urls == ("https://one.example/api",)
    for wrong in ("ftp://one.example", "https://user:word@one.example", "https://one.example/?x=1", ""):
        monkeypatch.setenv("PLANNERFORGE_OVERPASS_URLS", wrong)
        with pytest.raises(ValidationError, match="is not an address such as"):
            Settings()


def test_a_fresh_install_requests_only_unavailable_data_online(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PLANNERFORGE_MAPS_ONLINE")
    services = Settings().map_services()
    assert services.mode == "online"
    assert services.hosts[0] == "nominatim.openstreetmap.org"
    assert len(services.hosts) == 5
    assert services.user_agent.startswith("PlannerForge-MCP/")
    assert services.delay_s >= 1.0  # Nominatim's policy


PLANNER = """
[planners.theirs]
summary = "a planner of theirs"
command = ["/opt/theirs/bin/python", "/opt/theirs/plan.py"]
time_s = 30
"""


def test_programs_are_planners_by_a_section_each_of_the_file(monkeypatch: pytest.MonkeyPatch) -> None:
    write_file(PLANNER)
    assert Settings().planners["theirs"].time_s == 30
    monkeypatch.setenv("PLANNERFORGE_PLANNERS", '{"mine": {"summary": "mine", "command": ["python3", "/mine.py"]}}')
    assert set(Settings().planners) == {"theirs", "mine"}


@pytest.mark.parametrize(
    ("before", "after", "named"),
    [
        ("time_s", "times", ("planners", "theirs", "times")),
        ("/opt/theirs/bin/python", "bin/python", ("planners", "theirs", "command")),
    ],
)
def test_a_wrong_planner_in_the_file_is_refused_by_its_name(before: str, after: str, named: tuple[str, ...]) -> None:
    write_file(PLANNER.replace(before, after))
    with pytest.raises(ValidationError) as caught:
        Settings()
    assert [detail["loc"] for detail in caught.value.errors()] == [named]
