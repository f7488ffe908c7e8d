"""Selection over real scenarios against ground truth: ``python -m benchmarks.selection``."""
