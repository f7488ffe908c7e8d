"""Places and roads from online services: Nominatim locates a place, Overpass returns its roads, answers are cached."""
