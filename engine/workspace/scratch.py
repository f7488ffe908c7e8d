"""Temporary folders on the workspace's disk, and what servers that were killed left of them."""

import os
import shutil
import tempfile
import time
from pathlib import Path

from plannerforge.engine.execution.ownership import still_runs

ABANDONED_S = 3600.0
"""A folder is left alone for so long even where its process cannot be seen: it may run in another container."""


def new_folder(parent: Path) -> Path:
    """A new folder that tells by its name which process made it.

    Raises:
        OSError: it cannot be made.
    """
    parent.mkdir(parents=True, exist_ok=True)
    return Path(tempfile.mkdtemp(prefix=f"{os.getpid()}-", dir=parent))


def remove_abandoned(parent: Path) -> None:
    """Remove the folders of processes that are gone, an hour after they were last written to."""
    for folder in sorted(parent.glob("*-*")):
        pid = folder.name.partition("-")[0]
        try:
            written_at = folder.stat().st_mtime
        except FileNotFoundError:  # its owner has just removed it
            continue
        if pid.isdecimal() and time.time() - written_at > ABANDONED_S and not still_runs(int(pid), written_at):
            shutil.rmtree(folder, ignore_errors=True)
