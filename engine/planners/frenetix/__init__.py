"""Frenetix: the planner, the C++ core that it drives, and the cost terms that the core lacks."""
