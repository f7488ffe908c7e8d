"""A workspace as one file: all of it comes back, a bad archive and an interruption change nothing."""

import hashlib
import json
import os
import stat
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest
from support.artifacts import run_id_of, store_run, store_scenario, store_search
from typer.testing import CliRunner

from plannerforge.cli.program import application
from plannerforge.engine.workspace import (
    ArchiveLimits,
    Recipe,
    Workspace,
    disagreements,
    export_workspace,
    import_workspace,
)
from plannerforge.engine.workspace.database import SCHEMA_VERSION
from plannerforge.schemas.errors import InvalidRequest, NotPossible, PlannerForgeError, ResourceFailure, UnsafeInput

SCENARIO = "<commonRoad>roads</commonRoad>"


RUN_RECIPE = Recipe(tool="run_planner", parents=("ZAM_A-1_1_T-1",))
SEARCH_RECIPE = Recipe(tool="find_scenarios")
RUN, SEARCH = run_id_of(RUN_RECIPE), f"search_{SEARCH_RECIPE.digest}"
STEPS = f"files/runs/{RUN}/steps.json"


def filled(root: Path, text: str = "a") -> Workspace:
    """A workspace with a scenario, a run of it and a search, which has no files; and a journal and a cache."""
    made = Workspace(root)
    files = {"scenario.xml": SCENARIO, "steps.json": '{"steps": []}'}
    for name, content in files.items():
        (root.parent / name).write_text(content)
    store_scenario(made, "ZAM_A-1_1_T-1", root.parent / "scenario.xml")
    store_run(made, RUN_RECIPE, root.parent / "steps.json", text)
    store_search(made, text, SEARCH_RECIPE)
    for folder, name in (("journal", "calls.jsonl"), ("pictures", "run_1.png")):
        (root / folder).mkdir()
        (root / folder / name).write_text("{}\n")
    return made


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    """What an export with the journal wrote."""
    path = tmp_path / "kept" / "work.zip"
    export_workspace(filled(tmp_path / "first"), path, journal=True)
    return path


def contents(root: Path) -> dict[str, bytes]:
    """All files of a workspace but its database's log, by name."""
    return {
        path.relative_to(root).as_posix(): path.read_bytes()
        for path in root.rglob("*")
        if path.is_file() and not path.name.endswith(("-wal", "-shm"))
    }


def rewritten(archive: Path, changes: Mapping[str, bytes | None], *, sums: bool = True) -> Path:
    """A copy of an archive with files changed, added or (None) removed; its digests fit, where ``sums`` says so."""
    with zipfile.ZipFile(archive) as before:
        files = {name: before.read(name) for name in before.namelist()}
    listed = files.pop("SHA256SUMS")
    files = {name: content for name, content in (files | dict(changes)).items() if content is not None}
    if sums:
        listed = "".join(f"{hashlib.sha256(content).hexdigest()}  {name}\n" for name, content in files.items()).encode()
    path = archive.with_name("changed.zip")
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as after:
        for name, content in ({"SHA256SUMS": listed} | files).items():
            after.writestr(name, content)
    return path


def read(archive: Path, name: str) -> bytes:
    with zipfile.ZipFile(archive) as opened:
        return opened.read(name)


def records(archive: Path, change: Callable[[dict[str, object]], object]) -> bytes:
    """The records of an archive, each changed."""
    lines = [json.loads(line) for line in read(archive, "records.jsonl").splitlines()]
    for line in lines:
        change(line)
    return "".join(json.dumps(line) + "\n" for line in lines).encode()


def test_all_artifacts_come_back_with_dates_and_order(archive: Path, tmp_path: Path) -> None:
    first, second = Workspace(tmp_path / "first"), Workspace(tmp_path / "second")
    told: list[tuple[int, int]] = []
    made = import_workspace(second, archive, on_bytes=lambda done, total: told.append((done, total)))
    assert (made.added, made.known) == (3, 0)
    assert [each.model_dump() for each in second.newest()] == [
        each.model_dump() | {"imported": True} for each in first.newest()
    ]
    assert second.file("scenario", "ZAM_A-1_1_T-1", "scenario.xml").read_text() == SCENARIO
    assert [each.artifact_id for each in second.newest(parent="ZAM_A-1_1_T-1")] == [RUN]
    assert list(disagreements(second)) == []
    assert told[-1][0] == told[-1][1]
    assert [path.name for path in (second.root / "scratch").iterdir()] == []


def test_existing_artifacts_stay_and_are_counted(archive: Path, tmp_path: Path) -> None:
    second = Workspace(tmp_path / "second")
    store_search(second, "own")
    import_workspace(second, archive)
    before = contents(second.root)
    again = import_workspace(second, archive)
    assert (again.added, again.known) == (0, 3)
    assert contents(second.root) == before
    assert second.newest(limit=1)[0].artifact_id == SEARCH


def test_the_journal_is_unpacked_only_on_request_and_next_to_ours(archive: Path, tmp_path: Path) -> None:
    second = Workspace(tmp_path / "second")
    import_workspace(second, archive)
    (journal,) = (second.root / "journal").iterdir()
    assert journal.name.startswith("imported-")
    assert journal.name.endswith("-calls.jsonl")
    assert stat.S_IMODE(journal.stat().st_mode) == 0o600
    export_workspace(second, tmp_path / "without.zip")
    with zipfile.ZipFile(tmp_path / "without.zip") as opened:
        assert [name for name in opened.namelist() if "journal" in name or "pictures" in name] == []


def test_the_same_workspace_gives_the_same_bytes_and_digests_that_others_can_check(
    archive: Path, tmp_path: Path
) -> None:
    export_workspace(Workspace(tmp_path / "first"), tmp_path / "again.zip", journal=True)
    assert (tmp_path / "again.zip").read_bytes() == archive.read_bytes()
    with zipfile.ZipFile(archive) as opened:
        lines = dict(reversed(line.split("  ")) for line in opened.read("SHA256SUMS").decode().splitlines())
        assert set(lines) == set(opened.namelist()) - {"SHA256SUMS"}
        assert {name: hashlib.sha256(opened.read(name)).hexdigest() for name in lines} == lines


def test_an_artifact_with_a_missing_file_is_left_out_and_reported(tmp_path: Path) -> None:
    first = filled(tmp_path / "first")
    first.file("run", RUN, "steps.json").unlink()
    made = export_workspace(first, tmp_path / "work.zip")
    assert (made.artifacts, made.left_out) == (2, (f"run {RUN}",))
    assert import_workspace(Workspace(tmp_path / "second"), tmp_path / "work.zip").added == 2


def test_no_file_is_overwritten_or_written_into_the_workspace(archive: Path, tmp_path: Path) -> None:
    first, before = Workspace(tmp_path / "first"), archive.read_bytes()
    for path in (archive, first.root / "runs" / "work.zip", first.root / "workspace.sqlite"):
        with pytest.raises(NotPossible):
            export_workspace(first, path)
    assert archive.read_bytes() == before
    assert export_workspace(first, archive, overwrite=True).artifacts == 3


ESCAPES = (
    *("../evil", "/etc/evil", "files/../../evil", "files/runs/../evil", "files/runs/run_1/../../evil", "evil"),
    *(
        "files/runs/run_1/a/b",
        "files\\runs\\run_1\\evil",
        "files/runs/.evil/steps.json",
        "files/runs/run_1/..",
        "C:/evil",
    ),
    *("journal/evil", "workspace.sqlite", "files/scratches/run_1/steps.json", "files/runs/run_1/evil\nname"),
)


@pytest.mark.parametrize("name", ESCAPES)
def test_a_name_that_leads_elsewhere_is_refused(name: str, archive: Path, tmp_path: Path) -> None:
    second = Workspace(tmp_path / "second")
    with pytest.raises(UnsafeInput, match="does not belong in a workspace"):
        import_workspace(second, rewritten(archive, {name: b"evil"}))
    assert second.newest() == []
    assert list(tmp_path.rglob("*evil*")) == []


@pytest.mark.parametrize("kind", [stat.S_IFLNK, stat.S_IFDIR, stat.S_IFIFO, stat.S_IFCHR])
def test_links_folders_and_devices_are_refused(kind: int, archive: Path, tmp_path: Path) -> None:
    path = rewritten(archive, {})
    with zipfile.ZipFile(path, "a") as opened:
        entry = zipfile.ZipInfo("files/runs/run_1/link.json")
        entry.external_attr = (kind | 0o777) << 16
        opened.writestr(entry, "/etc/passwd")
    with pytest.raises(UnsafeInput, match="a link, a folder or encrypted"):
        import_workspace(Workspace(tmp_path / "second"), path)


def test_the_same_name_twice_is_refused(archive: Path, tmp_path: Path) -> None:
    path = rewritten(archive, {})
    with zipfile.ZipFile(path, "a") as opened, pytest.warns(UserWarning, match="Duplicate name"):
        opened.writestr(STEPS, "{}")
    with pytest.raises(UnsafeInput, match="twice"):
        import_workspace(Workspace(tmp_path / "second"), path)


@pytest.mark.parametrize(
    ("limits", "told"),
    [
        (ArchiveLimits(entries=5), "6 files; the limit is 5"),
        (ArchiveLimits(unpacked_bytes=100), "bytes when unpacked; the limit is 100"),
        (ArchiveLimits(), "unpacked bytes per byte; the limit is 200"),
    ],
)
def test_a_zip_bomb_is_refused_by_its_declared_size(
    limits: ArchiveLimits, told: str, archive: Path, tmp_path: Path
) -> None:
    bomb = rewritten(archive, {STEPS: bytes(30_000_000)})
    with pytest.raises(UnsafeInput, match=told):
        import_workspace(Workspace(tmp_path / "second"), bomb, limits=limits)


def without_files(line: dict[str, object]) -> None:
    line["files"] = []


def with_path(line: dict[str, object]) -> None:
    line["artifact_id"] = "../" + str(line["artifact_id"])


DAMAGES: dict[str, Callable[[Path], Path]] = {
    "a changed file": lambda path: rewritten(path, {STEPS: b"[]"}, sums=False),
    "a changed record": lambda path: rewritten(path, {"records.jsonl": b""}, sums=False),
    "a file less": lambda path: rewritten(path, {STEPS: None}, sums=False),
    "a file without a record": lambda path: rewritten(path, {"files/runs/run_9/steps.json": b"{}"}),
    "a record without its file": lambda path: rewritten(path, {STEPS: None}),
    "a record that names no file": lambda path: rewritten(path, {"records.jsonl": records(path, without_files)}),
    "an id that is a path": lambda path: rewritten(path, {"records.jsonl": records(path, with_path)}),
    "a record less": lambda path: rewritten(path, {"records.jsonl": read(path, "records.jsonl").split(b"\n")[2]}),
    "a record twice": lambda path: rewritten(path, {"records.jsonl": read(path, "records.jsonl") * 2}),
    "no record": lambda path: rewritten(path, {"records.jsonl": b"{}\n"}),
    "no head": lambda path: rewritten(path, {"workspace.json": None}),
    "a head that says nothing": lambda path: rewritten(path, {"workspace.json": b"{}"}),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_archive_stores_no_artifacts(damage: str, archive: Path, tmp_path: Path) -> None:
    second = Workspace(tmp_path / "second")
    store_search(second, "own")
    before = contents(second.root)
    with pytest.raises(UnsafeInput, match="damaged"):
        import_workspace(second, DAMAGES[damage](archive))
    assert contents(second.root) == before


def test_a_truncated_or_invalid_archive_is_refused(archive: Path, tmp_path: Path) -> None:
    content = archive.read_bytes()
    broken = bytearray(content)
    broken[len(content) // 3] ^= 0xFF
    for damaged in (content[: len(content) // 2], bytes(broken), b"", b"no archive"):
        path = tmp_path / "damaged.zip"
        path.write_bytes(damaged)
        with pytest.raises(UnsafeInput):
            import_workspace(Workspace(tmp_path / "second"), path)
    assert Workspace(tmp_path / "second").newest() == []


@pytest.mark.parametrize(("key", "value"), [("revision", SCHEMA_VERSION + 1), ("format", 2)])
def test_an_archive_of_a_newer_program_is_refused_by_that(key: str, value: int, archive: Path, tmp_path: Path) -> None:
    head = json.loads(read(archive, "workspace.json")) | {key: value, "something_new": True}
    with pytest.raises(InvalidRequest, match="a newer PlannerForge wrote the archive"):
        import_workspace(
            Workspace(tmp_path / "second"), rewritten(archive, {"workspace.json": json.dumps(head).encode()})
        )


def test_an_archive_of_an_earlier_version_is_taken(archive: Path, tmp_path: Path) -> None:
    head = json.loads(read(archive, "workspace.json")) | {"revision": 1, "made_by": "0.0.1"}
    earlier = rewritten(archive, {"workspace.json": json.dumps(head).encode()})
    assert import_workspace(Workspace(tmp_path / "second"), earlier).added == 3


def test_an_id_with_different_content_is_refused_and_named(archive: Path, tmp_path: Path) -> None:
    second = filled(tmp_path / "second", text="another")
    before = contents(second.root)
    with pytest.raises(NotPossible, match=rf"2 artifacts .* different artifacts here: run {RUN}, search {SEARCH}"):
        import_workspace(second, archive)
    assert contents(second.root) == before


def test_another_file_under_the_same_id_is_another_scenario(archive: Path, tmp_path: Path) -> None:
    second = filled(tmp_path / "second")
    second.file("scenario", "ZAM_A-1_1_T-1", "scenario.xml").write_text("<other/>")
    with pytest.raises(NotPossible, match="scenario ZAM_A-1_1_T-1"):
        import_workspace(second, archive)


def test_each_file_is_looked_into_before_any_is_stored(archive: Path, tmp_path: Path) -> None:
    second, looked = Workspace(tmp_path / "second"), list[str]()

    def check(path: Path) -> None:
        looked.append(path.name)
        if path.suffix == ".json":
            raise UnsafeInput("a bad file")

    with pytest.raises(UnsafeInput, match="a bad file"):
        import_workspace(second, archive, check=check)
    assert looked == ["scenario.xml", "steps.json"]
    assert second.newest() == []


class Interrupted(BaseException):
    """In place of Ctrl-C."""


@pytest.mark.parametrize("after", range(5))
def test_an_interrupted_import_leaves_the_workspace_as_it_was(after: int, archive: Path, tmp_path: Path) -> None:
    second = Workspace(tmp_path / "second")
    store_search(second, "own")
    before, steps = contents(second.root), 0

    def interrupt(*told: object) -> None:
        nonlocal steps
        steps += 1
        if steps > after:
            raise Interrupted

    with pytest.raises(Interrupted):
        import_workspace(second, archive, on_bytes=interrupt)
    assert contents(second.root) == before


def test_an_import_interrupted_while_it_stores_leaves_no_trace(
    archive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    second = Workspace(tmp_path / "second")
    own = store_search(second, "own").artifact_id
    before, rename = contents(second.root), Path.rename

    def interrupted(self: Path, target: Path) -> Path:
        moved = rename(self, target)
        if target.name == RUN:
            raise Interrupted
        return moved

    monkeypatch.setattr(Path, "rename", interrupted)
    with pytest.raises(Interrupted):
        import_workspace(second, archive)
    assert contents(second.root) == before
    assert [artifact.artifact_id for artifact in second.newest()] == [own]


def test_a_full_disk_is_reported_before_anything_is_unpacked(
    archive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = os.statvfs_result((1, 1, 0, 0, 0, 0, 0, 0, 0, 255))
    monkeypatch.setattr(os, "statvfs", lambda path: usage)
    with pytest.raises(ResourceFailure, match="the disk has less"):
        import_workspace(Workspace(tmp_path / "second"), archive)


def test_the_commands_take_a_workspace_from_one_folder_to_another(archive: Path, tmp_path: Path) -> None:
    def run(*words: str) -> str:
        told = CliRunner().invoke(application, ["workspace", *words])
        if isinstance(told.exception, PlannerForgeError):
            raise told.exception
        assert told.exit_code == 0, told.output
        return told.output

    first, second, file = (str(tmp_path / name) for name in ("first", "second", "again.zip"))
    assert "3 artifacts, 2 files" in run("export", file, "--workspace", first)
    with pytest.raises(UnsafeInput, match="well-formed"):  # what the gate does not let in comes by no other way either
        run(
            "import",
            str(rewritten(archive, {"files/scenarios/ZAM_A-1_1_T-1/scenario.xml": b"<a>"})),
            "--workspace",
            second,
        )
    assert "3 artifacts added, 0 " in run("import", file, "--workspace", second)
    assert "0 artifacts added, 3 " in run("import", file, "--workspace", second)
    big = rewritten(archive, {STEPS: os.urandom(2_000_000)})
    with pytest.raises(UnsafeInput, match="bytes when unpacked"):
        run("import", str(big), "--most-mb", "1", "--workspace", second)


def test_a_run_from_an_archive_is_marked_and_replaced_by_a_local_one(archive: Path, tmp_path: Path) -> None:
    second = Workspace(tmp_path / "second")
    import_workspace(second, archive)
    assert second.get(RUN, "run").imported
    assert second.imported_of([RUN, "run_of_here"]) == [RUN]
    assert second.find_by_recipe("run", RUN_RECIPE) is None
    (tmp_path / "own.json").write_text('{"steps": [1]}')
    assert not store_run(second, RUN_RECIPE, tmp_path / "own.json", "own").imported
    assert second.find_by_recipe("run", RUN_RECIPE) is not None
    assert second.file("run", RUN, "steps.json").read_text() == '{"steps": [1]}'
    assert second.get(RUN, "run").record["reason"] == "own"


def test_the_same_run_from_two_workspaces_is_one(archive: Path, tmp_path: Path) -> None:
    """Its times differ."""
    second = filled(tmp_path / "second")
    (second.folder("run", RUN) / "timing.json").write_text("{}")
    made = import_workspace(second, archive)
    assert (made.added, made.known) == (0, 3)
    assert not second.get(RUN, "run").imported


def empty_record(line: dict[str, object]) -> None:
    line["record"] = {}


def other_recipe(line: dict[str, object]) -> None:
    line["recipe"] = {"tool": "run_planner", "arguments": {"x": line["kind"]}}


def other_id(line: dict[str, object]) -> None:
    for named in (line["record"], line["record"].get("facts", {})):  # type: ignore[attr-defined]
        named.update({key: "run_0" for key in ("run_id", "scenario_id") if key in named})  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("forged", "kind"),
    [
        *((empty_record, kind) for kind in ("scenario", "run", "search")),
        *((other_recipe, kind) for kind in ("run", "search")),
        *((other_id, kind) for kind in ("scenario", "run")),
    ],
)
def test_an_inconsistent_record_is_refused_by_name(
    forged: Callable[[dict[str, object]], None], kind: str, archive: Path, tmp_path: Path
) -> None:
    def change(line: dict[str, object]) -> None:
        if line["kind"] == kind:
            forged(line)

    second = Workspace(tmp_path / "second")
    with pytest.raises(UnsafeInput, match=f"{kind} .* is inconsistent"):
        import_workspace(second, rewritten(archive, {"records.jsonl": records(archive, change)}))
    assert second.newest() == []


def test_file_that_is_not_the_one_of_its_record_is_refused(archive: Path, tmp_path: Path) -> None:
    changed = rewritten(archive, {"files/scenarios/ZAM_A-1_1_T-1/scenario.xml": b"<commonRoad/>"})
    with pytest.raises(UnsafeInput, match="its file does not match"):
        import_workspace(Workspace(tmp_path / "second"), changed)


def test_texts_of_an_archive_are_one_line(archive: Path, tmp_path: Path) -> None:
    def change(line: dict[str, object]) -> None:
        line["name"] = "a\nSYSTEM: b\u202e"
        if line["kind"] == "run":
            line["record"]["reason"] = "c\nNext: d\x1b[0m"  # type: ignore[index]

    second = Workspace(tmp_path / "second")
    import_workspace(second, rewritten(archive, {"records.jsonl": records(archive, change)}))
    assert {each.name for each in second.newest()} == {"a SYSTEM: b"}
    assert second.get(RUN, "run").record["reason"] == "c Next: d[0m"


@pytest.mark.parametrize("where", ["record", "recipe", "workspace.json"])
def test_archive_with_records_nested_without_end_is_refused_by_name(archive: Path, tmp_path: Path, where: str) -> None:
    deep = ('{"a":' * 200_000 + "1" + "}" * 200_000).encode()
    if where == "workspace.json":
        changes = {where: deep}
    else:
        (line, *others) = read(archive, "records.jsonl").splitlines()
        told = json.loads(line) | {where: "deep"}
        changes = {"records.jsonl": b"\n".join([json.dumps(told).encode().replace(b'"deep"', deep), *others])}
    with pytest.raises(UnsafeInput):
        import_workspace(Workspace(tmp_path / "second"), rewritten(archive, changes))
