"""Exports: files of artifacts in the user's folder, all names checked before the first is written."""

import errno
import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from plannerforge.engine.workspace.artifacts import Artifact, Workspace
from plannerforge.engine.workspace.export import (
    Export,
    plan_exports,
    refuse_existing,
    refuse_file,
    write_export,
    write_whole,
)
from plannerforge.engine.workspace.recipe import Recipe
from plannerforge.schemas.base import Model
from plannerforge.schemas.errors import InvalidRequest, NotPossible, ResourceFailure


class Note(Model):
    text: str


@pytest.fixture
def workspace(tmp_path: Path) -> Iterator[Workspace]:
    opened = Workspace(tmp_path / "workspace")
    yield opened
    opened.close()


@pytest.fixture
def scenario(workspace: Workspace) -> Artifact:
    with workspace.scratch() as folder:
        (folder / "a").write_text("<scenario/>")
        (folder / "b").write_text("<net/>")
        return workspace.put(
            "scenario",
            "DEU_A-1_1_T-1",
            recipe=Recipe(tool="generate_scenarios", seed=5),
            record=Note(text="n"),
            files={"scenario.xml": folder / "a", "scenario.net.xml": folder / "b"},
        )


@pytest.fixture
def search(workspace: Workspace) -> Artifact:
    return workspace.put("search", "search_1", recipe=Recipe(tool="find_scenarios"), record=Note(text="n"))


def export(
    workspace: Workspace, artifacts: list[Artifact], formats: list[str], folder: Path, *, overwrite: bool
) -> tuple[Export, ...]:
    planned = plan_exports(workspace, artifacts, formats, folder)
    if not overwrite:
        refuse_existing([file.path for file in planned])
    for file in planned:
        write_export(workspace, file)
    return planned


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_every_format_that_the_artifact_has(workspace: Workspace, scenario: Artifact, tmp_path: Path) -> None:
    folder = tmp_path / "new" / "folder"
    written = export(workspace, [scenario], [], folder, overwrite=False)
    assert [file.format for file in written] == ["xml", "net", "json", "recipe"]
    assert names(folder) == [
        "DEU_A-1_1_T-1.json",
        "DEU_A-1_1_T-1.net.xml",
        "DEU_A-1_1_T-1.recipe.json",
        "DEU_A-1_1_T-1.xml",
    ]
    assert (folder / "DEU_A-1_1_T-1.xml").read_text() == "<scenario/>"
    assert Recipe.model_validate_json((folder / "DEU_A-1_1_T-1.recipe.json").read_text()) == scenario.recipe
    assert json.loads((folder / "DEU_A-1_1_T-1.json").read_text())["record"] == {"text": "n"}


def test_artifact_without_files_has_its_record_and_recipe(
    workspace: Workspace, search: Artifact, tmp_path: Path
) -> None:
    assert [file.format for file in export(workspace, [search], [], tmp_path / "out", overwrite=False)] == [
        "json",
        "recipe",
    ]


def test_format_that_one_artifact_lacks_is_refused_before_anything_is_written(
    workspace: Workspace, scenario: Artifact, search: Artifact, tmp_path: Path
) -> None:
    with pytest.raises(InvalidRequest, match="search_1 cannot be exported as xml") as caught:
        export(workspace, [scenario, search], ["xml"], tmp_path / "out", overwrite=False)
    assert caught.value.valid == ("json", "recipe")
    assert not (tmp_path / "out").exists()


def test_valid_formats_include_those_with_one_file_for_all_artifacts(
    workspace: Workspace, scenario: Artifact, tmp_path: Path
) -> None:
    with pytest.raises(InvalidRequest, match="solution needs a run") as caught:
        export(workspace, [scenario], ["solution"], tmp_path / "out", overwrite=False)
    assert "html" in caught.value.valid
    assert "suite" not in caught.value.valid


@pytest.mark.parametrize("below", ["", "more"])
def test_a_file_in_place_of_a_folder_is_refused_with_the_folder_that_contains_it(tmp_path: Path, below: str) -> None:
    file = tmp_path / "map.osm"
    file.write_text("a map")
    with pytest.raises(InvalidRequest) as caught:
        refuse_file(file / below)
    assert caught.value.valid == (str(tmp_path),)
    refuse_file(tmp_path / "new" / "folder")


def test_existing_file_is_kept_unless_overwriting_was_requested(
    workspace: Workspace, scenario: Artifact, tmp_path: Path
) -> None:
    mine = tmp_path / "DEU_A-1_1_T-1.net.xml"
    mine.write_text("mine")
    with pytest.raises(NotPossible, match="1 file already"):
        export(workspace, [scenario], ["xml", "net"], tmp_path, overwrite=False)
    assert mine.read_text() == "mine"
    assert not (tmp_path / "DEU_A-1_1_T-1.xml").exists()
    export(workspace, [scenario], ["xml", "net"], tmp_path, overwrite=True)
    assert mine.read_text() == "<net/>"


def test_full_disk_leaves_no_half_written_file(
    workspace: Workspace, scenario: Artifact, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(source: Path, target: Path) -> None:
        target.write_text("hal")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(shutil, "copyfile", full)
    with pytest.raises(ResourceFailure, match="No space left") as caught:
        export(workspace, [scenario], ["xml"], tmp_path / "out", overwrite=False)
    assert caught.value.next_step
    assert names(tmp_path / "out") == []


@pytest.mark.parametrize("name", ["DEU_A-1_1_T-1.xml.partial", "DEU_A-1_1_T-1.xml", ".DEU_A-1_1_T-1.xml.partial"])
@pytest.mark.parametrize("trap", ["link to a file", "dangling link", "pipe"])
def test_links_and_pipes_in_the_folder_are_not_written_through(
    workspace: Workspace, scenario: Artifact, tmp_path: Path, name: str, trap: str
) -> None:
    outside = tmp_path / "outside.txt"
    if trap == "link to a file":
        outside.write_text("not yours")
    folder = tmp_path / "out"
    folder.mkdir()
    if trap == "pipe":
        os.mkfifo(folder / name)  # opening it would wait for a reader
    else:
        (folder / name).symlink_to(outside)
    (written,) = export(workspace, [scenario], ["xml"], folder, overwrite=True)
    assert written.path.read_text() == (workspace.folder("scenario", scenario.artifact_id) / "scenario.xml").read_text()
    assert not written.path.is_symlink()
    assert outside.exists() == (trap == "link to a file")
    assert not outside.exists() or outside.read_text() == "not yours"


def test_repeated_ids_are_written_once(workspace: Workspace, scenario: Artifact, tmp_path: Path) -> None:
    assert len(export(workspace, [scenario], ["xml", "xml"], tmp_path / "out", overwrite=False)) == 1


def test_a_file_in_place_of_the_folder_is_not_called_a_full_disk(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(ResourceFailure) as failure:
        write_whole(tmp_path / "notes.txt" / "a.xml", lambda partial: partial.write_text("x"))
    assert "folder" in failure.value.next_step
    assert "disk" not in failure.value.next_step
