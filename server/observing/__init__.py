"""Reports for the operator of a server: the journal of calls, the log, and, on request, traces and metrics."""
