"""Distances on the ground between coordinates; it imports no other package, so that names can be looked up lightly."""

import math

EARTH_RADIUS_M = 6_371_008.8
"""Mean radius of the Earth (IUGG)."""
HALF_TURN_DEG = 180.0
"""Longitude: consecutive nodes of a way that differ by more are on different sides of the antimeridian."""


def ground_distance_m(first: tuple[float, float], second: tuple[float, float]) -> float:
    """Return the distance in m between (latitude, longitude) pairs in degrees (equirectangular, within a map)."""
    middle = math.radians((first[0] + second[0]) / 2)
    north = math.radians(second[0] - first[0])
    east = math.radians(math.remainder(second[1] - first[1], 2 * HALF_TURN_DEG)) * math.cos(middle)
    return EARTH_RADIUS_M * math.hypot(north, east)
