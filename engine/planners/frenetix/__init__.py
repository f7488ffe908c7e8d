"""Frenetix: the planner, its C++ core, and the cost terms that the core lacks."""
