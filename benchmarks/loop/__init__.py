"""Measurements of the run loop: motions, verdicts, causes, own planners and comparisons that an engineer relies on."""
