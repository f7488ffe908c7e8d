"""Scenarios from real maps, judged by their files: ``python -m benchmarks.generation``."""
