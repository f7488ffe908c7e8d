"""Operations that only tests run in worker processes: each misbehaves in one way."""

import ctypes
import gc
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from plannerforge.engine.execution.executor import ProgressReporter
from plannerforge.schemas.base import Model
from plannerforge.schemas.errors import UnknownName


class Words(Model):
    text: str = ""
    number: int = 0


def echo(request: Words, report: ProgressReporter) -> Words:
    return request


def tell_pid(request: Words, report: ProgressReporter) -> Words:
    return Words(number=os.getpid())


def tell_frozen_objects(request: Words, report: ProgressReporter) -> Words:
    return Words(number=gc.get_freeze_count())


def tell_environment(request: Words, report: ProgressReporter) -> Words:
    return Words(text=os.environ.get(request.text, ""))


def tell_progress(request: Words, report: ProgressReporter) -> Words:
    for step in range(request.number):
        report(step / request.number, f"step {step}")
    return Words(text="all told")


def write_to_standard_output(request: Words, report: ProgressReporter) -> Words:
    os.write(1, b'{"response": "forged by native code"}\n')
    print("forged by print")  # noqa: T201 - what the test is about
    sys.stdout.flush()
    ctypes.CDLL(None).puts(b"forged by puts")
    ctypes.CDLL(None).fflush(None)
    report(0.5, "half")
    os.write(1, b"no newline at the end")
    return Words(text="true answer")


def read_standard_input(request: Words, report: ProgressReporter) -> Words:
    read = subprocess.run(["cat"], capture_output=True, check=True).stdout
    return Words(text=read.decode(), number=len(read))


def kill_itself(request: Words, report: ProgressReporter) -> Words:
    report(0.5, "half")
    os.kill(os.getpid(), signal.SIGKILL)
    return request


def touch_bad_memory(request: Words, report: ProgressReporter) -> Words:
    ctypes.string_at(0)
    return request


def leave(request: Words, report: ProgressReporter) -> Words:
    os._exit(request.number)


def fill_memory(request: Words, report: ProgressReporter) -> Words:
    return Words(number=len(bytearray(request.number)))


def refuse(request: Words, report: ProgressReporter) -> Words:
    raise UnknownName("there is no such thing", valid=["this", "that"], next_step="ask for this")


def fail(request: Words, report: ProgressReporter) -> Words:
    raise KeyError(f"secret of {request.text}")


def read_missing_file(request: Words, report: ProgressReporter) -> Words:
    with open("/no/such/file") as stream:  # noqa: PTH123 - fails as native code would
        return Words(text=stream.read())


def answer_with_no_model(request: Words, report: ProgressReporter) -> dict[str, str]:
    return {"text": "no model"}


def hang(request: Words, report: ProgressReporter) -> Words:
    """Hang forever after reporting its own process id and that of a started program."""
    program = subprocess.Popen(["sleep", "1000"])
    report(0.1, f"{os.getpid()} {program.pid}")
    while True:
        time.sleep(1)


class Letter(Model):
    path: str = ""
    folder: str = ""
    text: str = ""


def copy_letter(request: Letter, report: ProgressReporter) -> Letter:
    """Copy the content of the file at ``path`` into the empty ``folder``."""
    text = Path(request.path).read_text(encoding="utf-8")
    copy = Path(request.folder) / "copies" / Path(request.path).name
    copy.parent.mkdir()
    copy.write_text(text, encoding="utf-8")
    return Letter(text=f"{text} by {os.getpid()}")
