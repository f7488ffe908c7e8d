"""Names of places, roads and countries: spellings, scripts, and other languages."""
