"""Taking in many CommonRoad files: read by all workers at once, stored in batches in the order of their names.

What is stored is known by its content, so that an import that was cut off goes on where it ended.
"""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import anyio
from anyio.streams.memory import MemoryObjectReceiveStream, MemoryObjectSendStream

from plannerforge.schemas.errors import PlannerForgeError, WorkerFailure, WorkerTimeout
from plannerforge.schemas.importing import ImportedItem
from plannerforge.schemas.scenarios import ReadFactsRequest, ScenarioFacts
from plannerforge.tools.call import ToolCall
from plannerforge.tools.scenario_intake import Failure, ReadFile, ScenarioIntake, import_recipe
from plannerforge.tools.storing import READ_TIMEOUT_S, content_digest

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
        if call.workspace.find_by_recipe("scenario", import_recipe(content)) is not None:
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
    return await call.services.workers.run(
        "plannerforge.engine.scenarios.facts:read_facts",
        ReadFactsRequest(path=path, file_bytes=call.limits.file_bytes),
        ScenarioFacts,
        timeout_s=READ_TIMEOUT_S,
    )


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
