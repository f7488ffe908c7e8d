"""Exports a scenario's lanelet network as a SUMO net: layout, speeds, ``.net.xml``.

``engine.network`` exports the names.
"""
