"""Maps in other formats than OpenStreetMap: SUMO, CommonRoad, OpenDRIVE, Lanelet2. Its face is that of the maps."""
