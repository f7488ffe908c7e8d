"""What OpenStreetMap's tags say of a road: who may use it, how fast, on which lanes; written as netconvert reads it.

OSM's documentation (https://wiki.openstreetmap.org/wiki/Key:access, Key:maxspeed, Key:lanes, Key:turn) defines them.
"""
