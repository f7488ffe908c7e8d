"""Faults: planner batches with killed servers and workers and a full disk, and killed imports."""
