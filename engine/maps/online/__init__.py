"""Places and roads from online services: Nominatim locates a place, and Overpass returns its roads.

Answers are cached."""
