"""Analyse and compare runs, try suggestions, optimise planners, and run test suites with limits."""
