"""Checks that any place on earth works: places, large extracts, people, demand, formats, many scenarios at once."""
