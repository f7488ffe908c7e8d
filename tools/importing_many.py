"""Taking in a list of files of any kind: what went in, what was refused, and how far it is."""

from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import anyio

from plannerforge.engine.execution.jobs import JobState
from plannerforge.schemas.errors import PlannerForgeError
from plannerforge.schemas.importing import ImportedItem, ImportFilesArguments, ImportFilesResult, RefusedItem
from plannerforge.tools.call import ToolCall
from plannerforge.tools.importing_kinds import import_configuration, import_map
from plannerforge.tools.importing_scenarios import import_scenarios

ImportKind = Literal["scenario", "map", "config"]
Failure = PlannerForgeError | OSError
Tell = Callable[[float, str], Awaitable[None]]

SHOWN = 20
TELL_EVERY_S = 0.5


@dataclass
class Tally:
    """What has become of the files so far."""

    total: int
    items: list[ImportedItem] = field(default_factory=list)
    refusals: list[RefusedItem] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)

    def note(self, path: Path, outcome: ImportedItem | Failure) -> None:
        """Count a file that is done with."""
        if isinstance(outcome, ImportedItem):
            self.items.append(outcome)
        else:
            self.failures.append(outcome)
            self.refusals.append(RefusedItem(file=path.name, reason=_reason(outcome)))

    @property
    def done(self) -> int:
        """Files that are done with."""
        return len(self.items) + len(self.refusals)

    def result(self, job_id: str = "", state: JobState = "done") -> ImportFilesResult:
        """The answer for what is done."""
        reused = sum(1 for item in self.items if item.reused)
        return ImportFilesResult(
            added=len(self.items) - reused,
            reused=reused,
            refused=len(self.refusals),
            items=tuple(self.items[:SHOWN]),
            refusals=tuple(self.refusals[:SHOWN]),
            job_id=job_id,
            state=state,
        )


async def take_in(
    call: ToolCall, files: Sequence[tuple[Path, ImportKind]], arguments: ImportFilesArguments, tally: Tally, tell: Tell
) -> None:
    """Import the files; ``tell`` hears every half second how far it is."""
    async with anyio.create_task_group() as tasks:
        tasks.start_soon(_keep_telling, tally, tell)
        await import_scenarios(call, [path for path, kind in files if kind == "scenario"], tally.note)
        for path, kind in files:
            if kind != "scenario":
                await _import_other(call, path, kind, arguments, tally)
        tasks.cancel_scope.cancel()


async def _keep_telling(tally: Tally, tell: Tell) -> None:
    while True:
        await tell(tally.done / tally.total, f"{tally.done} of {tally.total} files")
        await anyio.sleep(TELL_EVERY_S)


async def _import_other(
    call: ToolCall, path: Path, kind: ImportKind, arguments: ImportFilesArguments, tally: Tally
) -> None:
    try:
        checked = call.allowed_path(str(path))
        call.limits.check_size(checked)
        if kind == "map":
            tally.note(path, await import_map(call, checked, arguments.name, arguments.country))
        else:
            tally.note(path, await import_configuration(call, checked, arguments.name))
    except (PlannerForgeError, OSError) as error:
        tally.note(path, error)


def _reason(error: Failure) -> str:
    return error.text if isinstance(error, PlannerForgeError) else str(error.strerror or error)
