"""SUMO demand and simulation, and what turns SUMO's motion into drivable trajectories."""
