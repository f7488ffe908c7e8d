"""Reference drivers: models of a driver in the ego's place, for verdicts on collisions and as planners.

``models`` describes each driver as a frozen dataclass that reacts to what it sees. ``paths`` gives a driver its view of
the other road users along its path. ``drives`` moves a driver among recorded road users, and ``planner`` runs the
drivers in the loop.
"""
