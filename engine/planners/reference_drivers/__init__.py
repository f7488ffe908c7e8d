"""Reference drivers: models of a driver in the ego's place, for verdicts on collisions and as planners.

``models`` describes each driver as a frozen dataclass that reacts to what it sees; ``paths`` gives a driver its view of
the others along its path; ``drives`` moves a driver among recorded others; ``planner`` runs the drivers in the loop.
"""
