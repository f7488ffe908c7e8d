"""Extracts of whole countries: read once into tiles; any part can then be read as an ordinary map within a second."""
