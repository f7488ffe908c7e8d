"""Findings: computed statements about a set of runs, each with its evidence. One finding, one file."""
