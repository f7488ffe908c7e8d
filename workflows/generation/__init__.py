"""Generate scenarios from maps: the engine's request for each, in sequence or by a plan."""
