"""Work outside the server's process: warm workers, jobs that outlive their call, claims, limits.

``Claims``: Claims of this process on recipes, so that no other makes the same at the same time.
``ClusterExecutor``: Carries operations out on the workers of a Dask cluster.
``Executor``: Runs operations, each apart from the others; gives their responses.
``Lane``: Which workers carry an operation out: ``compute`` or ``retrieval``.
``OnProgress``: A listener to progress: an async function of the share done in [0, 1] and a few words.
``ExecutorAround``: What executors share that hand operations on to another one.
``Operation``: A function of the engine that runs in a worker, with its request, response and time limit in seconds.
``ProgressReporter``: Called by an operation with the share done in [0, 1] and a few words.
``Request``: Type variable of what an operation takes.
``Response``: Type variable of what an operation returns.
``no_progress``: A listener to progress that drops what it is given.
``silent``: A progress reporter that drops what it is given.
``Job``: A piece of long work: its state, the share done in [0, 1], ids of results.
``JobProgress``: Records the progress and the results of a job.
``JobRunner``: Starts, waits for and cancels jobs.
``JobStore``: Reads and writes job records.
``JobWork``: What a job does, given the means to report its progress.
``RunApart``: Runs an async function of a job with its arguments, in another thread for instance.
``Task``: A call that is carried out apart, whose answer is asked for later.
``TaskStore``: Reads and writes tasks.
``hide_environment``: Let other processes no longer read the environment that this one was started with.
``Limits``: The folders, processes, memory in bytes and time in seconds that a call may use.
``end_with_parent``: Have the operating system kill this process when the one that started it is gone.
``limit_memory``: Bound the data memory of this process, in bytes.
``HeapsGivenBack``: Gives freed memory back to the operating system after work, at most every some seconds.
``share_heaps``: Have all threads of this process take their memory from few heaps.
``ReachableExecutor``: An executor of one event loop, for callers in threads with another.
``CallThreads``: Threads with event loops of their own, lent to one call after the other.
``OwnThread``: A thread for one user, such as a stream.
``run_in``: Run an async function in the event loop of another thread.
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
    from .limits import HeapsGivenBack, Limits, end_with_parent, limit_memory, share_heaps
    from .pool import WorkerPool
    from .tasks import Task, TaskStore
    from .threads import CallThreads, OwnThread, ReachableExecutor, run_in

__getattr__, __dir__ = lazy_face(__name__, __file__)
