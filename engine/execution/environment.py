"""What other programs see of the environment of this program's processes, which may hold secrets.

Every program of the same user can read the environment with which a process was started, on Linux in
``/proc/PID/environ``. A planner program must not find a token there, whichever process it looks at: the server hides
the environment that it was started with, and its workers get none of the variables that only the server reads.
"""

import os
import sys
from collections.abc import Mapping
from pathlib import Path

from ...schemas.planning import PLANNERS_VARIABLE

_SETTINGS = ("PLANNERFORGE_", "OTEL_")
"""How the names of settings begin: of this program, and of OpenTelemetry's exporter, which may send a key."""
_ENVIRONMENT_BEGINS, _ENVIRONMENT_ENDS = 50, 51
"""Fields ``env_start`` and ``env_end`` of /proc/PID/stat, counted from 1 (proc_pid_stat(5))."""
_FIRST_AFTER_NAME = 3
"""The field that follows the program's name, the only one that may hold spaces."""


def without_settings(environment: Mapping[str, str]) -> dict[str, str]:
    """Return an environment without the settings that only the server reads, such as its tokens."""
    return {
        name: value
        for name, value in environment.items()
        if name == PLANNERS_VARIABLE or not name.startswith(_SETTINGS)
    }


def hide_environment() -> None:
    """Let other processes no longer read the environment that this one was started with (on Linux).

    The kernel shows the memory in which the environment lay at the start. Every variable is set anew, which makes the
    C library copy it, and that memory is cleared. The process itself sees no difference.
    """
    if sys.platform != "linux":
        return
    import ctypes

    for name, value in list(os.environb.items()):
        os.environb[name] = value
    fields = Path("/proc/self/stat").read_bytes().rpartition(b")")[2].split()
    begins, ends = (int(fields[field - _FIRST_AFTER_NAME]) for field in (_ENVIRONMENT_BEGINS, _ENVIRONMENT_ENDS))
    if begins:  # 0 if the kernel does not say
        ctypes.memset(begins, 0, ends - begins)
