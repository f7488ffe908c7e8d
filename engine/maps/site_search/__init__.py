"""Finds the sites of each type on a map: rings, intersections and roads, and their surroundings."""
