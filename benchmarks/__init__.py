"""Measurements. Each prints a table for people and ends with one JSON object for comparison."""
