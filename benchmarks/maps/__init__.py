"""Whether any place on earth can be used: places, large extracts, people, demand, formats, many scenarios at once."""
