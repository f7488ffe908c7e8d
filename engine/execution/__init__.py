"""Runs work outside the server's process: warm workers, jobs that outlive their call, claims, limits.

``Claims``: Claims of this process on recipes, so that no two processes create the same result simultaneously.
``ClusterExecutor``: Runs operations on the workers of a Dask cluster.
``Executor``: Runs operations in isolation from each other and returns their responses.
``Lane``: The workers that run an operation: ``compute`` or ``retrieval``.
``OnProgress``: A progress listener: an async function of the completed share in [0, 1] and a short message.
``ExecutorAround``: Base of executors that pass operations on to another one.
``Operation``: A function of the engine that runs in a worker, with its request, response and time limit in seconds.
``ProgressReporter``: A callback of an operation for the completed share in [0, 1] and a short message.
``Request``: Type variable of an operation's input.
``Response``: Type variable of an operation's output.
``no_progress``: A progress listener that does nothing.
``silent``: A progress reporter that does nothing.
``Job``: A piece of long work: its state, the completed share in [0, 1], ids of results.
``JobProgress``: Records the progress and the results of a job.
``JobRunner``: Starts, waits for and cancels jobs.
``JobStore``: Reads and writes job records.
``JobWork``: The work of a job, which receives an object to report its progress.
``RunApart``: Runs an async function of a job with its arguments, for example in another thread.
``Task``: A separate call; its client requests the answer later.
``TaskStore``: Reads and writes tasks.
``hide_environment``: Hides the initial environment of this process from other processes.
``Limits``: The folders, processes, memory in bytes and time in seconds that a call may use.
``end_with_parent``: Makes the operating system kill this process when its parent is gone.
``limit_memory``: Limits the data memory of this process, in bytes.
``MemoryTrimmer``: Returns freed memory to the operating system after work, at most every few seconds.
``share_heaps``: Makes all threads of this process share few heaps.
``ReachableExecutor``: An executor of one event loop, for callers in threads with other loops.
``CallThreads``: Threads with their own event loops that serve one call after another.
``OwnThread``: A thread reserved for one user, such as a stream.
``run_in``: Runs an async function in the event loop of another thread.
``WorkerPool``: Runs operations in worker processes.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .claims import Claims
    from .cluster import ClusterExecutor
    from .environment import hide_environment
    from .executor import (
        Executor,
        ExecutorAround,
        Lane,
        OnProgress,
        Operation,
        ProgressReporter,
        Request,
        Response,
        no_progress,
        silent,
    )
    from .jobs import Job, JobProgress, JobRunner, JobStore, JobWork, RunApart
    from .limits import Limits, MemoryTrimmer, end_with_parent, limit_memory, share_heaps
    from .pool import WorkerPool
    from .tasks import Task, TaskStore
    from .threads import CallThreads, OwnThread, ReachableExecutor, run_in

__getattr__, __dir__ = lazy_face(__name__, __file__)
