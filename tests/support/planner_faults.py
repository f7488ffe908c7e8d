"""A planner run in a worker that misbehaves if a file of the test says so.

The folder ``PLANNER_FAULTS`` holds, for a scenario's id, a file with the name of a fault; without one the real run is
carried out.
"""

import ctypes
import os
import signal
import time
from pathlib import Path

from plannerforge.engine.execution.executor import ProgressReporter
from plannerforge.engine.planners.runs import run_planner as real_run
from plannerforge.schemas.planning import RunRequest, RunResponse


def run(request: RunRequest, report: ProgressReporter) -> RunResponse:
    told = Path(os.environ["PLANNER_FAULTS"]) / request.scenario_id
    if told.is_file():
        misbehave(told.read_text())
    return real_run(request, report)


def misbehave(fault: str) -> None:
    """Do something that no operation should."""
    if fault == "hang":
        time.sleep(1000)
    elif fault == "native_crash":
        ctypes.string_at(0)
    elif fault == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    elif fault == "leave":
        os._exit(3)
    elif fault == "memory":
        raise MemoryError
    elif fault == "defect":
        raise KeyError("secret")
    elif fault == "disk":
        raise OSError(28, "No space left on device")
