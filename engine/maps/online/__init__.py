"""Places and roads from the net: Nominatim tells where a place is, Overpass gives its roads, answers are kept."""
