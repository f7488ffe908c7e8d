"""The closed vocabularies of selection: tags, road-network keys, obstacle types and computed features.

Tags, keys and types come from the paper's selection module (Methodology, Scenario Selection). Features are our own.
"""

from typing import Final, Literal

TAGS: Final[dict[str, str]] = {
    "comfort": "smooth driving without harsh inputs",
    "critical": "requires an immediate reaction",
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
    "no_oncoming_traffic": "no vehicle comes from the opposite direction",
    "oncoming_traffic": "vehicles from the opposite direction",
    "parallel_lanes": "lanes side by side in the same direction",
    "race_track": "circuit",
    "roundabout": "circular junction",
    "rural": "countryside",
    "simulated": "created by a simulator",
    "single_lane": "one lane per direction or in all",
    "slip_road": "link to enter or leave a motorway",
    "speed_limit": "reaction to a posted limit",
    "traffic_jam": "dense, slow or standing traffic",
    "turn_left": "left turn",
    "turn_right": "right turn",
    "two_lane": "two lanes, usually one per direction",
    "urban": "built-up area",
}
ROAD_KINDS: Final = ("highway", "interstate", "slip_road", "roundabout", "intersection", "rural", "urban")
"""Tags for the kind of road, the most specific first. If there are several, the first one counts."""
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
    "intersection": "lanes cross within 100 m of the ego's start, or on its route",
    "roundabout": "lanes form a circle with several entries",
    "ramp": "one-way roads part or join at a small angle within 200 m of the ego's start, or on its route",
    "multi_lane": "two lanes or more in the ego's direction at its start",
    "single_lane": "one lane in the ego's direction at its start",
    "oncoming_traffic": "a recorded vehicle comes towards the ego's lane ahead of it",
    "ego_goes_straight": "the ego's route to its goal has no turn, no curve of over 40° and no lane change",
    "ego_turns_left": "the ego's route to its goal turns left",
    "ego_turns_right": "the ego's route to its goal turns right",
    "ego_turns_back": "the ego's route to its goal turns by over 150° at a junction or roundabout",
    "ego_changes_lane": "the ego's route to its goal needs a lane change",
    "lead_vehicle": "a vehicle is ahead of the ego in its lane within 50 m at the start",
    "ego_stands_at_start": "the ego's initial speed is below 0.5 m/s",
    "unprotected_left": "the ego's route turns left across oncoming lanes without a light that protects the turn",
    "cut_in": "a vehicle changes into the ego's lane within 3 s ahead of the ego",
    "cut_out": "a vehicle within 3 s ahead of the ego changes out of its lane",
    "merging": "a vehicle joins the ego's lane from a merging road or an ending lane, within 3 s ahead of the ego",
    "overtaking": "a vehicle catches up with another in its lane, moves next to it and passes it",
    "lead_brakes_hard": "a vehicle in the ego's lane, within 3 s ahead, brakes by over 3.4 m/s²",
    "crossing": "a road user crosses the ego's lane ahead of it",
    "oncoming_turns": "an oncoming vehicle turns across the ego's lane ahead of it",
}
MANOEUVRES: Final[tuple[str, ...]] = (
    *("cut_in", "cut_out", "merging", "overtaking", "lead_brakes_hard", "crossing", "oncoming_turns"),
)
"""Features that describe another road user's manoeuvre; ``cut_in:truck`` adds its type."""
CIRCUMSTANCES: Final[dict[str, str]] = {
    "night": "the time is between 22 and 6, or the file calls it night",
    "rush_hour": "the time is in an hour with 7% of a working day's cars or more: 7 to 8, 16 to 19",
    "light_rain": "the file's weather",
    "heavy_rain": "the file's weather",
    "fog": "the file's weather",
    "snow": "the file's weather",
    "hail": "the file's weather",
}
"""The time and weather of a scenario, from its file or from the request that generated it.

CommonRoad's schema has no tags for them. Use them as ``tags`` in a catalogue that contains such scenarios."""
MEASURES: Final[dict[str, str]] = {
    "ttc": "time to conflict: seconds until an ego that keeps path and initial speed meets the recorded traffic",
    "horizon": "seconds to the last time step of any recording or goal",
    "density": "recorded vehicles per kilometre of lanelets, mean over the recording",
}
"""Numbers computed from geometry and recording, compared in the ``features`` argument (``ttc<=3s``)."""
Origin = Literal["recorded", "simulated", "artificial"]
ORIGINS: Final[dict[Origin, str]] = {
    "recorded": "the traffic was observed, as its file's source says",
    "simulated": "a simulator moved the traffic: the file's tag or source says so",
    "artificial": "the roads are not a real place (country ZAM), or the file was written by hand",
}
"""The origin of a scenario. An artificial one may be simulated too."""
GoalForm = Literal["region", "lanelet", "speed", "orientation", "time"]
"""The content of a goal: a region (shape), a lanelet, a speed, a heading or only a time."""

EGO_CLASSES: Final = (
    *("car", "taxi", "delivery", "emergency", "truck", "bus", "coach", "motorcycle", "moped", "trailer"),
)
"""The possible classes of an ego: the motor vehicles among the classes of traffic (``engine/vehicles/models.py``)."""
LEAST_FRICTION, MOST_FRICTION = 0.05, 1.0
"""Valid coefficients of friction between tyres and road: the lowest value above 0 and the highest in Bosch's Automotive
Handbook, "Coefficients of static friction for pneumatic tires on various surfaces": tyres on 2 mm of water at 90 km/h,
and worn tyres on a dry road at 50 km/h."""
ROAD_FRICTIONS: Final[dict[str, float]] = {"dry": 0.85, "wet": 0.65, "heavy_rain": 0.55, "snow": 0.2, "ice": 0.1}
"""Coefficients of friction of roads: new tyres at 50 km/h in the same table (0.2 mm of water is wet, 1 mm is
heavy rain); snow is the lowest value in R. K. Noon, "Engineering Analysis of Vehicular Accidents" (1994): 0.20 to
0.25."""
WEATHER_ROADS: Final[dict[str, str]] = {"light_rain": "wet", "heavy_rain": "heavy_rain", "snow": "snow"}
"""The state of roads in each kind of weather. Fog does not change it, and no figure is known for hail."""
