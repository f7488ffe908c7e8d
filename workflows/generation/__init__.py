"""The tool that makes scenarios from maps: what is asked of the engine for each, one after the other, or to a plan."""
