"""The roads of a site: cut out of a map, with pavements, and written in the form that netconvert reads."""
