"""The process between a worker and a program planner; it is started by path and imports nothing from this package.

``guard.py PARENT_PID MEMORY_BYTES FILE_BYTES PROGRAM ARGUMENT…`` starts the program within the limits, leads its
process group, and exits with the program's status. If the worker dies, the whole group ends.
"""

import os
import signal
import sys
from types import FrameType

_DIE_WITH_PARENT = 1
"""PR_SET_PDEATHSIG of Linux's prctl."""
_NOT_STARTED = 127


def main(parent_pid: int, memory_bytes: int, file_bytes: int, command: list[str]) -> int:
    """Run the command and return its exit status, or 128 + the signal that ended it."""
    signal.signal(signal.SIGTERM, _end_group)
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGTERM)
    if os.getppid() != parent_pid:  # the parent ended before this process could watch it
        _end_group(signal.SIGTERM, None)
    child = os.fork()
    if child == 0:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        _become(memory_bytes, file_bytes, command)
    os.close(0)  # only the program keeps its input and output open, so the other end notices when they close
    os.close(1)
    _, status = os.waitpid(child, 0)
    code = os.waitstatus_to_exitcode(status)
    return code if code >= 0 else 128 - code


def _become(memory_bytes: int, file_bytes: int, command: list[str]) -> None:
    import resource

    try:
        _, most = resource.getrlimit(resource.RLIMIT_DATA)
        resource.setrlimit(resource.RLIMIT_DATA, (most, most))  # the worker's own limit is a different one
        resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
        resource.setrlimit(resource.RLIMIT_FSIZE, (file_bytes, file_bytes))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        os.execvp(command[0], command)  # noqa: S606 - the settings give a list
    except (OSError, ValueError) as error:
        sys.stderr.write(f"{command[0]} cannot be started: {error}\n")
        sys.stderr.flush()
    os._exit(_NOT_STARTED)


def _end_group(signal_number: int, frame: FrameType | None) -> None:
    """Remove the working folder on behalf of the lost worker, and end the process group."""
    del signal_number, frame
    import shutil
    from pathlib import Path

    folder = Path.cwd()
    if folder.name.startswith("plannerforge-"):
        shutil.rmtree(folder, ignore_errors=True)
    os.killpg(0, signal.SIGKILL)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), sys.argv[4:]))
