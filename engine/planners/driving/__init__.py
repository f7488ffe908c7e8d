"""Limits on what a vehicle can drive, for planned and driven motions, and solution files of driven runs."""
