"""Generate scenarios from maps, one after the other or according to a coverage plan."""
