"""Faults: planner batches under killed servers, workers and a full disk, and imports that are killed."""
