"""Selection over real scenarios against ground truth: ``python -m plannerforge.evals.selection``."""
