"""Start a Dask cluster of Slurm jobs. Run this on a node that may submit jobs, and leave it running.

    python slurm_cluster.py /shared/folder/scheduler.json

It writes the scheduler's address into this file; set ``cluster`` to its path.
"""

import sys
import time

from dask_jobqueue import SLURMCluster

if __name__ == "__main__":
    cluster = SLURMCluster(
        cores=8,
        processes=1,  # one Dask worker per job, with a process for each of its 8 threads
        memory="32GB",
        walltime="04:00:00",
        job_script_prologue=["source /shared/folder/venv/bin/activate"],
        scheduler_options={"scheduler_file": sys.argv[1]},
    )
    cluster.adapt(minimum_jobs=1, maximum_jobs=20)
    while True:
        time.sleep(60)
