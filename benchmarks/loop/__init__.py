"""Measurements of the run loop: motions, verdicts, causes, user planners and comparisons."""
