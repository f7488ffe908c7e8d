"""Whether the process that owns a record still runs; process ids are given again, so the time counts too."""


def still_runs(pid: int, since: float) -> bool:
    """Whether the process ``pid`` that wrote something at ``since`` (seconds since 1970) is still there."""
    import psutil

    try:
        return bool(psutil.Process(pid).create_time() <= since + 1.0)  # clocks of file systems and kernels differ
    except psutil.NoSuchProcess:
        return False
    except psutil.AccessDenied:
        return True
