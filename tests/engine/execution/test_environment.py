"""No program of the same user finds a token in the environment of this program's processes."""

import os
import subprocess
import sys

import pytest

from plannerforge.engine.execution.environment import without_settings

SECRET = "a-token-that-no-other-may-read"
LINUX = pytest.mark.skipif(sys.platform != "linux", reason="only Linux shows environments in /proc")


def test_workers_get_the_programs_of_planners_and_no_other_setting() -> None:
    given = {
        "HOME": "/home/user",
        "PLANNERFORGE_HTTP_TOKENS": SECRET,
        "PLANNERFORGE_PLANNERS": "{}",
        "OTEL_EXPORTER_OTLP_HEADERS": SECRET,
    }
    assert without_settings(given) == {"HOME": "/home/user", "PLANNERFORGE_PLANNERS": "{}"}


@LINUX
def test_hidden_environment_is_still_there_for_the_process_and_its_children() -> None:
    program = """
import ctypes, os, subprocess, sys
from pathlib import Path
from plannerforge.engine.execution import hide_environment
before = Path("/proc/self/environ").read_bytes()
hide_environment()
after = Path("/proc/self/environ").read_bytes()
of_c = ctypes.CDLL(None).getenv
of_c.restype = ctypes.c_char_p
command = [sys.executable, "-c", "import os; print(os.environ['API_KEY'])"]
child = subprocess.run(command, capture_output=True, text=True)
print(os.environ["API_KEY"] in before.decode(), bool(after.strip(b"\\0")), of_c(b"API_KEY").decode(), child.stdout)
"""
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "API_KEY": SECRET},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == ["True", "False", SECRET, SECRET]
