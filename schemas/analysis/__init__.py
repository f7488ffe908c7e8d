"""Statements about sets of runs: comparisons, studies, test suites."""
