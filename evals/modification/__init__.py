"""Edits of real scenarios, judged from the written files: ``python -m plannerforge.evals.modification``."""
