"""The limits of what a vehicle can drive, checks of planned and driven motions, and solution files of driven runs."""
