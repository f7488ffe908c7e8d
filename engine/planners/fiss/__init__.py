"""FISS: iterative search over sampled end states, with its authors' C++ core; the planner is in ``planner.py``."""
