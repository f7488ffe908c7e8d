"""Artifacts: there whole or not at all, immutable, found by id, kind, parent and recipe, by several servers at once."""

import errno
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from plannerforge.engine.workspace import artifacts
from plannerforge.engine.workspace.artifacts import Artifact, NewArtifact, Workspace, stage
from plannerforge.engine.workspace.database import SCHEMA_VERSION
from plannerforge.engine.workspace.recipe import Recipe
from plannerforge.schemas.base import Model
from plannerforge.schemas.errors import ResourceFailure, UnknownName


class Note(Model):
    text: str
    speed_mps: float = 1.5


@pytest.fixture
def workspace(tmp_path: Path) -> Iterator[Workspace]:
    opened = Workspace(tmp_path / "workspace")
    yield opened
    opened.close()


def recipe(tool: str = "generate_scenarios", parents: tuple[str, ...] = (), **arguments: Any) -> Recipe:
    return Recipe(tool=tool, arguments=arguments, parents=parents)


def put(
    workspace: Workspace,
    artifact_id: str,
    text: str = "a",
    files: dict[str, str] | None = None,
    kind: artifacts.ArtifactKind = "scenario",
    **recipe_fields: Any,
) -> Artifact:
    with workspace.scratch() as folder:
        paths = {}
        for name, content in (files or {}).items():
            (folder / name).write_text(content)
            paths[name] = folder / name
        made_by = recipe(**{"text": text, **recipe_fields})
        return workspace.put(
            kind, artifact_id, recipe=made_by, record=Note(text=text), files=paths, name=f"note {text}"
        )


def left_in(root: Path) -> list[str]:
    return sorted(
        str(path.relative_to(root)) for path in root.rglob("*") if path.is_file() and "sqlite" not in path.name
    )


def test_stored_artifact_is_read_back_whole(workspace: Workspace) -> None:
    made = put(workspace, "DEU_A-1_1_T-1", "first", {"scenario.xml": "<x/>", "scenario.net.xml": "<net/>"})
    found = workspace.get("DEU_A-1_1_T-1", "scenario")
    assert found == made
    assert found.read(Note) == Note(text="first")
    assert found.recipe.tool == "generate_scenarios"
    assert workspace.file("scenario", "DEU_A-1_1_T-1", "scenario.xml").read_text() == "<x/>"
    assert left_in(workspace.root) == [
        "scenarios/DEU_A-1_1_T-1/scenario.net.xml",
        "scenarios/DEU_A-1_1_T-1/scenario.xml",
    ]


def test_another_server_s_changes_are_seen_after_an_earlier_read(workspace: Workspace) -> None:
    put(workspace, "DEU_A-1_1_T-1", "first")
    assert workspace.get("DEU_A-1_1_T-1", "scenario").read(Note) == Note(text="first")
    other = Workspace(workspace.root)
    other.amend("scenario", "DEU_A-1_1_T-1", Note(text="second"))
    assert workspace.get("DEU_A-1_1_T-1", "scenario").read(Note) == Note(text="second")
    with other.database.writing() as connection:
        connection.execute("DELETE FROM artifacts")
    assert workspace.find("scenario", "DEU_A-1_1_T-1") is None
    assert workspace.newest() == []
    other.close()


def test_json_of_an_artifact_is_read_once(workspace: Workspace) -> None:
    put(workspace, "DEU_A-1_1_T-1", "first")
    (listed,) = workspace.newest()
    assert listed is workspace.get("DEU_A-1_1_T-1", "scenario") is workspace.newest_made(1)[0]


def test_same_id_again_gives_the_stored_one_untouched(workspace: Workspace) -> None:
    first = put(workspace, "DEU_A-1_1_T-1", "first", {"scenario.xml": "first"})
    again = put(workspace, "DEU_A-1_1_T-1", "second", {"scenario.xml": "second"})
    assert again == first
    assert workspace.file("scenario", "DEU_A-1_1_T-1", "scenario.xml").read_text() == "first"
    assert len(workspace.newest()) == 1


def test_a_full_disk_while_files_are_placed_leaves_no_artifact(
    workspace: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = shutil.copyfile

    def full_on_the_second(source: Path, target: Path) -> object:
        if target.name == "second.xml":
            target.write_text("hal")
            raise OSError(errno.ENOSPC, "No space left on device")
        return real(source, target)

    monkeypatch.setattr(shutil, "copyfile", full_on_the_second)
    with pytest.raises(ResourceFailure, match="No space left on device") as caught:
        put(workspace, "DEU_A-1_1_T-1", files={"first.xml": "1", "second.xml": "2"})
    assert "free disk space" in caught.value.text
    assert left_in(workspace.root) == []
    assert workspace.find("scenario", "DEU_A-1_1_T-1") is None

    monkeypatch.setattr(shutil, "copyfile", real)
    put(workspace, "DEU_A-1_1_T-1", files={"first.xml": "1", "second.xml": "2"})
    assert workspace.file("scenario", "DEU_A-1_1_T-1", "second.xml").read_text() == "2"


def test_a_record_that_does_not_fit_removes_every_folder_of_its_transaction(workspace: Workspace) -> None:
    workspace.find("scenario", "none")
    connection = workspace.database.connection()
    pages = connection.execute("PRAGMA page_count").fetchone()[0]
    connection.execute(f"PRAGMA max_page_count = {pages}")  # a full disk, as SQLite sees it
    with workspace.scratch() as folder:
        new = []
        for number in range(1, 30):
            file = folder / f"{number}.xml"
            file.write_text("x")
            record = Note(text="x" * 4000)
            recipe = Recipe(tool="test", arguments={"number": number})
            new.append(NewArtifact("scenario", f"DEU_A-{number}_1_T-1", recipe, record, {"scenario.xml": file}))
        with pytest.raises(ResourceFailure):
            workspace.put_staged([stage(each, folder / each.artifact_id) for each in new])
    assert workspace.newest() == []
    assert left_in(workspace.root) == []


def test_a_workspace_on_a_full_disk_still_lists_its_artifacts(
    workspace: Workspace, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    put(workspace, "DEU_A-1_1_T-1", files={"scenario.xml": "1"})
    workspace.close()
    real = sqlite3.connect

    class Full(sqlite3.Connection):
        def execute(self, sql: str, *values: object) -> sqlite3.Cursor:
            if "journal_mode" in sql:
                error = sqlite3.OperationalError("disk I/O error")
                error.sqlite_errorcode = sqlite3.SQLITE_IOERR
                raise error
            return super().execute(sql, *values)

    def on_a_full_disk(*given: object, **options: object) -> sqlite3.Connection:
        return real(*given, **options, factory=Full)  # type: ignore[call-overload,no-any-return]

    monkeypatch.setattr(sqlite3, "connect", on_a_full_disk)
    assert [artifact.artifact_id for artifact in workspace.newest()] == ["DEU_A-1_1_T-1"]
    assert "can only be read" in caplog.text
    with pytest.raises(ResourceFailure, match="disk I/O error"):
        put(workspace, "DEU_A-2_1_T-1", files={"scenario.xml": "2"})
    monkeypatch.undo()
    put(workspace, "DEU_A-2_1_T-1", files={"scenario.xml": "2"})
    assert len(workspace.newest()) == 2


@pytest.mark.parametrize("owned", ["", "scenarios", "scenarios/x.xml", "scratch/a", "workspace.sqlite-wal", "pictures"])
def test_a_workspace_owns_its_folder_and_its_files(workspace: Workspace, owned: str) -> None:
    assert workspace.owns(workspace.root / owned)


def test_folders_of_users_are_not_owned(workspace: Workspace) -> None:
    assert not workspace.owns(workspace.root / "exports" / "a.xml")
    assert not workspace.owns(workspace.root.parent)


def test_new_workspace_is_private(workspace: Workspace) -> None:
    put(workspace, "DEU_A-1_1_T-1")
    assert workspace.root.stat().st_mode & 0o077 == 0


def test_files_that_a_dead_server_left_without_a_record_are_replaced(workspace: Workspace) -> None:
    orphan = workspace.folder("scenario", "DEU_A-1_1_T-1")
    orphan.mkdir(parents=True)
    (orphan / "scenario.xml").write_text("left behind")
    put(workspace, "DEU_A-1_1_T-1", files={"scenario.xml": "whole"})
    assert workspace.file("scenario", "DEU_A-1_1_T-1", "scenario.xml").read_text() == "whole"


def test_failed_record_leaves_no_artifact_and_the_next_attempt_succeeds(
    workspace: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Recipe, "model_dump_json", lambda self: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        put(workspace, "DEU_A-1_1_T-1", "first", {"scenario.xml": "first"})
    monkeypatch.undo()
    assert workspace.find("scenario", "DEU_A-1_1_T-1") is None
    put(workspace, "DEU_A-1_1_T-1", "second", {"scenario.xml": "second"})
    assert workspace.file("scenario", "DEU_A-1_1_T-1", "scenario.xml").read_text() == "second"


def test_latest_is_the_newest_of_its_kind(workspace: Workspace) -> None:
    put(workspace, "DEU_A-1_1_T-1")
    put(workspace, "DEU_B-1_1_T-1")
    put(workspace, "run_1", kind="run")
    assert workspace.get("latest", "scenario").artifact_id == "DEU_B-1_1_T-1"
    with pytest.raises(UnknownName, match="no batch yet") as caught:
        workspace.get("latest", "batch")
    assert "run_planner" in caught.value.next_step


def test_an_unknown_id_names_the_nearest_and_the_tool_that_creates_one(workspace: Workspace) -> None:
    for town in ("Muc", "Lohmar", "Cologne"):
        put(workspace, f"DEU_{town}-1_1_T-1")
    with pytest.raises(UnknownName, match="no scenario 'DEU_Lomar-1_1_T-1'") as caught:
        workspace.get("DEU_Lomar-1_1_T-1", "scenario")
    assert caught.value.valid[0] == "DEU_Lohmar-1_1_T-1"
    assert "find_scenarios" in caught.value.next_step
    with pytest.raises(UnknownName) as caught:
        workspace.kind_of("DEU_Cologn-1_1_T-1")
    assert caught.value.valid[0] == "DEU_Cologne-1_1_T-1"


def test_id_of_another_kind_is_not_found(workspace: Workspace) -> None:
    put(workspace, "run_1", kind="run")
    assert workspace.kind_of("run_1") == "run"
    with pytest.raises(UnknownName):
        workspace.get("run_1", "scenario")


def test_newest_filters_by_kind_parent_and_text_and_pages(workspace: Workspace) -> None:
    for number in range(4):
        put(workspace, f"DEU_A-{number}_1_T-1", text=f"Rainy {number}", parents=(f"map_{number % 2}",))
    put(workspace, "run_1", kind="run", tool="run_planner")

    def ids(**filters: Any) -> list[str]:
        return [artifact.artifact_id for artifact in workspace.newest(**filters)]

    assert ids() == ["run_1", "DEU_A-3_1_T-1", "DEU_A-2_1_T-1", "DEU_A-1_1_T-1", "DEU_A-0_1_T-1"]
    assert ids(kind="scenario", limit=2, offset=1) == ["DEU_A-2_1_T-1", "DEU_A-1_1_T-1"]
    assert ids(parent="map_1") == ["DEU_A-3_1_T-1", "DEU_A-1_1_T-1"]
    assert ids(text="rAINY 2") == ["DEU_A-2_1_T-1"]
    assert ids(text="run_planner") == ["run_1"]
    assert ids(text="%") == []


def test_an_artifact_is_found_by_its_recipe(workspace: Workspace) -> None:
    made = put(workspace, "DEU_A-1_1_T-1", "first")
    assert workspace.find_by_recipe("scenario", recipe(text="first")) == made
    assert workspace.find_by_recipe("scenario", recipe(text="other")) is None
    assert workspace.find_by_recipe("run", recipe(text="first")) is None


@pytest.mark.parametrize("artifact_id", ["../../etc/passwd", "..", ".hidden", "a/b", "", "a b", "x" * 121, "-rf"])
def test_an_id_that_is_not_a_folder_name_is_refused(workspace: Workspace, artifact_id: str) -> None:
    with pytest.raises(UnknownName):
        put(workspace, artifact_id, files={"scenario.xml": "x"})
    with pytest.raises(UnknownName):
        workspace.file("scenario", artifact_id, "scenario.xml")
    assert left_in(workspace.root) == []


def test_a_missing_file_names_the_existing_ones(workspace: Workspace) -> None:
    put(workspace, "DEU_A-1_1_T-1", files={"scenario.xml": "x"})
    with pytest.raises(UnknownName) as caught:
        workspace.file("scenario", "DEU_A-1_1_T-1", "scenario.net.xml")
    assert caught.value.valid == ("scenario.xml",)


def test_scratch_is_deleted_after_the_block_even_when_it_fails(workspace: Workspace) -> None:
    with pytest.raises(ZeroDivisionError), workspace.scratch() as folder:  # noqa: PT012 - the block is what fails
        (folder / "file").write_text("x")
        raise ZeroDivisionError
    assert not folder.exists()


def test_two_servers_see_each_others_artifacts(workspace: Workspace) -> None:
    other = Workspace(workspace.root)
    put(workspace, "DEU_A-1_1_T-1", "mine", {"scenario.xml": "mine"})
    assert other.get("latest", "scenario").read(Note).text == "mine"
    assert put(other, "DEU_A-1_1_T-1", "theirs", {"scenario.xml": "theirs"}).read(Note).text == "mine"
    other.close()


PUT_MANY = """
import sys
from pathlib import Path
from plannerforge.engine.workspace.artifacts import Workspace
from plannerforge.engine.workspace.recipe import Recipe

root, author = Path(sys.argv[1]), sys.argv[2]
workspace = Workspace(root)
print("ready", flush=True)
sys.stdin.readline()
for number in range(10):
    for artifact_id in (f"DEU_Own{author}-{number}_1_T-1", f"DEU_Same-{number}_1_T-1"):
        with workspace.scratch() as folder:
            (folder / "file").write_text(author)
            recipe = Recipe(tool="put_many", arguments={"author": author})
            files = {"scenario.xml": folder / "file"}
            workspace.put("scenario", artifact_id, recipe=recipe, record=recipe, files=files)
"""


def test_processes_on_one_new_workspace_at_once_store_all_artifacts_intact(tmp_path: Path) -> None:
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", PUT_MANY, str(tmp_path / "workspace"), author],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for author in "ABCD"
    ]
    for process in processes:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
    for process in processes:
        assert process.stdin is not None
        process.stdin.write("go\n")
        process.stdin.flush()
    errors = [process.communicate()[1] for process in processes]
    assert errors == [""] * 4

    workspace = Workspace(tmp_path / "workspace")
    stored = workspace.newest(limit=1000)
    assert len(stored) == 50
    for artifact in stored:
        file = workspace.file("scenario", artifact.artifact_id, "scenario.xml")
        assert file.read_text() == artifact.recipe.arguments["author"], "record and file come from one server"
    workspace.close()


def test_workspace_of_a_newer_version_is_refused_and_left_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "workspace.sqlite"
    with sqlite3.connect(path) as connection:
        connection.execute(f"PRAGMA user_version = {SCHEMA_VERSION + 1}")
    connection.close()
    workspace = Workspace(tmp_path)
    with pytest.raises(ResourceFailure, match=f"schema version {SCHEMA_VERSION + 1}") as caught:
        workspace.newest()
    assert "newer PlannerForge" in caught.value.text
    connection = sqlite3.connect(path)
    assert connection.execute("SELECT count(*) FROM sqlite_master").fetchone() == (0,)
    connection.close()


def test_a_file_that_is_not_a_database_is_a_resource_failure(tmp_path: Path) -> None:
    (tmp_path / "workspace.sqlite").write_bytes(b"no database at all " * 100)
    with pytest.raises(ResourceFailure, match="not a database"):
        Workspace(tmp_path).newest()


def test_a_folder_that_cannot_be_created_is_a_resource_failure(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ResourceFailure):
        Workspace(tmp_path / "file" / "workspace").newest()
    with pytest.raises(ResourceFailure), Workspace(tmp_path / "file" / "workspace").scratch():
        pass
