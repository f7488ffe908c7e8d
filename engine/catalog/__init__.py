"""The catalogue: slots filter in SQLite, text ranks what is left."""
