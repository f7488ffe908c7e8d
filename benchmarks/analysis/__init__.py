"""``make bench-analysis``: checks that statements of analyses about runs are true."""
