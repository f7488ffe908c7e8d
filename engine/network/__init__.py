"""Road networks: SUMO nets and CommonRoad lanelets with one geometry, and the graph that connects lanelets."""
