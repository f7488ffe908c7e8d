"""Scenarios from real maps, judged from the made files: ``python -m benchmarks.generation``."""
