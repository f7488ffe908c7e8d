"""Extracts of whole countries: read once into tiles, from which any part is an ordinary map in a second."""
