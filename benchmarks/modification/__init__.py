"""Edits of real scenarios, judged by the written files: ``python -m benchmarks.modification``."""
