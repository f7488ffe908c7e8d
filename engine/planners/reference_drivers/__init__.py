"""Reference drivers: models of what a driver in the ego's place does, for verdicts on collisions and as planners.

``models`` describes each driver as a frozen dataclass that reacts to what it sees; ``paths`` shows a driver the others
along its way; ``drives`` moves a driver among recorded others; ``planner`` drives them in the loop.
"""
