"""Numbers of traffic signs that mean the same in different countries."""

SPEED_LIMITS = frozenset({"274", "274.1", "R2-1", "r301", "3.24", "R15", "C43", "B14", "Ρ-32", "B31"})
"""A speed limit, or the beginning of a zone with one, in the countries whose signs CommonRoad knows."""
