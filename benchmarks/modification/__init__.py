"""Edits of real scenarios, judged from the written files: ``python -m benchmarks.modification``."""
