"""Planners that are not part of this program: classes of other packages, and programs in the settings."""
