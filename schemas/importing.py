"""What ``import_files`` takes and answers."""

from collections.abc import Mapping
from typing import ClassVar, Literal

from pydantic import Field

from .base import LONGEST_PATH, Answer, Arguments, Model, Result
from .jobs import JobState


class ImportFilesArguments(Arguments):
    """Take in CommonRoad files or folders, maps (.osm, .pbf, .net.xml) or cost YAML from an allowed root. Result: ids,
    what was refused and why; over 100 files: a job."""

    longest_texts: ClassVar[Mapping[str, int]] = {"path": LONGEST_PATH}

    path: str
    """A file or a folder, in a folder that the server may use."""
    kind: Literal["auto", "scenario", "map", "config"] = "auto"
    """What the files are; `auto` looks into them."""
    name: str | None = None
    """What a map or a configuration is to be called."""
    country: str | None = Field(None, description="of maps")


class ImportedItem(Model):
    """A file that went in; ``reused`` where the same content was there already."""

    file: str = Field(description="path of the file")
    kind: Literal["scenario", "map", "config"] = Field(description="what it was taken as")
    artifact_id: str = Field(description="id of what it became")
    summary: str = Field(description="what it holds, in a line")
    reused: bool = Field(False, description="whether the same content was there already")


class RefusedItem(Model):
    """A file that stayed out, and why."""

    file: str = Field(description="path of the file")
    reason: str = Field(description="why it stayed out")


class ImportFilesResult(Result):
    """What was added and what was refused; until now, where the job of a long import still runs."""

    added: int = Field(description="files that went in")
    reused: int = Field(description="files whose content was there already")
    refused: int = Field(description="files that stayed out")
    items: tuple[ImportedItem, ...] = Field(description="at most 20")
    refusals: tuple[RefusedItem, ...] = Field(description="at most 20")
    job_id: str = ""
    state: JobState = "done"
    note: str = Field("", description="why the job failed, or how far another server is with it")

    def answer(self) -> Answer:
        """Counts first, then a line a file."""
        counts = f"{self.added} added, {self.reused} known already, {self.refused} refused."
        told = [counts] if self.added + self.reused + self.refused or not self.note else []
        if self.job_id and (self.state != "done" or self.note):
            told.append(f"{self.job_id}: {self.state}. {self.note}".rstrip())
        lines = [f"- {i.artifact_id}: {i.summary}{' (reused)' if i.reused else ''}" for i in self.items]
        lines += [f"- refused {item.file}: {item.reason}" for item in self.refusals]
        hidden = self.added + self.reused + self.refused - len(self.items) - len(self.refusals)
        if hidden:
            lines.append(f"… {hidden} more files; describe_catalog counts what is there.")
        following = "get_job waits for the rest" if self.state == "running" else ""
        return Answer(told[0], told[1:], listed=lines, next_step=following)

    def to_line(self) -> str:
        """Counts and refusals in one line, as the last word of a job."""
        refused = "; ".join(f"{item.file}: {item.reason}" for item in self.refusals)
        counts = f"{self.added} added, {self.reused} known already, {self.refused} refused"
        return f"{counts}: {refused}" if refused else counts
