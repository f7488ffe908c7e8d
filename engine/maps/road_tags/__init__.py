"""Interprets OpenStreetMap's tags of a road (users, speed, lanes), for use with netconvert.

OSM's documentation (https://wiki.openstreetmap.org/wiki/Key:access, Key:maxspeed, Key:lanes, Key:turn) defines the
tags.
"""
