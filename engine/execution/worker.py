"""The main program of a worker process: read an order, run the operation, write its reports.

Native code writes past ``sys.stdout``, so file descriptor 1 is pointed at standard error before anything else, and the
reports go to a private duplicate. The process ends when its standard input closes or, on Linux, when its parent dies.
"""

import ctypes
import gc
import importlib
import inspect
import os
import queue
import signal
import sys
import threading
import traceback
from collections.abc import Iterable
from typing import BinaryIO

from plannerforge.engine.execution.messages import Answer, Failure, Order, Progress
from plannerforge.schemas.base import Model
from plannerforge.schemas.errors import PlannerForgeError, ResourceFailure

_DIE_WITH_PARENT = 1
WARM_UP = "warm-up"


def main() -> None:
    """Serve orders from standard input until it closes."""
    reports, orders_in = os.fdopen(os.dup(1), "wb", buffering=0), os.fdopen(os.dup(0), "rb")
    os.dup2(2, 1)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)  # programs that an operation starts must not read our orders
    _end_with_parent()
    _limit_memory(int(os.environ.get("PLANNERFORGE_WORKER_MEMORY", "0")))
    orders: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_read_orders, args=(orders_in, orders), daemon=True).start()
    while True:
        order = Order.read(orders.get())
        if order.entry_point == WARM_UP:
            warm_up(order.request.split())
            continue
        reports.write(_carry_out(order, reports).line())


def warm_up(modules: Iterable[str]) -> None:
    """Import modules and leave them out of later garbage collections, which need not walk through what stays."""
    for module in modules:
        importlib.import_module(module)
    gc.freeze()


def _read_orders(orders_in: BinaryIO, orders: "queue.SimpleQueue[bytes]") -> None:
    for line in orders_in:
        orders.put(line)
    if os.getpgrp() == os.getpid():  # the server is gone: whatever runs here has nobody to report to
        os.killpg(0, signal.SIGKILL)
    os._exit(0)


def _carry_out(order: Order, reports: BinaryIO) -> Answer | Failure:
    def report(share: float, message: str = "") -> None:
        reports.write(Progress(min(max(share, 0.0), 1.0), message).line())

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
        return Failure.of(ResourceFailure("the memory limit of a worker was reached", next_step="ask for less at once"))
    except OSError as error:
        failure = ResourceFailure(f"the operating system refused: {error.strerror or error}")
        return Failure(
            failure.code, failure.message, (), "free disk space or check permissions", traceback.format_exc()
        )
    except Exception as error:  # noqa: BLE001 - the boundary of a worker: it becomes the error of this one item
        return Failure("unexpected", f"{type(error).__name__}: {error}", (), "", traceback.format_exc())


def _end_with_parent() -> None:
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGKILL)


def _limit_memory(size_bytes: int) -> None:
    if size_bytes and sys.platform == "linux":
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, (size_bytes, size_bytes))


if __name__ == "__main__":
    main()
