"""Taking in many CommonRoad files: read by all workers at once, stored one after the other in the order of their names.

What is stored is known by its content, so that an import that was cut off goes on where it ended.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import anyio

from plannerforge.engine.catalog.describe_text import summary
from plannerforge.engine.catalog.versions import newest_version
from plannerforge.engine.edits.derived_id import derived_benchmark_id
from plannerforge.engine.workspace.artifacts import Artifact
from plannerforge.engine.workspace.recipe import Recipe
from plannerforge.schemas.errors import NotPossible, PlannerForgeError
from plannerforge.schemas.importing import ImportedItem
from plannerforge.schemas.scenarios import ReadFactsRequest, ScenarioFacts, ScenarioRecord
from plannerforge.tools.call import ToolCall
from plannerforge.tools.storing import READ_TIMEOUT_S, content_digest, put_scenario

Failure = PlannerForgeError | OSError
OnDone = Callable[[Path, ImportedItem | Failure], None]


@dataclass
class _Taken:
    """What this call took in: file names by content and by scenario id."""

    contents: dict[str, str] = field(default_factory=dict)
    ids: dict[str, str] = field(default_factory=dict)


async def import_scenarios(call: ToolCall, paths: Sequence[Path], on_done: OnDone) -> None:
    """Import the files; ``on_done`` hears of each, in their order, what it became or why it was refused."""
    read: dict[int, _Read | Failure] = {}
    waiting, taken = iter(enumerate(paths)), _Taken()
    stored = 0

    def store_what_is_next() -> None:
        nonlocal stored
        while stored in read:
            path, found = paths[stored], read.pop(stored)
            stored += 1
            try:
                on_done(path, found if isinstance(found, Failure) else _store(call, path, found, taken))
            except (PlannerForgeError, OSError) as error:
                on_done(path, error)

    async def keep_a_worker_busy() -> None:
        for index, path in waiting:
            try:
                read[index] = await _read(call, path)
            except (PlannerForgeError, OSError) as error:
                read[index] = error
            store_what_is_next()

    async with anyio.create_task_group() as tasks:
        for _ in range(call.services.workers.capacity + 1):
            tasks.start_soon(keep_a_worker_busy)


@dataclass(frozen=True)
class _Read:
    """A file's content digest, and its facts where the content is not stored yet."""

    content: str
    facts: ScenarioFacts | None


async def _read(call: ToolCall, path: Path) -> _Read:
    checked = call.allowed_path(str(path))
    content = await anyio.to_thread.run_sync(content_digest, checked)
    if call.workspace.find_by_recipe("scenario", _recipe(content)) is not None:
        return _Read(content, None)
    facts = await call.services.workers.run(
        "plannerforge.engine.scenarios.facts:read_facts",
        ReadFactsRequest(path=checked),
        ScenarioFacts,
        timeout_s=READ_TIMEOUT_S,
    )
    return _Read(content, facts)


def _store(call: ToolCall, path: Path, read: _Read, taken: _Taken) -> ImportedItem:
    if read.content in taken.contents:
        raise NotPossible(f"a duplicate: the same content as {taken.contents[read.content]}")
    taken.contents[read.content] = path.name
    before = call.workspace.find_by_recipe("scenario", _recipe(read.content))
    if before is not None or read.facts is None:
        artifact = before or call.workspace.get(path.stem, "scenario")
        return _item(path, artifact, reused=True)
    if read.facts.scenario_id in taken.ids:
        raise NotPossible(
            f"a duplicate: {taken.ids[read.facts.scenario_id]} has the id {read.facts.scenario_id} too",
            next_step="give one of them another benchmarkID",
        )
    taken.ids[read.facts.scenario_id] = path.name
    known = call.workspace.find("scenario", read.facts.scenario_id)
    if known is None:
        recipe, net = _recipe(read.content), _net_beside(path)
        artifact = put_scenario(call, read.facts, xml=path, net=net, recipe=recipe, origin="imported")
        return _item(path, artifact)
    if known.read(ScenarioRecord).content == read.content:
        return _item(path, known, reused=True)
    return _item(path, _store_version(call, path, read.content, read.facts), note=f"new version of {known.artifact_id}")


def _store_version(call: ToolCall, path: Path, content: str, facts: ScenarioFacts) -> Artifact:
    """Store a changed file under an id of its own, which is written into the copy; the file itself stays."""
    new_id = derived_benchmark_id(facts.scenario_id, content[:12])
    original = path.read_bytes()
    copy = original
    for mark in (b'"', b"'"):
        old, new = (b"benchmarkID=" + mark + key.encode() + mark for key in (facts.scenario_id, new_id))
        copy = copy.replace(old, new, 1)
    if copy == original:
        raise NotPossible(
            f"another scenario with other content has the id {facts.scenario_id} already",
            next_step="give the file another benchmarkID",
        )
    with call.workspace.scratch() as folder:
        renamed = folder / path.name
        renamed.write_bytes(copy)
        return put_scenario(
            call,
            facts.model_copy(update={"scenario_id": new_id}),
            xml=renamed,
            net=_net_beside(path),
            recipe=_recipe(content),
            origin="imported",
            supersedes=newest_version(call.workspace.database.connection(), facts.scenario_id),
        )


def _item(path: Path, artifact: Artifact, *, reused: bool = False, note: str = "") -> ImportedItem:
    text = summary(artifact.read(ScenarioRecord).facts)
    return ImportedItem(
        file=path.name,
        kind="scenario",
        artifact_id=artifact.artifact_id,
        summary=f"{note}: {text}" if note else text,
        reused=reused,
    )


def _recipe(content: str) -> Recipe:
    return Recipe(tool="import_files", arguments={"content": content})


def _net_beside(path: Path) -> Path | None:
    """SUMO's network that was exported with the scenario, where it lies beside it."""
    net = path.with_suffix(".net.xml")
    return net if net.is_file() and not net.is_symlink() else None
