"""Finds the sites of each type on a map: rings, crossings and roads, and their surroundings."""
