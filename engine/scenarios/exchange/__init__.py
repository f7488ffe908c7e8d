"""Scenarios in the formats of other tools: OpenDRIVE for the roads, OpenSCENARIO XML for the recorded motion,
OpenLABEL for the tags."""
