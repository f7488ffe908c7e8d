"""The process between a worker and a planner that is a program; run by its path, it imports nothing of this package.

``guard.py PARENT_PID MEMORY_BYTES FILE_BYTES PROGRAM ARGUMENT…``: starts the program within the limits, in a process
group of which it is the leader, and ends as the program does. When the worker dies, the whole group does.
"""

import os
import signal
import sys
from types import FrameType

_DIE_WITH_PARENT = 1
"""PR_SET_PDEATHSIG of Linux's prctl."""
_NOT_STARTED = 127


def main(parent_pid: int, memory_bytes: int, file_bytes: int, command: list[str]) -> int:
    """Run the command; its exit status, 128 + the signal where one ended it."""
    signal.signal(signal.SIGTERM, _end_group)
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGTERM)
    if os.getppid() != parent_pid:  # it had gone before it could be watched
        _end_group(signal.SIGTERM, None)
    child = os.fork()
    if child == 0:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        _become(memory_bytes, file_bytes, command)
    os.close(0)  # only the program holds its input and output, so that closing them is seen at the other end
    os.close(1)
    _, status = os.waitpid(child, 0)
    code = os.waitstatus_to_exitcode(status)
    return code if code >= 0 else 128 - code


def _become(memory_bytes: int, file_bytes: int, command: list[str]) -> None:
    import resource

    try:
        _, most = resource.getrlimit(resource.RLIMIT_DATA)
        resource.setrlimit(resource.RLIMIT_DATA, (most, most))  # the worker's own bound is another
        resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
        resource.setrlimit(resource.RLIMIT_FSIZE, (file_bytes, file_bytes))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        os.execvp(command[0], command)  # noqa: S606 - a list, named in the settings
    except (OSError, ValueError) as error:
        sys.stderr.write(f"{command[0]} cannot be started: {error}\n")
        sys.stderr.flush()
    os._exit(_NOT_STARTED)


def _end_group(signal_number: int, frame: FrameType | None) -> None:
    """The worker is gone, which would have removed the working folder."""
    del signal_number, frame
    import shutil
    from pathlib import Path

    folder = Path.cwd()
    if folder.name.startswith("plannerforge-"):
        shutil.rmtree(folder, ignore_errors=True)
    os.killpg(0, signal.SIGKILL)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), sys.argv[4:]))
