"""Maps: reading OpenStreetMap extracts, finding places and sites in them, cutting sites out, the maps drawn by us."""
