"""What is said of sets of runs: comparisons, test suites."""
