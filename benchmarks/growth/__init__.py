"""Measures how processor time grows when the input doubles."""
