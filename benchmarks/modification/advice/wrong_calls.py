"""Wrong calls of all tools except edits, by kind: each draws arguments with a fault."""

import random
from collections.abc import Callable, Sequence
from typing import Any

from .words import Arguments, Draw, misspelt, unknown_id
from .world import World

Value = Callable[[random.Random], Any]
"""Draws the value of an argument."""
_TAGS = ("intersection", "highway", "urban", "roundabout", "multi_lane", "lane_change", "speed_limit", "turn_left")
_CLASSES = ("truck", "bus", "motorcycle", "bicycle", "taxi", "trailer", "pedestrian", "car")
_METRICS = (
    "risk_score",
    "duration_s",
    "minimum_distance_m",
    "mean_speed_mps",
    "maximum_deceleration_mps2",
    "minimum_time_gap_s",
)
_WEIGHTS = ("jerk", "lateral_jerk", "acceleration", "prediction", "velocity_offset", "distance_to_obstacles")


def _misspelt_word(words: Sequence[str]) -> Value:
    """Return one of the words, misspelt."""
    return lambda rng: misspelt(rng.choice(words), rng)


def _many(words: Sequence[str]) -> Value:
    """Return a list of one of the words, misspelt."""
    return lambda rng: [misspelt(rng.choice(words), rng)]


def _any_of(*values: Any) -> Value:
    """Return one of the values."""
    return lambda rng: rng.choice(values)


def _list_of(*values: Any) -> Value:
    """Return a list of one of the values."""
    return lambda rng: [rng.choice(values)]


def _misspelt_id(name: str, *, listed: bool) -> Draw:
    """Return the id of a scenario, misspelt."""

    def draw(world: World, rng: random.Random) -> Arguments | None:
        word = misspelt(world.stage(rng).scenario_id, rng)
        return {name: [word] if listed else word}

    return draw


def _scenario(tool: str, **values: Any) -> Draw:
    """Return a call about a scenario."""
    name = {"run_planner": "scenarios", "render": "ids", "export_artifacts": "ids"}.get(tool, "scenario_id")

    def draw(world: World, rng: random.Random) -> Arguments | None:
        drawn = {key: value(rng) if callable(value) else value for key, value in values.items()}
        scenario_id = world.stage(rng).scenario_id
        return {name: scenario_id if name == "scenario_id" else [scenario_id], **drawn}

    return draw


def _plain(**values: Any) -> Draw:
    """Return a call of drawn values."""
    return lambda _world, rng: {key: value(rng) if callable(value) else value for key, value in values.items()}


def wrong_calls() -> list[tuple[str, str, Draw]]:
    """Return tool, kind of fault, and the draw of faulty arguments."""
    pick = random.Random.choice
    return [
        (
            "describe_catalog",
            "facet",
            _plain(facet=_misspelt_word(["tags", "features", "obstacles", "places", "planners"])),
        ),
        ("describe_catalog", "facet_unknown", _plain(facet=_any_of("weather", "everything", "vehicles"))),
        (
            "describe_catalog",
            "within",
            _plain(facet="tags", within=_any_of("search_0123456789ab", "Atlantis", "Germny")),
        ),
        ("describe_catalog", "offset", _plain(offset=_any_of(-1, -20, "x"))),
        (
            "generate_scenarios",
            "place",
            _plain(place=_misspelt_word(["Musterstadt", "Fahrhausen", "Kreiselheim", "Quadratstadt"])),
        ),
        ("generate_scenarios", "place_fictitious", _plain(place=_any_of("Atlantis", "Gotham City", "Mordor"))),
        (
            "generate_scenarios",
            "type",
            _plain(place="Musterstadt", scenario_type=_misspelt_word(["intersection", "roundabout", "urban"])),
        ),
        (
            "generate_scenarios",
            "type_absent",
            _plain(place=_any_of("Landmoor", "Quadratstadt", "Kreiselheim"), scenario_type=_any_of("highway", "ramp")),
        ),
        (
            "generate_scenarios",
            "class",
            _plain(place="Musterstadt", vehicles=lambda rng: [f"{misspelt(pick(rng, _CLASSES), rng)}=2"]),
        ),
        (
            "generate_scenarios",
            "count_malformed",
            _plain(place="Musterstadt", vehicles=_list_of("truck=many", "bus=5..2", "car=-3", "truck=140%")),
        ),
        ("generate_scenarios", "range", _plain(place="Musterstadt", duration_s=_any_of(1, 500, -3))),
        ("generate_scenarios", "density", _plain(place="Musterstadt", density=_any_of("hihg", "insane", "lowest"))),
        (
            "generate_scenarios",
            "goal",
            _plain(
                place="Musterstadt",
                duration_s=8,
                goal=_any_of("through:up", "distance_m:far", "lanelet:999999:middle", "to the station"),
            ),
        ),
        (
            "generate_scenarios",
            "ego",
            _plain(place="Musterstadt", duration_s=8, ego=_any_of("index:900", "type:tank", "type:trcuk", "last")),
        ),
        (
            "generate_scenarios",
            "bbox",
            _plain(bbox=_any_of([48.2, 11.5, 48.1, 11.6], [1, 2, 3], [0.0, 0.0, 0.01, 0.01])),
        ),
        ("generate_scenarios", "country", _plain(place="Musterstadt", country=_any_of("GRM", "Germny", "FRA"))),
        (
            "generate_scenarios",
            "road_classes",
            _plain(place="Musterstadt", road_classes=_many(["residential", "secondary", "motorway"])),
        ),
        (
            "generate_scenarios",
            "conditions",
            _plain(
                place="Musterstadt",
                duration_s=8,
                conditions=_list_of("weather=hail", "wether=rain", "time=25:90", "drivers=drunk", "mix=odd"),
            ),
        ),
        (
            "generate_scenarios",
            "cover",
            _plain(
                place="Musterstadt",
                cover=_list_of("densty=low|high", "density=low|extreme", "turn=up"),
                count=2,
                duration_s=8,
            ),
        ),
        ("find_scenarios", "tag", _plain(tags=_many(_TAGS))),
        ("find_scenarios", "feature", _plain(features=_many(["ramp", "ego_turns_left", "cut_in", "roundabout"]))),
        ("find_scenarios", "road_net", _plain(road_net=_many(["stop", "yield", "traffic_light", "lanes>=2"]))),
        (
            "find_scenarios",
            "road_net_malformed",
            _plain(road_net=_list_of("lanes>=many", "speed_limit=50", "speed_limit=fast", "lanes=5..2")),
        ),
        ("find_scenarios", "obstacle", _plain(obstacles=_many(["truck", "motorcycle", "pedestrian", "bicycle"]))),
        ("find_scenarios", "obstacle_malformed", _plain(obstacles=_list_of("car=many", "car=5..2", "car>=1.5", "=2"))),
        ("find_scenarios", "speed", _plain(ego_speed=_any_of("fast", "50 knots", "20..10m/s", "60km"))),
        ("find_scenarios", "country", _plain(country=_any_of("GRM", "Germny", "XYZ"))),
        ("find_scenarios", "city", _plain(city=_misspelt_word(["Musterstadt", "Fahrhausen"]))),
        ("find_scenarios", "like", _plain(like=_any_of("ZAM_Nothing-9_9_T-9", "scenario_1"))),
        ("find_scenarios", "within", lambda _world, rng: {"within": unknown_id("search", rng), "tags": ["urban"]}),
        ("find_scenarios", "limit", _plain(limit=_any_of(0, 500, "many"))),
        ("find_scenarios", "method", _plain(text="merge", method=_any_of("vector", "bm52", "funel"))),
        ("find_scenarios", "argument", _plain(tag=_any_of("urban"), citys="x")),
        ("import_files", "missing_file", lambda world, rng: {"path": misspelt(str(rng.choice(world.files)), rng)}),
        ("import_files", "outside", _plain(path=_any_of("/etc/passwd", "/root", "../../secret.xml"))),
        (
            "import_files",
            "kind",
            lambda world, rng: {"path": str(rng.choice(world.files)), "kind": _any_of("scenarios", "osm", "mpa")(rng)},
        ),
        (
            "import_files",
            "wrong_kind",
            lambda world, rng: {"path": str(rng.choice(world.files)), "kind": _any_of("map", "config")(rng)},
        ),
        ("describe_scenario", "id", _misspelt_id("scenario_id", listed=False)),
        (
            "describe_scenario",
            "detail",
            _scenario("describe_scenario", detail=_misspelt_word(["vehicles", "lanelets", "checks", "motion"])),
        ),
        (
            "describe_scenario",
            "focus",
            _scenario("describe_scenario", focus=_any_of("nearest:many", "99999", "class:unicorn", "leed", "lanelet")),
        ),
        ("describe_scenario", "radius", _scenario("describe_scenario", radius_m=_any_of(0, -5, 99999))),
        ("describe_scenario", "time", _scenario("describe_scenario", detail="vehicles", time_s=_any_of(500, 9999))),
        (
            "describe_scenario",
            "problem",
            lambda world, rng: {"scenario_id": f"{world.stage(rng).scenario_id}#{rng.randrange(70000, 80000)}"},
        ),
        (
            "modify_scenario",
            "id",
            lambda world, rng: {
                "scenario_id": misspelt(world.stage(rng).scenario_id, rng),
                "edits": [{"op": "set_weather", "params": ["weather=rain"]}],
            },
        ),
        ("modify_scenario", "edits_empty", _scenario("modify_scenario", edits=[])),
        (
            "list_planners",
            "planner",
            _plain(planner=_misspelt_word(["frenetix", "keep_lane", "mp_rbfn", "full_braking"])),
        ),
        (
            "list_planners",
            "config",
            lambda world, rng: {
                "config_id": _any_of(unknown_id("cfg", rng), misspelt(world.configs[0], rng), "frenetix:Sport")(rng)
            },
        ),
        (
            "configure_planner",
            "preset",
            _plain(preset=_misspelt_word(["Comfort", "Balanced", "Default", "Efficiency-Sporty"])),
        ),
        ("configure_planner", "preset_unknown", _plain(preset=_any_of("Turbo", "Luxury", "Race"))),
        ("configure_planner", "weight", _plain(weights=lambda rng: [f"{misspelt(pick(rng, _WEIGHTS), rng)}=0.5"])),
        (
            "configure_planner",
            "weight_value",
            _plain(weights=_list_of("jerk=-1", "jerk=nan", "jerk=high", "acceleration", "prediction=1e9")),
        ),
        (
            "configure_planner",
            "base",
            _plain(base=_any_of("cfg_0123456789ab", "frenetix:Fast", "frentix"), weights=["jerk=0.3"]),
        ),
        ("configure_planner", "planner", _plain(planner=_misspelt_word(["frenetix", "mp_rbfn"]), weights=["jerk=0.3"])),
        ("run_planner", "scenario", _misspelt_id("scenarios", listed=True)),
        (
            "run_planner",
            "config",
            _scenario(
                "run_planner",
                configs=_list_of("frenetix:Sportive", "frentix", "cfg_0123456789ab", "idm:Default2", "keeplane"),
            ),
        ),
        (
            "run_planner",
            "prediction",
            _scenario("run_planner", configs=["idm"], prediction=_any_of("oracle", "constant_velocty", "lanes")),
        ),
        (
            "run_planner",
            "problem",
            lambda world, rng: {
                "scenarios": [f"{world.stage(rng).scenario_id}#{rng.randrange(70000, 80000)}"],
                "configs": ["idm"],
            },
        ),
        (
            "run_planner",
            "preset_size",
            _plain(scenarios=_list_of("preset:0", "preset:many", "preset:9000"), configs=["idm"]),
        ),
        ("run_planner", "wait", _scenario("run_planner", configs=["idm"], wait_s=_any_of(90, -1, "long"))),
        ("run_planner", "search", lambda _world, rng: {"scenarios": [unknown_id("search", rng)], "configs": ["idm"]}),
        ("get_job", "id", lambda _world, rng: {"job_id": unknown_id("job", rng)}),
        ("get_job", "wait", _plain(wait_s=_any_of(51, 600, -2))),
        ("cancel_job", "id", lambda _world, rng: {"job_id": unknown_id("job", rng)}),
        (
            "analyze_results",
            "id",
            lambda _world, rng: {"results": [_any_of(unknown_id("run", rng), unknown_id("batch", rng))(rng)]},
        ),
        ("analyze_results", "scenario", lambda world, rng: {"results": [world.stage(rng).scenario_id]}),
        (
            "analyze_results",
            "where",
            _plain(
                results=["latest_batch"],
                where=_list_of("outcome=crash", "outcom=collision", "config", "country=Mars", "time_s=4..2"),
            ),
        ),
        (
            "analyze_results",
            "detail",
            _plain(results=["latest_batch"], detail=_any_of("sumary", "timelines", "everything")),
        ),
        (
            "analyze_results",
            "breakdown",
            _plain(results=["latest_batch"], breakdown=_any_of("planers", "weather", "class")),
        ),
        ("analyze_results", "timeline_of_batch", _plain(results=["latest_batch"], detail="timeline")),
        ("compare_results", "id", lambda world, rng: {"results": [world.batches[0], unknown_id("batch", rng)]}),
        ("compare_results", "metric", _plain(results=["latest_batch"], metrics=_many(_METRICS))),
        ("compare_results", "one_side", lambda world, rng: {"results": [rng.choice(world.runs)]}),
        ("compare_results", "limit", _plain(results=["latest_batch"], limit=_any_of(0, 1000))),
        ("render", "id", _misspelt_id("ids", listed=True)),
        ("render", "kind", _scenario("render", kind=_any_of("photo", "animaton", "picure", "gif"))),
        (
            "render",
            "unsuitable",
            _scenario("render", kind=_any_of("outcomes", "flips", "costs", "search", "profile", "terms")),
        ),
        ("render", "time", _scenario("render", time_s=_any_of(1e6, 900, -1))),
        ("list_artifacts", "kind", _plain(kind=_any_of("scenarios", "batchs", "plans", "vehicle"))),
        ("list_artifacts", "limit", _plain(limit=_any_of(0, 1000), offset=_any_of(-1, 0))),
        ("list_artifacts", "parent", _plain(parent=_any_of("cfg_0123456789ab", "nothing"))),
        (
            "export_artifacts",
            "id",
            lambda world, rng: {
                "ids": [misspelt(world.stage(rng).scenario_id, rng)],
                "folder": f"out{rng.randrange(10**6)}",
            },
        ),
        ("export_artifacts", "outside", _scenario("export_artifacts", folder=_any_of("/etc", "/root/x"))),
        (
            "export_artifacts",
            "format",
            _scenario(
                "export_artifacts", folder="out", formats=_any_of(["yaml"], ["solution"], ["xmll"], ["pdf"], ["csv"])
            ),
        ),
        ("export_artifacts", "missing", _plain(folder="out")),
        (
            "optimize_planner",
            "objective",
            _scenario_list(objective=_many(["success", "collisions", "risk", "comfort"])),
        ),
        (
            "optimize_planner",
            "constraint",
            _scenario_list(constraints=_list_of("success>=best", "colisions<=0.1", "comfort")),
        ),
        ("optimize_planner", "vary", _scenario_list(vary=_list_of("prediktion", "jerk=5..1", "horizon_s=1..90"))),
        ("optimize_planner", "trials", _scenario_list(max_trials=_any_of(0, 10**6))),
    ]


def _scenario_list(**values: Any) -> Draw:
    def draw(world: World, rng: random.Random) -> Arguments | None:
        drawn = {key: value(rng) if callable(value) else value for key, value in values.items()}
        ids = [stage.scenario_id for stage in world.stages if stage.file.ego is not None][:2]
        return {"base": "idm", "scenarios": ids, "max_trials": 2, **drawn}

    return draw
