"""FISS: iterative search over sampled end states, by its authors' C++ core; the planner is in ``planner.py``."""
