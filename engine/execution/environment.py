"""Hides the environment of this program's processes, which may contain secrets, from other programs.

Every program of the same user can read the initial environment of a process, on Linux in ``/proc/PID/environ``. A
planner program must not find a token there, in any process. The server therefore hides its initial environment, and its
workers do not receive the variables that only the server reads.
"""

import os
import sys
from collections.abc import Mapping
from pathlib import Path

from ...schemas.planning import PLANNERS_VARIABLE

_SETTINGS = ("PLANNERFORGE_", "OTEL_")
"""Prefixes of settings: of this program, and of OpenTelemetry's exporter, which may send a key."""
_ENVIRONMENT_BEGINS, _ENVIRONMENT_ENDS = 50, 51
"""Fields ``env_start`` and ``env_end`` of /proc/PID/stat, counted from 1 (proc_pid_stat(5))."""
_FIRST_AFTER_NAME = 3
"""The field after the program's name, the only field that may contain spaces."""


def without_settings(environment: Mapping[str, str]) -> dict[str, str]:
    """Return an environment without the settings that only the server reads, such as its tokens."""
    return {
        name: value
        for name, value in environment.items()
        if name == PLANNERS_VARIABLE or not name.startswith(_SETTINGS)
    }


def hide_environment() -> None:
    """Hide the initial environment of this process from other processes (on Linux).

    The kernel exposes the memory of the initial environment. Setting every variable again makes the C library copy it,
    and then the original memory is cleared. The process itself sees no difference.
    """
    if sys.platform != "linux":
        return
    import ctypes

    for name, value in list(os.environb.items()):
        os.environb[name] = value
    fields = Path("/proc/self/stat").read_bytes().rpartition(b")")[2].split()
    begins, ends = (int(fields[field - _FIRST_AFTER_NAME]) for field in (_ENVIRONMENT_BEGINS, _ENVIRONMENT_ENDS))
    if begins:  # 0 if the kernel does not report it
        ctypes.memset(begins, 0, ends - begins)
