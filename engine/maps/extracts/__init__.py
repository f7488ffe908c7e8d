"""Extracts of whole countries, read once into tiles.

Any part can then be read as an ordinary map within a second."""
