"""What places, roads and countries are called: spellings, scripts, and names in other languages."""
