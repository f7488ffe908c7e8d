"""What a vehicle can drive: the limits of planned and driven motions, and solution files of driven runs."""
