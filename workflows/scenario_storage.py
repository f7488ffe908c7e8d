"""Store scenarios in the workspace: workers read their facts, and the catalogue stores them.

A tool's new scenario is stored alone. All workers read the user's files in parallel, and the results are stored in
batches, in the order of file names.
"""

import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import anyio
from anyio.streams.memory import MemoryObjectReceiveStream, MemoryObjectSendStream

from ..engine.catalog import ReadFile, ScenarioIntake, exported_net, put_scenario
from ..engine.maps import unpacked
from ..engine.scenarios import OPENLABEL_ENDING, read_openlabel, with_tags
from ..engine.workspace import Artifact, Recipe, content_digest
from ..schemas.artifacts import ImportedItem
from ..schemas.errors import NotPossible, PlannerForgeError, WorkerFailure, WorkerTimeout, error_to_report
from ..schemas.scenarios import Origin, ReadFactsRequest, ScenarioFacts
from ..schemas.text import shown_name
from ..schemas.vocabulary import CIRCUMSTANCES
from .context import WorkflowContext
from .operations import READ_FACTS

_GATHER_S = 0.2
"""How long to wait for more files (chosen): with a transaction each, the disk would be slower than the readers."""
_OnDone = Callable[[Path, ImportedItem | PlannerForgeError], None]
_Outcome = tuple[int, ReadFile | PlannerForgeError]


async def store_scenario(
    context: WorkflowContext,
    *,
    xml: Path,
    net: Path | None,
    recipe: Recipe,
    origin: Origin,
    extra_files: Mapping[str, Path] | None = None,
    circumstances: Iterable[str] = (),
) -> Artifact:
    """Store a CommonRoad file, with the SUMO network that it came from if there is one.

    Args:
        extra_files: further files of the artifact by name, such as the report of its generation.
        circumstances: weather and time of day that the file does not state.

    Raises:
        UnsafeInput: the file is broken or hostile.
        NotPossible: another scenario already has this id.
    """
    facts = await context.run(READ_FACTS, ReadFactsRequest(path=xml))
    present = {*facts.circumstances, *circumstances}
    facts = facts.model_copy(update={"circumstances": tuple(word for word in CIRCUMSTANCES if word in present)})
    return put_scenario(
        context.workspace, facts, xml=xml, net=net, recipe=recipe, origin=origin, extra_files=extra_files
    )


async def import_scenarios(context: WorkflowContext, paths: Sequence[Path], on_done: _OnDone) -> None:
    """Import the files, and call ``on_done`` for each, in order, with the result or refusal.

    A compressed file is unpacked into a temporary folder, which is deleted when the scenario is stored.
    """
    intake = ScenarioIntake(context.workspace)
    send, receive = anyio.create_memory_object_stream[_Outcome](len(paths))
    waiting = iter(enumerate(paths))
    with context.workspace.scratch() as folder:
        async with anyio.create_task_group() as tasks, receive:
            async with send:
                for _ in range(context.services.workers.capacity + 1):
                    tasks.start_soon(_read_files, context, intake, waiting, folder, send.clone())
            await _store_in_order(intake, paths, receive, on_done, folder)


async def import_tags(context: WorkflowContext, path: Path) -> ImportedItem:
    """Import the scenario that an OpenLABEL file tags, with these tags.

    The scenario is the file next to it that it names, or else the stored scenario with this id. If that scenario lacks
    some of the tags, the result is a new version of it.

    Raises:
        InvalidRequest: the file is not OpenLABEL.
        UnknownName: there is no such scenario.
        NotPossible: the scenario's file has no place for tags.
    """
    read = await anyio.to_thread.run_sync(read_openlabel, path)
    source, net = _tagged(context, path, read.tagged_file)
    context.limits.check_size(source)
    facts = await _facts(context, source, net)
    new = [tag for tag in read.tags if tag not in facts.tags]
    with context.workspace.scratch() as folder:
        if new:
            copy = folder / "scenario.xml"
            copy.write_bytes(with_tags(await anyio.to_thread.run_sync(source.read_bytes), new))
            if net is not None:
                shutil.copyfile(net, copy.with_suffix(".net.xml"))
            source, facts = copy, await _facts(context, copy, net)
            if not {*new} <= {*facts.tags}:
                raise NotPossible(f"the tags cannot be added to {shown_name(read.tagged_file)}")
        content = await anyio.to_thread.run_sync(content_digest, source)
        (outcome,) = await ScenarioIntake(context.workspace).store([ReadFile(source, content, facts)])
    if not isinstance(outcome, ImportedItem):
        raise outcome
    added = f"; tags added: {', '.join(new)}" if new else "; it had these tags already"
    unread = f"; no CommonRoad tag for {', '.join(read.unread[:_MOST_UNREAD])}" if read.unread else ""
    more = f" and {len(read.unread) - _MOST_UNREAD} more" if len(read.unread) > _MOST_UNREAD else ""
    return outcome.model_copy(update={"file": str(path), "summary": f"{outcome.summary}{added}{unread}{more}"})


_MOST_UNREAD = 8
"""How many unread tags the answer lists (chosen)."""


def _tagged(context: WorkflowContext, path: Path, name: str) -> tuple[Path, Path | None]:
    """Return the scenario's file with the SUMO network next to it, if there is one."""
    file = path.parent / name if name and "://" not in name else path.parent
    if file.suffix.lower() == ".xml" and file.is_file():
        checked = context.allowed_path(str(file))
        net = exported_net(checked)
        return checked, context.allowed_path(str(net)) if net else None
    scenario_id = Path(name).name.removesuffix(".xml") or path.name.removesuffix(OPENLABEL_ENDING)
    artifact = context.workspace.get(scenario_id, "scenario")
    stored = context.workspace.file("scenario", artifact.artifact_id, "scenario.xml")
    return stored, exported_net(stored)


async def _read_files(
    context: WorkflowContext,
    intake: ScenarioIntake,
    waiting: Iterator[tuple[int, Path]],
    folder: Path,
    send: MemoryObjectSendStream[_Outcome],
) -> None:
    async with send:
        for index, path in waiting:
            await send.send((index, await _read(context, intake, path, folder / str(index))))


async def _read(
    context: WorkflowContext, intake: ScenarioIntake, path: Path, folder: Path
) -> ReadFile | PlannerForgeError:
    """Read a file, after unpacking it into its own folder if it is compressed."""
    try:
        checked = context.allowed_path(str(path))
        context.limits.check_size(checked)
        folder.mkdir()
        plain = await anyio.to_thread.run_sync(unpacked, checked, folder, context.limits.file_bytes)
        path = path if plain == checked else plain
        content = await anyio.to_thread.run_sync(content_digest, plain)
        if intake.knows(content):
            return ReadFile(path, content, None)
        net = exported_net(path)
        return ReadFile(path, content, await _facts(context, plain, context.allowed_path(str(net)) if net else None))
    except Exception as raised:  # noqa: BLE001 - the boundary of a file: it becomes the refusal of this one
        return error_to_report(raised, f"import of scenario {path.name}")


async def _facts(context: WorkflowContext, path: Path, net: Path | None) -> ScenarioFacts:
    """Return the facts of a file. If a worker dies, a second one tries again, because the file may not be the cause."""
    request = ReadFactsRequest(path=path, net=net, file_bytes=context.limits.file_bytes, keep=False, checks=True)
    try:
        return await context.services.workers.run(READ_FACTS, request)
    except WorkerTimeout:
        raise
    except WorkerFailure:
        return await context.services.workers.run(READ_FACTS, request)


async def _store_in_order(
    intake: ScenarioIntake,
    paths: Sequence[Path],
    receive: MemoryObjectReceiveStream[_Outcome],
    on_done: _OnDone,
    folder: Path,
) -> None:
    waiting: dict[int, ReadFile | PlannerForgeError] = {}
    read = stored = 0
    async for index, outcome in receive:
        waiting[index], read = outcome, read + 1
        if read < len(paths):
            await anyio.sleep(_GATHER_S)
        for index, outcome in _received(receive):
            waiting[index], read = outcome, read + 1
        batch: list[ReadFile | PlannerForgeError] = []
        while stored + len(batch) in waiting:
            batch.append(waiting.pop(stored + len(batch)))
        for path, item in zip(paths[stored:], await intake.store(batch), strict=False):
            on_done(path, item)
        for index in range(stored, stored + len(batch)):
            shutil.rmtree(folder / str(index), ignore_errors=True)
        stored += len(batch)


def _received(receive: MemoryObjectReceiveStream[_Outcome]) -> Iterator[_Outcome]:
    """Yield the outcomes that have arrived, without waiting for more."""
    while receive.statistics().current_buffer_used:
        yield receive.receive_nowait()
