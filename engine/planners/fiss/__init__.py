"""FISS: iterative search over sampled end states, by the C++ core of its authors; the planner is in ``planner.py``."""
