"""Storing a scenario: its facts are read, then files, recipe and facts go into the workspace and the catalogue."""

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import anyio
from anyio.streams.memory import MemoryObjectReceiveStream, MemoryObjectSendStream

from ..engine.catalog import family, list_again, listed_version, refresh, summary
from ..engine.commonroad import derived_benchmark_id
from ..engine.workspace import Artifact, NewArtifact, Recipe, Staged, Workspace, stage
from ..schemas.errors import NotPossible, PlannerForgeError, WorkerFailure, WorkerTimeout
from ..schemas.importing import ImportedItem
from ..schemas.scenarios import Origin, ReadFactsRequest, ScenarioFacts, ScenarioRecord
from .call import ToolCall
from .operations import READ_FACTS

# ---------- scenario_intake
# What becomes of CommonRoad files that were read: a new scenario, a known one, a new version, or a refusal.

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
            family(self._workspace.database.connection(), known.artifact_id)[0]
            if known
            else _facts_of(file).scenario_id
        )
        first = self._first_with_id.setdefault(declared, file.path)
        if first != file.path:
            raise NotPossible(
                f"a duplicate: {first.name} has the id {declared} too", next_step="give one of them another benchmarkID"
            )

    def _versions(self, scenario_id: str) -> tuple[str, ...]:
        return family(self._workspace.database.connection(), scenario_id)

    def _known(self, file: ReadFile) -> Artifact | None:
        """What is stored with this content, however it came in."""
        found = self._workspace.find_by_recipe("scenario", _import_recipe(file.content))
        if found is None and file.facts is not None:
            same_id = self._workspace.find("scenario", file.facts.scenario_id)
            if same_id is not None and same_id.read(ScenarioRecord).content == file.content:
                return same_id
        return found

    def _decide(self, file: ReadFile, folder: Path) -> Decision:
        known = self._known(file)
        if known is not None:
            return self._known_item(file, known)
        facts, net = _facts_of(file), _net_beside(file.path)
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


def _import_recipe(content: str) -> Recipe:
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
    facts = _facts_of(file)
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
    return NewArtifact("scenario", record.facts.scenario_id, _import_recipe(file.content), record, files)


def _facts_of(file: ReadFile) -> ScenarioFacts:
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


# ---------- storing
# Storing a scenario: its facts are read, then files, recipe and facts go into the workspace and the catalogue.


async def store_scenario(
    call: ToolCall,
    *,
    xml: Path,
    net: Path | None,
    recipe: Recipe,
    origin: Origin,
    beside: Mapping[str, Path] | None = None,
) -> Artifact:
    """Store a CommonRoad file, with the SUMO network that it came from where there is one.

    Args:
        beside: further files of the artifact by name, such as the report of how it was made.

    Raises:
        UnsafeInput: the file is broken or hostile.
        NotPossible: another scenario has this id already.
    """
    facts = await call.run(READ_FACTS, ReadFactsRequest(path=xml))
    return put_scenario(call, facts, xml=xml, net=net, recipe=recipe, origin=origin, beside=beside)


def put_scenario(
    call: ToolCall,
    facts: ScenarioFacts,
    *,
    xml: Path,
    net: Path | None,
    recipe: Recipe,
    origin: Origin,
    beside: Mapping[str, Path] | None = None,
) -> Artifact:
    """Store a scenario whose facts are known.

    Raises:
        NotPossible: another scenario has this id already, or this recipe made another file before.
    """
    content = content_digest(xml)
    found = call.workspace.find("scenario", facts.scenario_id)
    if found is not None and found.read(ScenarioRecord).content != content:
        raise _id_taken(found, recipe)
    files = {"scenario.xml": xml} | ({"scenario.net.xml": net} if net is not None else {}) | dict(beside or {})
    record = ScenarioRecord(facts=facts, origin=origin, content=content)
    artifact = call.workspace.put("scenario", facts.scenario_id, recipe=recipe, record=record, files=files)
    refresh(call.workspace.database)
    return artifact


def _id_taken(found: Artifact, recipe: Recipe) -> NotPossible:
    """A recipe holds the versions of programs: two builds of one version, or two machines, may make different files."""
    if found.recipe.digest != recipe.digest:
        return NotPossible(
            f"another scenario with other content has the id {found.artifact_id} already",
            next_step="give the file another benchmarkID",
        )
    return NotPossible(
        f"{found.artifact_id} was stored by the same call with other content: by another build of this version, or on "
        "another machine",
        valid=[found.artifact_id],
        next_step=f"use the stored one, or make a new one with another seed than {recipe.seed}",
    )


def content_digest(path: Path) -> str:
    """SHA-256 of a file, hexadecimal."""
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        while block := stream.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


# ---------- importing_scenarios
# Taking in many CommonRoad files: read by all workers at once, stored in batches in the order of their names.
#
# What is stored is known by its content, so that an import that was cut off goes on where it ended.

OnDone = Callable[[Path, ImportedItem | Failure], None]
Outcome = tuple[int, ReadFile | Failure]
GATHER_S = 0.2
"""So long the store waits for more files: a transaction for every file would keep the disk busier than the readers."""


async def import_scenarios(call: ToolCall, paths: Sequence[Path], on_done: OnDone) -> None:
    """Import the files; ``on_done`` hears of each, in their order, what it became or why it was refused."""
    send, receive = anyio.create_memory_object_stream[Outcome](len(paths))
    waiting = iter(enumerate(paths))
    async with anyio.create_task_group() as tasks, receive:
        async with send:
            for _ in range(call.services.workers.capacity + 1):
                tasks.start_soon(_read_files, call, waiting, send.clone())
        await _store_in_order(ScenarioIntake(call.workspace), paths, receive, on_done)


async def _read_files(
    call: ToolCall, waiting: Iterator[tuple[int, Path]], send: MemoryObjectSendStream[Outcome]
) -> None:
    async with send:
        for index, path in waiting:
            await send.send((index, await _read(call, path)))


async def _read(call: ToolCall, path: Path) -> ReadFile | Failure:
    try:
        checked = call.allowed_path(str(path))
        call.limits.check_size(checked)
        content = await anyio.to_thread.run_sync(content_digest, checked)
        if call.workspace.find_by_recipe("scenario", _import_recipe(content)) is not None:
            return ReadFile(path, content, None)
        facts = await _facts(call, checked)
    except (PlannerForgeError, OSError) as error:
        return error
    return ReadFile(path, content, facts)


async def _facts(call: ToolCall, path: Path) -> ScenarioFacts:
    """The facts of a file; a worker that died is no fault of the file's, so a second one tries again."""
    try:
        return await _read_once(call, path)
    except WorkerTimeout:
        raise
    except WorkerFailure:
        return await _read_once(call, path)


async def _read_once(call: ToolCall, path: Path) -> ScenarioFacts:
    request = ReadFactsRequest(path=path, file_bytes=call.limits.file_bytes)
    return await call.services.workers.run(READ_FACTS, request)


async def _store_in_order(
    intake: ScenarioIntake, paths: Sequence[Path], receive: MemoryObjectReceiveStream[Outcome], on_done: OnDone
) -> None:
    found: dict[int, ReadFile | Failure] = {}
    read = stored = 0
    async for index, outcome in receive:
        found[index], read = outcome, read + 1
        if read < len(paths):
            await anyio.sleep(GATHER_S)
        for index, outcome in _at_hand(receive):
            found[index], read = outcome, read + 1
        batch: list[ReadFile | Failure] = []
        while stored + len(batch) in found:
            batch.append(found.pop(stored + len(batch)))
        for path, item in zip(paths[stored:], await intake.store(batch), strict=False):
            on_done(path, item)
        stored += len(batch)


def _at_hand(receive: MemoryObjectReceiveStream[Outcome]) -> Iterator[Outcome]:
    while receive.statistics().current_buffer_used:
        yield receive.receive_nowait()
