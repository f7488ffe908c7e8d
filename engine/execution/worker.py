"""The main program of a worker process, and its messages to and from the server's process.

Messages are one JSON object per line: an order goes in; progress, then an answer or a failure come out.

Native code bypasses ``sys.stdout``, so file descriptor 1 is redirected to standard error at the start, and reports use
a private duplicate. The process ends when its standard input closes or, on Linux, when its parent dies.
"""

import gc
import importlib
import inspect
import json
import logging
import os
import queue
import signal
import threading
import traceback
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, BinaryIO

from ...schemas.base import Model
from ...schemas.errors import PlannerForgeError, Remedy, ResourceFailure, rebuild
from .environment import hide_environment
from .limits import end_with_parent, limit_memory

LOGS_DECISIONS = "PLANNERFORGE_WORKER_DECISIONS"
"""The environment variable that makes a worker log the engine's decisions."""
LONGEST_LINE_BYTES = 256 * 1024**2
"""Longest report that the server reads (chosen)."""


@dataclass(frozen=True)
class Order:
    """Work for a worker: the entry point ``module:function`` and its request as JSON."""

    entry_point: str
    request: str


@dataclass(frozen=True)
class Progress:
    """Progress of the work: share in [0, 1] and a short message."""

    share: float
    message: str


@dataclass(frozen=True)
class Answer:
    """The response of an operation as JSON."""

    response: str


@dataclass(frozen=True)
class Failure:
    """An error of an operation; ``unexpected`` has the traceback of a defect."""

    code: str
    message: str
    valid: Sequence[str]
    next_step: str
    unexpected: str = ""
    reason: str = ""
    remedies: Sequence[Mapping[str, Any]] = ()
    complete: bool = False

    @classmethod
    def of(cls, error: PlannerForgeError, unexpected: str = "") -> "Failure":
        """Return the failure that carries a domain error across processes."""
        remedies = [remedy.to_json() for remedy in error.remedies]
        fields = error.code, error.message, error.valid, error.next_step
        return cls(*fields, unexpected, error.reason, remedies, error.complete)

    def error(self) -> PlannerForgeError:
        """Return the domain error again."""
        remedies = [Remedy.of_json(remedy) for remedy in self.remedies]
        error = rebuild(self.code, self.message, self.valid, self.next_step, self.reason, remedies)
        error.complete = self.complete
        return error


def line_of(message: Order | Progress | Answer | Failure) -> bytes:
    """Return a message as one line: the name of its class, and its fields."""
    return json.dumps([type(message).__name__, vars(message)], separators=(",", ":")).encode() + b"\n"


def read_report(line: bytes) -> Progress | Answer | Failure:
    """Return the message in a worker's line."""
    name, fields = json.loads(line)
    report: type[Progress | Answer | Failure] = next(k for k in (Progress, Answer, Failure) if k.__name__ == name)
    return report(**fields)


WARM_UP = "warm-up"
"""Replaces an entry point: import the modules in the request."""


def main() -> None:
    """Serve orders from standard input until it closes."""
    reports, orders_in = os.fdopen(os.dup(1), "wb", buffering=0), os.fdopen(os.dup(0), "rb")
    os.dup2(2, 1)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)  # child programs must not read the orders
    end_with_parent()
    hide_environment()
    limit_memory(int(os.environ.get("PLANNERFORGE_WORKER_MEMORY", "0")))
    if os.environ.get(LOGS_DECISIONS):
        log_decisions()
    orders: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_read_orders, args=(orders_in, orders), daemon=True).start()
    while True:
        order = Order(**json.loads(orders.get())[1])
        if order.entry_point == WARM_UP:
            warm_up(order.request.split())
            continue
        reports.write(line_of(_carry_out(order, reports)))


def log_decisions() -> None:
    """Log the engine's decisions, but not those of other libraries, to standard error, which is the workers' log."""
    logging.basicConfig(format="%(levelname)s %(name)s: %(message)s")
    logging.getLogger("plannerforge").setLevel(logging.DEBUG)


def warm_up(modules: Iterable[str]) -> None:
    """Import modules and exclude them from later garbage collections, which need not traverse permanent objects."""
    for module in modules:
        importlib.import_module(module)
    gc.freeze()


def _read_orders(orders_in: BinaryIO, orders: "queue.SimpleQueue[bytes]") -> None:
    for line in orders_in:
        orders.put(line)
    if os.getpgrp() == os.getpid():  # the server is gone, so this work has no receiver
        os.killpg(0, signal.SIGKILL)
    os._exit(0)


def _carry_out(order: Order, reports: BinaryIO) -> Answer | Failure:
    def report(share: float, message: str = "") -> None:
        reports.write(line_of(Progress(min(max(share, 0.0), 1.0), message)))

    try:
        module, function = order.entry_point.split(":")
        operation = getattr(importlib.import_module(module), function)
        request_type = next(iter(inspect.get_annotations(operation, eval_str=True).values()))
        response = operation(request_type.model_validate_json(order.request), report)
        if not isinstance(response, Model):
            raise TypeError(f"{order.entry_point} returned {type(response).__name__}, not a Model")
        return Answer(response.model_dump_json())
    except PlannerForgeError as error:
        return Failure.of(error)
    except MemoryError:
        return Failure.of(ResourceFailure("a worker reached its memory limit", next_step="request less at once"))
    except OSError as error:
        refused = f"the operating system reports: {error.strerror or error}"
        failure = ResourceFailure(refused, next_step="free disk space or check permissions")
        return Failure.of(failure, traceback.format_exc())
    except Exception as error:  # noqa: BLE001 - the boundary of a worker: the exception becomes this item's error
        return Failure("unexpected", f"{type(error).__name__}: {error}", (), "", traceback.format_exc())


if __name__ == "__main__":
    main()
