"""Maps in formats other than OpenStreetMap: SUMO, CommonRoad, OpenDRIVE, Lanelet2.

``engine.maps`` exports the names.
"""
