"""Store scenarios in workspace and catalogue, and decide whether imported files are new, known or versions.

A file is identified by the SHA-256 of its content, so an interrupted import continues where it stopped. A file with a
known id and different content is a *version*. It is stored under its own id, which is also written into the stored
copy, and the catalogue lists it instead of the earlier file. Several servers may import into one workspace at the same
time.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import anyio

from ...schemas.artifacts import ImportedItem
from ...schemas.errors import NotPossible, PlannerForgeError, error_to_report
from ...schemas.scenarios import Origin, ScenarioFacts, ScenarioRecord
from ...schemas.text import one_line, shown_name
from ..commonroad import derived_benchmark_id, follows_naming
from ..workspace import Artifact, NewArtifact, Recipe, Workspace, content_digest, stage
from .tables import family, list_again, listed_version, refresh
from .words import summary

ID_TAKEN = "id_taken"
"""Reason of the refusal of a scenario with an id that another one has."""


def put_scenario(
    workspace: Workspace,
    facts: ScenarioFacts,
    *,
    xml: Path,
    net: Path | None,
    recipe: Recipe,
    origin: Origin,
    extra_files: Mapping[str, Path] | None = None,
) -> Artifact:
    """Store a scenario with known facts, and enter it in the catalogue.

    Args:
        net: the SUMO network that the file came from, if there is one.
        extra_files: further files of the artifact by name, such as the report on its generation.

    Raises:
        NotPossible: another scenario already has this id, or this recipe created a different file earlier.
    """
    content = content_digest(xml)
    stored = workspace.find("scenario", facts.scenario_id)
    if stored is not None and stored.read(ScenarioRecord).content != content:
        raise _duplicate_error(stored, recipe)
    files = {"scenario.xml": xml} | ({"scenario.net.xml": net} if net is not None else {}) | dict(extra_files or {})
    record = ScenarioRecord(facts=facts, origin=origin, content=content)
    artifact = workspace.put("scenario", facts.scenario_id, recipe=recipe, record=record, files=files)
    refresh(workspace.database)
    return artifact


def _duplicate_error(stored: Artifact, recipe: Recipe) -> NotPossible:
    """Return the refusal; recipes state program versions, but builds of one version, or machines, may differ."""
    if stored.recipe.digest != recipe.digest:
        return _other_content(stored.artifact_id)
    return NotPossible(
        f"{stored.artifact_id} was stored by the same call with other content, by another build of this version or on "
        "another machine",
        valid=[stored.artifact_id],
        next_step=f"use the stored one, or generate one with a seed other than {recipe.seed}",
    )


def _other_content(scenario_id: str) -> NotPossible:
    return NotPossible(
        f"another scenario with other content already has the id {scenario_id}",
        next_step="give the file another benchmarkID",
        reason=ID_TAKEN,
    )


@dataclass(frozen=True)
class ReadFile:
    """A file, its SHA-256, and its facts; None if a file with this content was imported before."""

    path: Path
    content: str
    facts: ScenarioFacts | None

    @property
    def known_facts(self) -> ScenarioFacts:
        """The facts.

        Raises:
            NotPossible: the facts were not read, because the content was already known.
        """
        if self.facts is None:
            raise NotPossible(f"{shown_name(self.path.name)} was imported before, but is no longer stored")
        return self.facts


@dataclass(frozen=True)
class _New:
    """What to store for a file; ``version_of`` is the existing scenario that has the file's id."""

    file: ReadFile
    artifact: NewArtifact
    version_of: str | None = None


_Decision = ImportedItem | PlannerForgeError | _New


class ScenarioIntake:
    """Decides on the files of one import, in the given order, and stores them."""

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self._first_with_content: dict[str, Path] = {}
        self._first_with_id: dict[str, Path] = {}

    def knows(self, content: str) -> bool:
        """Return whether a file with this SHA-256 was imported before."""
        return self._workspace.find_by_recipe("scenario", _import_recipe(content)) is not None

    async def store(self, batch: Sequence[ReadFile | PlannerForgeError]) -> list[ImportedItem | PlannerForgeError]:
        """Store the new files in one transaction, and return the result for each file."""
        with self._workspace.scratch() as folder:
            decided = await self._put([self._first_decision(file, folder) for file in batch], folder)
            if any(isinstance(decision, _New) for decision in decided):  # another server took the same id first
                again = [self._decide(new.file, folder) if isinstance(new, _New) else new for new in decided]
                decided = await self._put(again, folder)
        return [
            NotPossible(f"{shown_name(new.file.path.name)} lost its id to another import")
            if isinstance(new, _New)
            else new
            for new in decided
        ]

    def _first_decision(self, file: ReadFile | PlannerForgeError, folder: Path) -> _Decision:
        if not isinstance(file, ReadFile):
            return file
        try:
            self._duplicate_errors(file)
            return self._decide(file, folder)
        except Exception as raised:  # noqa: BLE001 - the boundary of a file: the error becomes this file's refusal
            return error_to_report(raised, f"import of scenario {file.path.name}")

    def _duplicate_errors(self, file: ReadFile) -> None:
        first = self._first_with_content.setdefault(file.content, file.path)
        if first != file.path:
            raise NotPossible(f"duplicate: same content as {shown_name(first.name)}")
        known = self._known(file)
        declared = self._versions(known.artifact_id)[0] if known else file.known_facts.scenario_id
        first = self._first_with_id.setdefault(declared, file.path)
        if first != file.path:
            raise NotPossible(
                f"duplicate: {shown_name(first.name)} also has the id {declared}",
                next_step="give one of them another benchmarkID",
            )

    def _decide(self, file: ReadFile, folder: Path) -> _Decision:
        known = self._known(file)
        if known is not None:
            return self._known_item(file, known)
        facts, net = file.known_facts, exported_net(file.path)
        net_file = {"scenario.net.xml": net} if net is not None else {}
        if self._workspace.find("scenario", facts.scenario_id) is None:
            record = ScenarioRecord(facts=facts, origin="imported", content=file.content)
            return _New(file, _artifact(file, record, {"scenario.xml": file.path} | net_file))
        renamed = folder / f"{file.content}.xml"
        record = _renamed(file, renamed).model_copy(update={"supersedes": self._versions(facts.scenario_id)[-1]})
        return _New(file, _artifact(file, record, {"scenario.xml": renamed} | net_file), facts.scenario_id)

    def _known(self, file: ReadFile) -> Artifact | None:
        """Return the stored scenario with this content, imported or not."""
        imported = self._workspace.find_by_recipe("scenario", _import_recipe(file.content))
        if imported is None and file.facts is not None:
            same_id = self._workspace.find("scenario", file.facts.scenario_id)
            if same_id is not None and same_id.read(ScenarioRecord).content == file.content:
                return same_id
        return imported

    def _known_item(self, file: ReadFile, known: Artifact) -> ImportedItem:
        listed = listed_version(self._workspace.database.connection(), known.artifact_id)
        if listed == known.artifact_id:
            return _item(file, known, reused=True)
        list_again(self._workspace.database, known.artifact_id)
        return _item(file, known, reused=True, note=f"listed again instead of {listed}")

    def _versions(self, scenario_id: str) -> tuple[str, ...]:
        return family(self._workspace.database.connection(), scenario_id)

    async def _put(self, decided: Sequence[_Decision], folder: Path) -> list[_Decision]:
        """Store new files, and return all decisions; a decision that stays new lost its id to another server."""
        new = [decision for decision in decided if isinstance(decision, _New)]
        failures: dict[str, PlannerForgeError] = {}
        if new:
            staged, failures = await anyio.to_thread.run_sync(_staged, new, folder)
            self._workspace.put_staged(staged)
        refresh(self._workspace.database)
        return [
            self._stored(decision, failures.get(decision.file.content)) if isinstance(decision, _New) else decision
            for decision in decided
        ]

    def _stored(self, new: _New, failure: PlannerForgeError | None) -> _Decision:
        if failure is not None:
            return failure
        artifact = self._workspace.get(new.artifact.artifact_id, "scenario")
        if artifact.recipe.digest != new.artifact.recipe.digest:
            return new
        return _item(new.file, artifact, note=f"new version of {new.version_of}" if new.version_of else "")


def _import_recipe(content: str) -> Recipe:
    """Return the recipe of an imported scenario file by the SHA-256 of its content."""
    return Recipe(tool="import_files", arguments={"content": content})


def _staged(all_new: Sequence[_New], folder: Path) -> tuple[list[NewArtifact], dict[str, PlannerForgeError]]:
    """Copy the files, and return the errors, by content, of files that cannot be copied."""
    staged: list[NewArtifact] = []
    failures: dict[str, PlannerForgeError] = {}
    for new in all_new:
        try:
            staged.append(stage(new.artifact, folder / new.artifact.artifact_id))
        except PlannerForgeError as error:
            failures[new.file.content] = error
    return staged, failures


def _renamed(file: ReadFile, target: Path) -> ScenarioRecord:
    """Write a copy of a changed file under a new id, and return its record; the file itself is unchanged.

    Raises:
        NotPossible: the text of the file does not contain the id.
    """
    facts = file.known_facts
    new_id = derived_benchmark_id(facts.scenario_id, file.content[:12])
    original = file.path.read_bytes()
    copy = original
    for mark in (b'"', b"'"):
        old, new = (b"benchmarkID=" + mark + key.encode() + mark for key in (facts.scenario_id, new_id))
        copy = copy.replace(old, new, 1)
    if copy == original:
        raise _other_content(facts.scenario_id)
    target.write_bytes(copy)
    return ScenarioRecord(
        facts=facts.model_copy(update={"scenario_id": new_id}),
        origin="imported",
        content=hashlib.sha256(copy).hexdigest(),
    )


def _artifact(file: ReadFile, record: ScenarioRecord, files: dict[str, Path]) -> NewArtifact:
    return NewArtifact("scenario", record.facts.scenario_id, _import_recipe(file.content), record, files)


def _item(file: ReadFile, artifact: Artifact, *, reused: bool = False, note: str = "") -> ImportedItem:
    facts = artifact.read(ScenarioRecord).facts
    text = summary(facts)
    if facts.faults:
        text = f"{text}; {'; '.join(facts.faults)} (describe_scenario detail=checks)"
    if not follows_naming(artifact.artifact_id):
        text = f"{text}; its id does not follow CommonRoad's naming (COUNTRY_Place-1_1_T-1) and is kept unchanged"
    return ImportedItem(
        file=one_line(file.path.name),
        kind="scenario",
        artifact_id=artifact.artifact_id,
        summary=f"{note}: {text}" if note else text,
        reused=reused,
    )


def exported_net(path: Path) -> Path | None:
    """Return the SUMO network exported with a scenario file, if it is next to the file; it is read with the facts."""
    net = path.with_suffix(".net.xml")
    return net if net.is_file() and not net.is_symlink() else None
