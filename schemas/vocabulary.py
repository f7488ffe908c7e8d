"""The closed vocabularies of selection: tags, road-network keys, obstacle types and computed features.

Tags, keys and types are those of the paper's selection module (Methodology, Scenario Selection); features are ours.
"""

from typing import Final, Literal

TAGS: Final[dict[str, str]] = {
    "comfort": "smooth driving without harsh inputs",
    "critical": "needs an immediate reaction",
    "emergency_braking": "hard, sudden braking",
    "evasive": "swerving to avoid an obstacle",
    "highway": "high-speed road without crossings",
    "illegal_cut_in": "another vehicle enters the lane unlawfully",
    "intersection": "roads cross",
    "interstate": "long-distance motorway",
    "lane_change": "a vehicle moves to another lane",
    "lane_following": "a vehicle keeps its lane",
    "merging_lanes": "lanes join into one",
    "multi_lane": "several lanes in the same direction",
    "no_oncoming_traffic": "nobody comes from the opposite direction",
    "oncoming_traffic": "vehicles from the opposite direction",
    "parallel_lanes": "lanes side by side in the same direction",
    "race_track": "circuit",
    "roundabout": "circular junction",
    "rural": "countryside",
    "simulated": "made by a simulator",
    "single_lane": "one lane per direction or in all",
    "slip_road": "link to enter or leave a motorway",
    "speed_limit": "reaction to a posted limit",
    "traffic_jam": "dense, slow or standing traffic",
    "turn_left": "left turn",
    "turn_right": "right turn",
    "two_lane": "two lanes, usually one per direction",
    "urban": "built-up area",
}
SIGNS: Final[dict[str, str]] = {
    "right_before_left_rule": "give way to the right",
    "yield": "give way",
    "stop": "full stop",
    "right_of_way": "priority at this crossing",
    "priority_road": "priority along this road",
    "speed_limit": "maximum speed",
    "required_speed": "minimum speed",
    "no_overtaking": "overtaking forbidden",
    "green_arrow_sign": "turn on red after yielding",
    "town_sign": "start or end of a town",
    "ban_on_motorcycles_and_multilane_vehicles": "closed to motorcycles and multi-track vehicles",
    "no_u_turn": "turning round forbidden",
    "turning_priority_left": "the priority road bends left",
    "turning_priority_right": "the priority road bends right",
    "turning_priority_wait": "the bending priority road comes first",
}
ROAD_NET_KEYS: Final[dict[str, str]] = {
    **SIGNS,
    "traffic_light": "at least one light",
    "lanes": "lanelets side by side in the ego's direction",
}
OBSTACLE_TYPES: Final[tuple[str, ...]] = (
    "car",
    "truck",
    "bus",
    "motorcycle",
    "bicycle",
    "pedestrian",
    "priorityVehicle",
    "parkedVehicle",
    "train",
    "taxi",
    "constructionZone",
    "roadBoundary",
    "unknown",
)
FEATURES: Final[dict[str, str]] = {
    "intersection": "lanes cross within 100 m of the ego's start, or on its way",
    "roundabout": "lanes form a circle with several entries",
    "ramp": "one-way roads part or join at a small angle within 200 m of the ego's start, or on its way",
    "multi_lane": "two lanes or more in the ego's direction at its start",
    "single_lane": "one lane in the ego's direction at its start",
    "oncoming_traffic": "a recorded vehicle comes towards the ego's lane ahead of it",
    "ego_goes_straight": "the ego's way to its goal has no turn and no lane change",
    "ego_turns_left": "the ego's way to its goal turns left",
    "ego_turns_right": "the ego's way to its goal turns right",
    "ego_changes_lane": "the ego's way to its goal needs a lane change",
    "lead_vehicle": "a vehicle is ahead of the ego in its lane within 50 m at the start",
    "ego_stands_at_start": "the ego's initial speed is below 0.5 m/s",
}
MEASURES: Final[dict[str, str]] = {
    "ttc": "seconds until an ego that keeps path and initial speed meets the recorded traffic",
    "horizon": "seconds to the last time step of any recording or goal",
    "density": "recorded vehicles per kilometre of lanelets, mean over the recording",
}
"""Numbers computed from geometry and recording, compared in the ``features`` argument (``ttc<=3s``)."""
GoalForm = Literal["region", "lanelet", "speed", "orientation", "time"]
"""What a goal states: a region (shape), a lanelet, a speed, a heading or only a time."""
