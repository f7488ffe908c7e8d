"""The results of the clients, and their table in ``docs/hosts.md``."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ...harness import Figures
from .roster import Host
from .story import ShownSummary

Transport = Literal["stdio", "http"]
MARK = "<!-- from here on written by python -m benchmarks.serve --only hosts --page docs/hosts.md -->"
_COLUMNS = (
    "client",
    "version",
    "name in the journal",
    "revision",
    "transport",
    "answers",
    "pictures",
    "links",
    "progress",
    "after two refusals",
)


@dataclass(frozen=True)
class StoryRun:
    """One client's run through the story over one transport.

    Args:
        transport: the transport.
        helped: whether the client had the roster's setting.
        faults: missing steps; empty if the story is complete.
        client: its name in the server's journal.
        revision: the agreed protocol revision; empty over HTTP, which has no relay.
        shown: the parts of answers that it passes on; None if it showed nothing.
        asks_progress: whether it requested progress notes, if known.
        progress_shown: number shown to its user; None if its driver found no place for them.
        goes_on: whether it carried out another call after the refusals; None if it did not reach them.
    """

    transport: Transport
    helped: bool
    faults: tuple[str, ...]
    client: str = ""
    revision: str = ""
    shown: ShownSummary | None = None
    asks_progress: bool = False
    progress_shown: int | None = None
    goes_on: bool | None = None

    @property
    def passed(self) -> bool:
        """True if the story is complete."""
        return not self.faults


@dataclass(frozen=True)
class HostRecord:
    """All results of a client: its version and its runs in order, or why it is left out."""

    host: Host
    version: str = ""
    runs: tuple[StoryRun, ...] = ()
    left_out: str = ""

    def last_by(self, transport: Transport) -> StoryRun | None:
        """Return the decisive run for a transport: with help if it was needed."""
        return next((run for run in reversed(self.runs) if run.transport == transport), None)

    @property
    def passed(self) -> bool:
        """True if the story is complete over every transport tried, with or without help."""
        return not self.left_out and all(
            (run := self.last_by(transport)) is not None and run.passed for transport in self.host.transports
        )


def figures_of(records: Sequence[HostRecord]) -> Figures:
    """Return the keys: how many clients passed, how many were tried, and a sentence for each."""
    sentences = {f"host_{record.host.name}": _sentence(record) for record in records}
    return {"hosts_passed": sum(record.passed for record in records), "hosts_tried": len(records), **sentences}


def _sentence(record: HostRecord) -> str:
    if record.left_out:
        return f"left out: {record.left_out}"
    told = [f"{record.version}: {'passed' if record.passed else 'not passed'}"]
    for run in record.runs:
        how = f"{run.transport}{' with help' if run.helped else ''}"
        told.append(f"{how}: {run.faults[0] if run.faults else run.revision or 'whole'}")
    return "; ".join(told)


def table_of(records: Sequence[HostRecord]) -> str:
    """Return one row per client, and below the table the failures and the required help."""
    rows = [_row(_COLUMNS), _row(["---"] * len(_COLUMNS))]
    rows += [_row(_cells(record)) for record in records]
    passed = sum(record.passed for record in records)
    head = f"{passed} of {len(records)} clients pass."
    notes = [note for record in records for note in _notes(record)]
    return "\n".join([head, "", *rows, *([""] if notes else []), *notes, ""])


def write_page(page: Path, records: Sequence[HostRecord]) -> None:
    """Rewrite a page below its mark."""
    before = page.read_text(encoding="utf-8").partition(MARK)[0] if page.is_file() else ""
    page.write_text(f"{before}{MARK}\n\n{table_of(records)}", encoding="utf-8")


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _cells(record: HostRecord) -> list[str]:
    run = record.last_by("stdio")
    if record.left_out or run is None:
        return [record.host.title, record.version or "-", *["-"] * 7, "left out"]
    shown = run.shown
    passed_by = [
        f"{one}{'' if by.passed else ' (fails)'}" for one in record.host.transports if (by := record.last_by(one))
    ]
    return [
        record.host.title,
        record.version,
        f"`{run.client}`" if run.client else "-",
        run.revision or "-",
        ", ".join(passed_by),
        shown.answers if shown else "-",
        shown.pictures if shown else "-",
        ("shown" if shown.links else "not shown") if shown else "-",
        _progress(run),
        _after_refusals(record, run),
    ]


def _progress(run: StoryRun) -> str:
    if not run.asks_progress:
        return "not requested"
    if run.progress_shown is None:
        return "requested"
    return "shown" if run.progress_shown else "requested, not shown"


def _after_refusals(record: HostRecord, run: StoryRun) -> str:
    first = next(one for one in record.runs if one.transport == "stdio")
    words = ", with the reason" if run.shown and run.shown.refusals else ""
    if not run.goes_on:
        return f"ends{words}"
    return f"continues{words}{'; ends without the setting below' if first.goes_on is False else ''}"


def _notes(record: HostRecord) -> list[str]:
    title = record.host.title
    if record.left_out:
        return [f"- {title} is left out: {record.left_out}"]
    notes = []
    if any(run.helped for run in record.runs):
        plain = next(run for run in record.runs if not run.helped and run.faults)
        notes.append(f"- {title} finishes the story only with `{record.host.help}`. Without it: {plain.faults[0]}.")
    for transport in record.host.transports:
        run = record.last_by(transport)
        if run is not None and run.faults:
            notes.append(f"- {title} by {transport}: {'; '.join(run.faults)}.")
    if record.host.note:
        notes.append(f"- {title}: {record.host.note}")
    return notes
