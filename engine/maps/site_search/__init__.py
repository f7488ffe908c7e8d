"""Where on a map sites of each type are: rings, crossings and roads, and what lies around them."""
