"""Processes that benches start and kill. Finds their descendants and survivors by a mark that they inherit."""

import time
from collections.abc import Callable

import psutil

MARK = "PLANNERFORGE_BENCH_MARK"
"""An inherited variable that identifies all descendants of a server."""
_GONE_WITHIN_S = 10.0
"""Time within which a killed process and its descendants must end (chosen)."""


def marked(mark: str, but_pid: int) -> list[psutil.Process]:
    """Return running processes that carry a mark, except one."""
    return [process for process in psutil.process_iter() if _has_mark(process, mark, but_pid)]


def _has_mark(process: psutil.Process, mark: str, but_pid: int) -> bool:
    try:
        is_alive = process.status() != psutil.STATUS_ZOMBIE
        return is_alive and process.pid != but_pid and process.environ().get(MARK) == mark
    except (psutil.NoSuchProcess, psutil.AccessDenied):
        return False


def descendants(process: psutil.Process) -> list[psutil.Process]:
    """Return the descendants of a process, empty if it has ended."""
    try:
        return process.children(recursive=True)
    except psutil.NoSuchProcess:
        return []


def alive(processes: list[psutil.Process]) -> list[psutil.Process]:
    """Return those that still run."""
    return [process for process in processes if process.is_running() and _status(process) != psutil.STATUS_ZOMBIE]


def _status(process: psutil.Process) -> str:
    try:
        return str(process.status())
    except psutil.NoSuchProcess:
        return str(psutil.STATUS_ZOMBIE)


def workers_of_this_process() -> list[psutil.Process]:
    """Return all worker processes below this one."""
    workers = []
    for child in psutil.Process().children(recursive=True):
        try:
            if "plannerforge.engine.execution.worker" in " ".join(child.cmdline()):
                workers.append(child)
        except psutil.NoSuchProcess:
            continue
    return workers


def remaining(left: Callable[[], list[psutil.Process]]) -> list[psutil.Process]:
    """Return the processes that outlive a grace period, and kill them."""
    until = time.monotonic() + _GONE_WITHIN_S
    while (processes := left()) and time.monotonic() < until:
        time.sleep(0.05)
    for process in processes:
        kill(process)
    return processes


def command_of(process: psutil.Process) -> list[str]:
    """Return the command line of a process, empty if it has ended."""
    try:
        return process.cmdline()
    except (psutil.NoSuchProcess, psutil.ZombieProcess):
        return []


def kill(process: psutil.Process) -> None:
    """Kill a process that may have ended."""
    try:
        process.kill()
    except psutil.NoSuchProcess:
        return
