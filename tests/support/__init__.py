"""Shared helpers of tests: handmade scenarios and runs, sessions with a server, operations that misbehave.

Importable as ``support`` because pytest's ``pythonpath`` holds the folder ``tests``.

Like a worker, a process of tests sums with one thread and keeps freed memory. With more threads, small products of
matrices take up to 20 times the processor time, because the threads wait for each other. numpy reads its variables
when it is imported, and the C library when a process starts, so the latter count for the processes of pytest-xdist.
"""

import os

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
os.environ.update({"MALLOC_MMAP_THRESHOLD_": str(4 * 2**20), "MALLOC_TRIM_THRESHOLD_": str(64 * 2**20)})
