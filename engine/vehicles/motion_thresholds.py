"""Thresholds of motion that affect results, each defined once with its source or reason.

If a term has two values, there are two constants with different names.
"""

STANDING_MPS = 0.1
"""A slower road user stands: SUMO counts a vehicle as waiting below this speed, and CommonRoad's own monitor of traffic
rules considers it standing.
"""
TIME_GAP_MPS = 0.5
"""A slower follower has no time gap (chosen): 10 m would be 20 s, as long as a usual scenario. The gap is then given in
metres. Searches count an ego that starts at a lower speed as standing.
"""
HEADING_MPS = 0.5
"""The recorded heading of a slower vehicle does not count for matching it to a lane (chosen): vehicles at rest are
recorded with any heading.
"""
REST_OF_SMOOTHING_MPS = 0.02
"""Speeds below this are written as 0 (chosen): smoothing leaves this residue in a standing vehicle, 2 mm per step."""
ARC_LENGTH_MPS = 1e-3
"""Below this speed, derivatives by arc length are not computed, since they divide by the speed."""

CUT_IN_REACTION_S = 0.35
"""Reaction time until a vehicle that is cut in on must brake: UN Regulation 157 (automated lane keeping), 5.2.5.2."""
MONITOR_REACTION_S = 0.4
"""Reaction time in the safe distance of CommonRoad's own monitor of traffic rules."""
HARD_BRAKING_REACTION_S = 0.5
"""The least time after which a driver brakes hard: chosen, so that only what no driver can do is refused. It is below
the 0.70 to 0.75 s of drivers that are fully aware of the time and place of the signal (M. Green, How Long Does It Take
to Stop?, Transportation Human Factors 2(3), 2000, abstract).
"""
HAND_OVER_S = 4.0
"""How long before a collision SUMO drives a vehicle that is handed over (chosen): time to brake gently. From 50 km/h to
a standstill that is 3.5 m/s².
"""
