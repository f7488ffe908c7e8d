"""The roads of a site: cut out of a map, with their pavements, and written as netconvert reads them."""
