"""Writing what becomes a file of an artifact."""

from pathlib import Path

from plannerforge.schemas.errors import ResourceFailure


def write_text(path: Path, text: str, what: str) -> None:
    """Write a file; ``what`` names its content in the error.

    Raises:
        ResourceFailure: the disk is full, or the folder cannot be written.
    """
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ResourceFailure(
            f"{what} cannot be written: {error.strerror or error}",
            next_step="free disk space and call again: what is finished is reused",
        ) from error
