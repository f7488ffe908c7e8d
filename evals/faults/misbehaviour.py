"""Operations for ``make bench-faults``: a run that hangs, and one that crashes the native core."""

import ctypes
import time

from ...engine.execution import ProgressReporter
from ...schemas.planning import RunRequest, RunResponse


def hang(request: RunRequest, report: ProgressReporter) -> RunResponse:
    """Never answer."""
    report(0.1, request.scenario_id)
    while True:
        time.sleep(1.0)


def crash(request: RunRequest, report: ProgressReporter) -> RunResponse:
    """Read memory that is not ours, as a defect of native code would."""
    report(0.1, request.scenario_id)
    ctypes.string_at(0)
    raise AssertionError("the process outlived a segmentation fault")
