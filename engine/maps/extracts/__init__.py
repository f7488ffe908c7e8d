"""Extracts of whole countries, which are split into tiles once.

Any part can then be read as an ordinary map within a second."""
