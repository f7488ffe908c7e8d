"""Typed edits of a scenario, and the re-simulation that carries them out among replayed traffic."""
