"""What becomes of CommonRoad files that were read: a new scenario, a known one, a new version, or a refusal."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import anyio

from plannerforge.engine.catalog.describe_text import summary
from plannerforge.engine.catalog.refresh import list_again, refresh
from plannerforge.engine.catalog.versions import family, listed_version
from plannerforge.engine.edits.derived_id import derived_benchmark_id
from plannerforge.engine.workspace.artifacts import Artifact, Workspace
from plannerforge.engine.workspace.recipe import Recipe
from plannerforge.engine.workspace.staging import NewArtifact, Staged, stage
from plannerforge.schemas.errors import NotPossible, PlannerForgeError
from plannerforge.schemas.importing import ImportedItem
from plannerforge.schemas.scenarios import ScenarioFacts, ScenarioRecord

Failure = PlannerForgeError | OSError


@dataclass(frozen=True)
class ReadFile:
    """A file's SHA-256, and its facts where no file with this content was imported before."""

    path: Path
    content: str
    facts: ScenarioFacts | None


@dataclass(frozen=True)
class _New:
    """What is to be stored for a file; ``version_of`` is the scenario whose id the file has."""

    file: ReadFile
    artifact: NewArtifact
    version_of: str | None = None


Decision = ImportedItem | Failure | _New


class ScenarioIntake:
    """Decides on the files of one import, in their order, and stores them."""

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self._first_with_content: dict[str, Path] = {}
        self._first_with_id: dict[str, Path] = {}

    async def store(self, batch: Sequence[ReadFile | Failure]) -> list[ImportedItem | Failure]:
        """Store what is new among these files in one transaction; gives what became of each."""
        with self._workspace.scratch() as folder:
            decided = await self._put([self._first_decision(file, folder) for file in batch], folder)
            if any(isinstance(one, _New) for one in decided):  # another server was faster with the same id
                decided = [self._decide(one.file, folder) if isinstance(one, _New) else one for one in decided]
                decided = await self._put(decided, folder)
        return [NotPossible(f"{one.file.path.name} lost its id") if isinstance(one, _New) else one for one in decided]

    def _first_decision(self, file: ReadFile | Failure, folder: Path) -> Decision:
        if not isinstance(file, ReadFile):
            return file
        try:
            self._refuse_duplicates(file)
            return self._decide(file, folder)
        except (PlannerForgeError, OSError) as error:
            return error

    def _refuse_duplicates(self, file: ReadFile) -> None:
        first = self._first_with_content.setdefault(file.content, file.path)
        if first != file.path:
            raise NotPossible(f"a duplicate: the same content as {first.name}")
        known = self._known(file)
        declared = (
            family(self._workspace.database.connection(), known.artifact_id)[0] if known else _facts(file).scenario_id
        )
        first = self._first_with_id.setdefault(declared, file.path)
        if first != file.path:
            raise NotPossible(
                f"a duplicate: {first.name} has the id {declared} too",
                next_step="give one of them another benchmarkID",
            )

    def _versions(self, scenario_id: str) -> tuple[str, ...]:
        return family(self._workspace.database.connection(), scenario_id)

    def _known(self, file: ReadFile) -> Artifact | None:
        """What is stored with this content, however it came in."""
        found = self._workspace.find_by_recipe("scenario", import_recipe(file.content))
        if found is None and file.facts is not None:
            same_id = self._workspace.find("scenario", file.facts.scenario_id)
            if same_id is not None and same_id.read(ScenarioRecord).content == file.content:
                return same_id
        return found

    def _decide(self, file: ReadFile, folder: Path) -> Decision:
        known = self._known(file)
        if known is not None:
            return self._known_item(file, known)
        facts, net = _facts(file), _net_beside(file.path)
        beside = {"scenario.net.xml": net} if net is not None else {}
        earlier = self._workspace.find("scenario", facts.scenario_id)
        if earlier is None:
            record = ScenarioRecord(facts=facts, origin="imported", content=file.content)
            return _New(file, _artifact(file, record, {"scenario.xml": file.path} | beside))
        renamed = folder / f"{file.content}.xml"
        record = _renamed(file, renamed).model_copy(update={"supersedes": self._versions(facts.scenario_id)[-1]})
        return _New(file, _artifact(file, record, {"scenario.xml": renamed} | beside), facts.scenario_id)

    def _known_item(self, file: ReadFile, known: Artifact) -> ImportedItem:
        listed = listed_version(self._workspace.database.connection(), known.artifact_id)
        if listed == known.artifact_id:
            return _item(file, known, reused=True)
        list_again(self._workspace.database, known.artifact_id)
        return _item(file, known, reused=True, note=f"listed again in place of {listed}")

    async def _put(self, decided: Sequence[Decision], folder: Path) -> list[Decision]:
        """Store what is new; what stays new has lost its id to another server."""
        new = [one for one in decided if isinstance(one, _New)]
        staged: list[Staged] = []
        failures: dict[str, PlannerForgeError] = {}
        if new:
            staged, failures = await anyio.to_thread.run_sync(_staged, new, folder)
            self._workspace.put_staged(staged)
        refresh(self._workspace.database)
        return [self._stored(one, failures.get(one.file.content)) if isinstance(one, _New) else one for one in decided]

    def _stored(self, new: _New, failure: PlannerForgeError | None) -> Decision:
        if failure is not None:
            return failure
        artifact = self._workspace.get(new.artifact.artifact_id, "scenario")
        if artifact.recipe.digest != new.artifact.recipe.digest:
            return new
        return _item(new.file, artifact, note=f"new version of {new.version_of}" if new.version_of else "")


def import_recipe(content: str) -> Recipe:
    """The recipe of an imported scenario file by the SHA-256 of its content."""
    return Recipe(tool="import_files", arguments={"content": content})


def _staged(new: Sequence[_New], folder: Path) -> tuple[list[Staged], dict[str, PlannerForgeError]]:
    """Copy the files; those that cannot be copied are given by content with the reason."""
    staged: list[Staged] = []
    failures: dict[str, PlannerForgeError] = {}
    for one in new:
        place = folder / one.artifact.artifact_id
        try:
            place.mkdir()
            staged += stage([one.artifact], place)
        except PlannerForgeError as error:
            failures[one.file.content] = error
    return staged, failures


def _renamed(file: ReadFile, target: Path) -> ScenarioRecord:
    """Write a copy of a changed file under an id of its own, which stands in the copy; the file itself stays.

    Raises:
        NotPossible: the id does not stand in the file as it was read.
    """
    facts = _facts(file)
    new_id = derived_benchmark_id(facts.scenario_id, file.content[:12])
    original = file.path.read_bytes()
    copy = original
    for mark in (b'"', b"'"):
        old, new = (b"benchmarkID=" + mark + key.encode() + mark for key in (facts.scenario_id, new_id))
        copy = copy.replace(old, new, 1)
    if copy == original:
        raise NotPossible(
            f"another scenario with other content has the id {facts.scenario_id} already",
            next_step="give the file another benchmarkID",
        )
    target.write_bytes(copy)
    return ScenarioRecord(
        facts=facts.model_copy(update={"scenario_id": new_id}),
        origin="imported",
        content=hashlib.sha256(copy).hexdigest(),
    )


def _artifact(file: ReadFile, record: ScenarioRecord, files: dict[str, Path]) -> NewArtifact:
    return NewArtifact("scenario", record.facts.scenario_id, import_recipe(file.content), record, files)


def _facts(file: ReadFile) -> ScenarioFacts:
    if file.facts is None:
        raise NotPossible(f"{file.path.name} was imported before, and is not there any more")
    return file.facts


def _item(file: ReadFile, artifact: Artifact, *, reused: bool = False, note: str = "") -> ImportedItem:
    text = summary(artifact.read(ScenarioRecord).facts)
    return ImportedItem(
        file=file.path.name,
        kind="scenario",
        artifact_id=artifact.artifact_id,
        summary=f"{note}: {text}" if note else text,
        reused=reused,
    )


def _net_beside(path: Path) -> Path | None:
    """SUMO's network that was exported with the scenario, where it lies beside it."""
    net = path.with_suffix(".net.xml")
    return net if net.is_file() and not net.is_symlink() else None
