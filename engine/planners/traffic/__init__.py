"""The other road users in a run: as recorded, or driven by SUMO so that they react to the ego."""
