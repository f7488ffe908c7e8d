"""Scenarios from real maps, judged from the made files: ``python -m plannerforge.evals.generation``."""
