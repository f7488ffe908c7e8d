"""Planners that are not part of this program: classes of other packages, and programs that the settings name."""
