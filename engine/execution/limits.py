"""What work may use: folders, processes, memory and time."""

from dataclasses import dataclass
from pathlib import Path

from ...schemas.errors import OutsideRoots, UnsafeInput


@dataclass(frozen=True)
class Limits:
    """The bounds that every tool call works within.

    Args:
        roots: folders that files may be read from and written to.
        worker_count: worker processes for simulation and planning.
        worker_memory_bytes: data memory of one worker process (enforced by the operating system on Linux).
        operation_timeout_s: time after which one operation of a worker is ended.
        file_bytes: largest file that is read.
    """

    roots: tuple[Path, ...]
    worker_count: int = 2
    worker_memory_bytes: int = 4 * 1024**3
    operation_timeout_s: float = 300.0
    file_bytes: int = 100_000_000

    def allowed_path(self, text: str) -> Path:
        """The path, made absolute and with links resolved, if it lies inside an allowed root.

        Raises:
            OutsideRoots: naming the roots and the setting that extends them.
        """
        path = self._resolved(text)
        if path is not None and any(path.is_relative_to(root.resolve()) for root in self.roots):
            return path
        raise OutsideRoots(
            f"'{text}' lies outside the folders that may be used",
            valid=self.roots,
            next_step="use a path inside them, or name the folder in --roots or PLANNERFORGE_ROOTS at the start",
        )

    def check_size(self, path: Path) -> None:
        """Refuse a file that is larger than what is read, before anything looks into it.

        Raises:
            UnsafeInput: naming both sizes and the setting.
        """
        size = path.stat().st_size
        if size > self.file_bytes:
            raise UnsafeInput(
                f"{path.name} has {size:,} bytes; at most {self.file_bytes:,} are read",
                next_step="name a smaller file, or raise the file_mb setting",
            )

    def _resolved(self, text: str) -> Path | None:
        """The absolute path; None for what cannot be one: a null byte, a loop of links, the home of no user."""
        try:
            path = Path(text).expanduser()
            return (path if path.is_absolute() else self.roots[0] / path).resolve()
        except (ValueError, RuntimeError, OSError):
            return None
