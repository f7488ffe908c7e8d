"""The starter catalogue: packaged scenarios that the generator created from the built-in maps.

The archive contains ``manifest.json``, ``facts.json`` (facts by scenario id, so that a new workspace need not parse
files) and, for every scenario, ``scenarios/<id>.xml`` with ``scenarios/<id>.net.xml``.
"""

import hashlib
import json
import os
import tempfile
import zipfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from importlib.resources import as_file, files
from pathlib import Path

from ...schemas.errors import ResourceFailure
from ...schemas.scenarios import ScenarioFacts, ScenarioRecord
from ..workspace import STARTER_TOOL, NewArtifact, Recipe, Workspace, disk_failure
from .tables import refresh

ARCHIVE = "starter.zip"
_BUS_AHEAD = "ZAM_Landmoor-31_1_T-1"
"""The starter scenario that shows whether a planner considers others. A test checks what happens in it."""
THREADS = 4
"""Unpacking and waiting for the disk release the interpreter's lock (chosen)."""
_MARK = "CREATE TABLE IF NOT EXISTS catalog_starter (content TEXT PRIMARY KEY)"


def open_catalogue(workspace: Workspace, *, with_starter: bool = True) -> None:
    """Prepare the catalogue: load the starter scenarios once per workspace, then enter all other stored scenarios.

    Raises:
        ResourceFailure: the workspace cannot be written, or the packaged archive is broken.
    """
    if with_starter:
        _load_starter(workspace)
    refresh(workspace.database)


@contextmanager
def starter_files(count: int) -> Iterator[tuple[Path, ...]]:
    """Yield ``count`` starter scenarios in a temporary folder while the block runs.

    In the first scenario, an ego that keeps its lane and speed hits a bus ahead. The remaining scenarios come from as
    many different towns as possible.

    Raises:
        ResourceFailure: the disk is full.
    """
    with as_file(files("plannerforge.engine.catalog") / ARCHIVE) as path, zipfile.ZipFile(path) as opened:
        names = sorted(
            (name for name in opened.namelist() if name.endswith("_T-1.xml")),
            key=lambda name: (Path(name).stem != _BUS_AHEAD, name),
        )
        towns = sorted(names, key=lambda name: [other for other in names if _town(other) == _town(name)].index(name))
        with tempfile.TemporaryDirectory(prefix="plannerforge-") as folder:
            copies = [Path(folder, Path(name).name) for name in towns[:count]]
            for name, copy in zip(towns, copies, strict=False):
                _write(copy, opened.read(name))
            yield tuple(copies)


def _town(name: str) -> str:
    return name.partition("-")[0]


def _load_starter(workspace: Workspace) -> None:
    if _loaded(workspace):
        return
    archive = files("plannerforge.engine.catalog") / ARCHIVE
    if not archive.is_file():
        return
    with as_file(archive) as path:
        content = hashlib.sha256(path.read_bytes()).hexdigest()
        try:
            with zipfile.ZipFile(path) as opened:
                _put_starter(workspace, opened)
        except (zipfile.BadZipFile, KeyError, ValueError) as error:
            raise ResourceFailure(
                f"the starter catalogue {ARCHIVE} is broken: {error}", next_step="reinstall the package"
            ) from error
    with workspace.database.writing() as connection:
        connection.execute("INSERT OR IGNORE INTO catalog_starter VALUES (?)", (content,))


def _put_starter(workspace: Workspace, opened: zipfile.ZipFile) -> None:
    """Store all scenarios of an archive in one transaction; existing scenarios are unchanged."""
    facts_by_id = json.loads(opened.read("facts.json"))
    made_by = {entry["id"]: entry for entry in json.loads(opened.read("manifest.json"))}

    def stage(scenario_id: str) -> NewArtifact:
        copies, content = _unpack(opened, scenario_id, folder / scenario_id)
        facts = ScenarioFacts.model_validate(facts_by_id[scenario_id])
        recipe = Recipe(tool=STARTER_TOOL, arguments={"content": content, "made_by": made_by[scenario_id]})
        record = ScenarioRecord(facts=facts, origin="starter", content=content)
        return NewArtifact("scenario", scenario_id, recipe, record, files={}, copies=copies)

    with workspace.scratch() as folder, ThreadPoolExecutor(THREADS) as threads:
        workspace.put_staged(list(threads.map(stage, sorted(facts_by_id))))


def _unpack(opened: zipfile.ZipFile, scenario_id: str, folder: Path) -> tuple[Path, str]:
    """Write a scenario's folder to the disk, and return it with the digest of its XML."""
    xml = opened.read(f"scenarios/{scenario_id}.xml")
    net = f"scenarios/{scenario_id}.net.xml"
    try:
        folder.mkdir()
        _write(folder / "scenario.xml", xml)
        if net in opened.NameToInfo:
            _write(folder / "scenario.net.xml", opened.read(net))
    except OSError as error:
        raise disk_failure(folder, error) from error
    return folder, hashlib.sha256(xml).hexdigest()


def _write(path: Path, content: bytes) -> None:
    with path.open("wb") as stream:
        stream.write(content)
        stream.flush()
        os.fsync(stream.fileno())


def _loaded(workspace: Workspace) -> bool:
    connection = workspace.database.connection()
    row = connection.execute("SELECT 1 FROM sqlite_master WHERE name = 'catalog_starter'").fetchone()
    if row is None:
        with workspace.database.writing() as writing:
            writing.execute(_MARK)
        return False
    return connection.execute("SELECT 1 FROM catalog_starter LIMIT 1").fetchone() is not None
