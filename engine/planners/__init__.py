"""The planner interface, Frenetix, and the loop that runs planners on scenarios."""
