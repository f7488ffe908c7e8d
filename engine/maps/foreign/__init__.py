"""Maps in other formats than OpenStreetMap: SUMO, CommonRoad, OpenDRIVE, Lanelet2. ``engine.maps`` exports the
names.
"""
