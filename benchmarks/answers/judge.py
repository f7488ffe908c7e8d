"""Checks the fields of an answer against the files, and its text against the fields.

A rule reads fields of an answer, such as a count, a speed, a distance, a time, the parties of a collision or what
stayed unchanged, and compares each with what ``files`` reads. Contradictions are fields that exclude each other, an id
in the fields that the text lacks, and a figure of the text that no field holds (``stated_figures``). No rule depends on
the wording.
"""

import itertools
import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import shapely

from plannerforge.evals.scoring.files import Body, SceneFile, StoredRun, World

from ..stated_figures import agrees, figures_in, unknown_in_text

_SLACK_M = 0.75
"""Distance that a body's centre may be outside its lanelet, as in the matching to lanes (chosen)."""
_ARTIFACT = re.compile(r"\b(?:run|cfg|batch|search)_[0-9a-f]{12}\b")
Fields = Mapping[str, Any]


@dataclass(frozen=True)
class GivenAnswer:
    """An answer as a client has it; ``asked``: the arguments of the call."""

    tool: str
    asked: Mapping[str, Any]
    text: str
    structured: Fields
    is_error: bool


@dataclass
class Verdict:
    """The result for one answer: the number of compared statements, the false ones, and unknown figures of its text."""

    compared: int = 0
    false_statements: list[str] = field(default_factory=list)
    contradictions: list[str] = field(default_factory=list)
    unknown_figures: list[str] = field(default_factory=list)

    def holds(self, statement: str, true: bool, found: object = "") -> None:
        """Count a statement, and keep it with the files' content if it is false."""
        self.compared += 1
        if not true:
            self.false_statements.append(f"{statement} (the files: {found})")

    def close(self, statement: str, told: float | None, found: float, slack: float = 1e-3) -> None:
        """Count a figure, and keep it if it differs from the files."""
        self.holds(f"{statement} {told}", told is not None and abs(told - found) <= slack, found)

    def excludes(self, words: str) -> None:
        """Note two statements that cannot both be true."""
        self.contradictions.append(words)


def judge(told: GivenAnswer, world: World) -> Verdict:
    """Compare all statements of an answer that a rule reads."""
    verdict = Verdict()
    for artifact in sorted(set(_ARTIFACT.findall(told.text))):
        verdict.holds(f"there is {artifact}", world.kind_of(artifact) is not None, "no such artifact")
    if told.is_error:
        return verdict
    _RULES.get(told.tool, _nothing)(told, world, verdict)
    _against_itself(told, verdict)
    verdict.unknown_figures += unknown_in_text(told.text, told.structured, told.asked)
    return verdict


def _nothing(told: GivenAnswer, world: World, verdict: Verdict) -> None:
    del told, world, verdict


# Scenarios


def _description(told: GivenAnswer, world: World, verdict: Verdict) -> None:
    scene, description = world.scene(told.structured["scenario_id"]), told.structured["description"]
    verdict.holds("the scenario is there", scene is not None)
    if scene is None:
        return
    for kind, count in told.structured["counts"].items():
        verdict.holds(f"{count} {kind}", scene.counts[kind] == count, scene.counts[kind])
    total, listed = sum(scene.counts.values()), sum(told.structured["counts"].values())
    verdict.holds(f"{listed} road users", listed == total, total)
    verdict.close("step", told.structured["step_s"], scene.step_s, 1e-9)
    if description["ego"] is not None and scene.problems:
        _ego(description["ego"], scene, verdict)
        _vehicles(description, scene, verdict)


def _ego(told: Fields, scene: SceneFile, verdict: Verdict) -> None:
    problem = scene.problems[0]
    start = problem.start
    verdict.close("speed of the ego", told["speed_mps"], start.speed)
    under, named = scene.under(start.x, start.y, 0.3), set(told["lanelets"])
    verdict.holds(f"ego on lanelets {named}", named <= under, sorted(under))
    lanes = {scene.count_parallel_lanes(key) for key in named & set(scene.lanelets)} or {0}
    verdict.holds(f"{told['lanes']} lanes", told["lanes"] in lanes, sorted(lanes))
    if len(problem.goals) != 1:
        return
    goal = problem.goals[0]
    window = [(step - start.step) * scene.step_s for step in (goal.first_step, goal.last_step)]
    for name, found in zip(("goal_from_s", "goal_until_s"), window, strict=True):
        verdict.close(name, told[name], found)
    if goal.areas and told["goal_distance_m"] is not None:
        middle = goal.areas[0].centroid
        verdict.close(
            "distance to the goal", told["goal_distance_m"], _apart((start.x, start.y), middle.coords[0]), 0.3
        )
        for key in told["goal_lanelets"]:
            verdict.holds(f"goal on lanelet {key}", _is_near(scene, key, middle))


def _apart(one: Sequence[float], other: Sequence[float]) -> float:
    return math.dist((one[0], one[1]), (other[0], other[1]))


def _is_near(scene: SceneFile, key: int, shape: Any, slack: float = _SLACK_M) -> bool:
    """Return True if a shape is on a lanelet or within the slack of it."""
    lane = scene.lanelets.get(key)
    return lane is not None and lane.polygon.distance(shape) <= slack


def _vehicles(told: Fields, scene: SceneFile, verdict: Verdict) -> None:
    start = scene.problems[0].start
    ego, asked = Body(start.x, start.y, start.heading, start.speed, 4.508, 1.61), told["asked"] or {}
    focus = None
    if asked.get("vehicle") is not None:
        focus = _focus(asked, scene, start.step, verdict)
        _vehicle(asked["vehicle"], scene, ego, None, verdict)
    for vehicle in told["vehicles"]:
        _vehicle(vehicle, scene, ego, focus or ego, verdict)
    middle, away = focus or ego, list[float]()
    for vehicle in told["vehicles"]:
        body = scene.present(start.step).get(vehicle["vehicle_id"])
        away += [_apart((body.x, body.y), (middle.x, middle.y))] if body is not None else []
    in_order = all(one <= other + 3.0 for one, other in itertools.pairwise(away))
    verdict.holds("nearest first", in_order, [round(value, 1) for value in away])
    total = sum(scene.counts.values()) - (focus is not None)
    verdict.holds(f"{told['vehicles_total']} vehicles", told["vehicles_total"] == total, total)


def _focus(asked: Fields, scene: SceneFile, step: int, verdict: Verdict) -> Body | None:
    """Return the vehicle that the description is about."""
    user = scene.users.get(asked["vehicle"]["vehicle_id"])
    verdict.holds(f"there is a vehicle {asked['vehicle']['vehicle_id']}", user is not None)
    if user is None:
        return None
    for key in asked["route"]:
        near = any(_is_near(scene, key, _point(state.x, state.y)) for state in user.states.values())
        verdict.holds(f"vehicle {user.key} is recorded on lanelet {key}", near)
    return user.at(min(user.states) if step not in user.states and not user.is_static else step)


def _point(x: float, y: float) -> Any:
    return shapely.Point(x, y)


def _vehicle(told: Fields, scene: SceneFile, ego: Body, middle: Body | None, verdict: Verdict) -> None:
    """Check class, distance, speed, gap and lanelet of a vehicle when the ego starts."""
    key, user = told["vehicle_id"], scene.users.get(told["vehicle_id"])
    verdict.holds(f"{key} is a {told['kind']}", user is not None and user.kind == told["kind"], user and user.kind)
    start = scene.problems[0].start.step
    if user is None or not (user.is_static or start in user.states):
        return
    body = user.at(start)
    if body is None:
        return
    if middle is not None:
        away = _apart((body.x, body.y), (middle.x, middle.y))
        verdict.close(f"{key}: distance", told["distance_m"], away, 0.06)
    speed = user.states[start].speed if start in user.states else 0.0
    verdict.close(f"{key}: speed", told["speed_mps"], speed)
    if told["lanelet"] is not None:
        verdict.holds(f"{key} on lanelet {told['lanelet']}", _is_near(scene, told["lanelet"], body.polygon, 0.3))
    away, along = _apart((body.x, body.y), (ego.x, ego.y)), ego.local(body.x, body.y)[0]
    if told["ahead_m"] is not None:
        lane_m = min((abs(ahead) for ahead in _along_lanes(scene, ego, body)), default=away)
        fits = min(abs(along), away, lane_m) - 1.0 <= abs(told["ahead_m"]) <= 1.6 * away + 3.0
        verdict.holds(f"{key}: {told['ahead_m']} m ahead", fits, f"{away:.1f} m, {along:.1f} m along")
        if 2.0 < abs(told["ahead_m"]) < 40.0:
            same_way = along > -2.0 if told["ahead_m"] > 0 else along < 2.0
            verdict.holds(f"{key} ahead or behind", same_way, f"{along:.1f} m along")
    if told["gap_m"] is not None:
        gap = ego.gap_to(body)
        verdict.holds(f"{key}: gap {told['gap_m']} m", gap - 1.5 <= told["gap_m"] <= 1.6 * gap + 4.0, gap)


def _along_lanes(scene: SceneFile, ego: Body, body: Body) -> Iterator[float]:
    """Return the distance of a body ahead of the ego along the centre of each lanelet under the ego."""
    for key in scene.under(ego.x, ego.y, 0.3):
        centre = scene.lanelets[key].centre
        yield centre.project(_point(body.x, body.y)) - centre.project(_point(ego.x, ego.y))


def _generation(told: GivenAnswer, world: World, verdict: Verdict) -> None:
    for made in told.structured["scenarios"]:
        scene = world.scene(str(made["scenario_id"]))
        verdict.holds(f"{made['scenario_id']} is there", scene is not None)
        if scene is None:
            continue
        real, classes = sum(scene.counts.values()) + 1, made["classes_realised"]
        on_foot = classes.get("pedestrian", 0)
        verdict.holds(f"{made['vehicles_realised']} vehicles", made["vehicles_realised"] + on_foot == real, real)
        verdict.holds(f"{classes} add up", 1 + sum(classes.values()) == real, real)
        problem = scene.problems[0]
        verdict.close("speed of the ego", made["ego_speed_mps"], problem.start.speed)
        goal = problem.goals[0]
        window = [(step - problem.start.step) * scene.step_s for step in (goal.first_step, goal.last_step)]
        for name, value, found in zip(("first", "last"), made["goal_time_s"], window, strict=True):
            verdict.close(f"{name} time of the goal", value, found, scene.step_s / 2)
        if goal.areas:
            centre = goal.areas[0].centroid
            verdict.holds(f"goal on {made['goal_lanelet']}", _is_near(scene, made["goal_lanelet"], centre))
            straight = _apart((problem.start.x, problem.start.y), centre.coords[0])
            ahead = made["goal_distance_m"]
            verdict.holds(f"goal {ahead} m ahead", straight - 1.0 <= ahead <= 3.0 * straight + 50.0, straight)


# Edits


def _edit(told: GivenAnswer, world: World, verdict: Verdict) -> None:
    fields = told.structured
    if fields["scenario_id"] is None:
        return
    scene, base = world.scene(fields["scenario_id"]), world.scene(fields["base_id"])
    verdict.holds(f"{fields['scenario_id']} is there", scene is not None and base is not None)
    if scene is None or base is None:
        return
    same = sum(base.texts.get(key) == text for key, text in scene.texts.items())
    verdict.holds(f"{fields['untouched']} as recorded", fields["untouched"] == same, same)
    gone = sorted(base.users.keys() - scene.users.keys())
    verdict.holds(f"removed {fields['removed']}", sorted(fields["removed"]) == gone, gone)
    added = sorted(scene.users.keys() - base.users.keys())
    told_added = sorted(one["vehicle_id"] for one in fields["touched"] if one["cause"] == "added")
    verdict.holds(f"added {told_added}", told_added == added, added)
    for one in fields["touched"]:
        user = scene.users.get(one["vehicle_id"])
        changed = user is not None and base.texts.get(user.key) != scene.texts.get(user.key)
        verdict.holds(f"{one['vehicle_id']} is touched", changed)
    for report in fields["edits"]:
        for route in report["routes"]:
            _route(route, scene, verdict)
    for asked, report in zip(told.asked.get("edits", ()), fields["edits"], strict=False):
        _check_nearest(asked, report, base, verdict)
    for when in ("ego_before", "ego_after"):
        danger = fields[when]
        if danger is not None and danger["risk_score"] is not None and not danger["left_out"]:
            hit = danger["minimum_distance_m"] == 0
            if hit != (danger["risk_score"] == 0):
                verdict.excludes(f"{when}: risk score {danger['risk_score']} and {danger['minimum_distance_m']} m")


def _route(told: Fields, scene: SceneFile, verdict: Verdict) -> None:
    """Return the route of a touched vehicle: these lanelets, or the first of them if it does not arrive."""
    user = scene.users.get(told["vehicle_id"])
    if user is None:
        return
    for key in told["lanelets"][: 1 if told["arrives"] is False else None]:
        near = any(_is_near(scene, key, _point(state.x, state.y)) for state in user.states.values())
        verdict.holds(f"{user.key} drives on lanelet {key}", near)
    if told["arrives"] is False and not told["reason"]:
        verdict.excludes(f"{user.key} does not arrive, without a reason")


def _check_nearest(asked: Fields, report: Fields, base: SceneFile, verdict: Verdict) -> None:
    """Return the vehicles of ``nearest:N``: the N nearest moving ones, centre to centre, when the ego starts."""
    selectors = asked.get("vehicles", ())
    found = re.fullmatch(r"nearest:(\d+)", selectors[0]) if len(selectors) == 1 else None
    if found is None or not base.problems:
        return
    start = base.problems[0].start
    away = {
        key: _apart((body.x, body.y), (start.x, start.y))
        for key, body in base.present(start.step).items()
        if not base.users[key].is_static
    }
    nearest = sorted(away, key=away.__getitem__)[: int(found[1])]
    verdict.holds(f"{selectors[0]} are {report['vehicles']}", set(report["vehicles"]) == set(nearest), nearest)


# Runs


def _runs(told: GivenAnswer, world: World, verdict: Verdict) -> None:
    fields = told.structured
    rows = [*fields.get("runs", ()), *fields.get("failures", ())] if told.tool == "run_planner" else fields["rows"]
    for row in rows:
        run = world.run(row["run_id"])
        if run is not None:
            _outcome(row, run, world, verdict)
            review = row.get("review") or (fields.get("review") if len(rows) == 1 else None)
            if review is not None:
                _moments(review, run, world, verdict)
    run = world.run(rows[0]["run_id"]) if len(rows) == 1 else None
    if run is not None:
        _figures(fields, run, world, verdict)


def _outcome(row: Fields, run: StoredRun, world: World, verdict: Verdict) -> None:
    scene = world.scene(run.scenario_id)
    if scene is None:
        return
    verdict.holds(f"{row['run_id']} on {row['scenario_id']}", row["scenario_id"] == run.scenario_id, run.scenario_id)
    verdict.holds(f"outcome {row['outcome']}", row["outcome"] == run.outcome, run.outcome)
    if row["outcome"] == "goal_reached":
        verdict.holds("the goal is reached", _reaches(run, scene), "not in the goal")
    if row["duration_s"] is not None:
        verdict.close("duration", row["duration_s"], (run.last_step - run.first_step) * run.step_s)


def _reaches(run: StoredRun, scene: SceneFile) -> bool:
    """Return True if the last state is in a goal of the problem, within its time."""
    problem = next((one for one in scene.problems if one.key == run.record["problem_id"]), None)
    ego = run.ego_at(run.last_step)
    if problem is None or ego is None:
        return False
    spot = _point(ego.x, ego.y)
    for goal in problem.goals:
        places = [*goal.areas, *(scene.lanelets[key].polygon for key in goal.lanelets if key in scene.lanelets)]
        inside = not places or any(place.distance(spot) <= 1e-6 for place in places)
        if inside and goal.first_step <= run.last_step <= goal.last_step:
            return True
    return False


def _moments(review: Fields, run: StoredRun, world: World, verdict: Verdict) -> None:
    """Check how a run collided, its closest approach, and its largest motions."""
    contact, closest = review["contact"], review["closest"]
    if contact is not None and contact["obstacle_id"] is not None:
        ego, other = _ego_and_other(run, world, contact)
        gap = math.nan if ego is None or other is None else ego.gap_to(other[1])
        verdict.holds(f"touches {contact['obstacle_id']} at {contact['time_s']} s", gap <= 0.05, gap)
        if ego is not None and other is not None:
            verdict.close("speed of the ego at the collision", contact["ego_speed_mps"], ego.speed)
            if contact["other_speed_mps"] is not None:
                verdict.close("speed of the other then", abs(contact["other_speed_mps"]), abs(other[1].speed))
            verdict.holds(f"hit a {contact['obstacle_class']}", other[0] == contact["obstacle_class"], other[0])
    if closest is not None:
        least = min(_gaps(run, world), default=math.nan)
        verdict.close("closest", closest["gap_m"], least, 0.02)
        ego, other = _ego_and_other(run, world, closest)
        there = ego is not None and other is not None and abs(ego.gap_to(other[1]) - least) < 0.02
        verdict.holds(f"to {closest['obstacle_id']} at {closest['time_s']} s", there, least)
        if ego is not None and other is not None:
            verdict.close("speed of the ego then", closest["ego_speed_mps"], ego.speed)
            verdict.close("speed of the other then", abs(closest["other_speed_mps"]), abs(other[1].speed))
    accelerations = run.series("acceleration_mps2")
    for largest in review["largest"]:
        sign = {"acceleration": 1, "braking": -1}.get(largest["name"])
        if sign is not None and len(accelerations) > 1:
            values = sign * accelerations[1:]
            verdict.close(f"largest {largest['name']}", largest["value"], float(values.max()))
            at = float(sign * accelerations[round(largest["time_s"] / run.step_s)])
            verdict.close(f"{largest['name']} at {largest['time_s']} s", largest["value"], at)


def _ego_and_other(run: StoredRun, world: World, moment: Fields) -> tuple[Body | None, tuple[str, Body] | None]:
    """Return the ego and the other road user at a time of a run."""
    step = run.first_step + round(moment["time_s"] / run.step_s)
    return run.ego_at(step), world.others_of(run, step).get(moment["obstacle_id"])


def _gaps(run: StoredRun, world: World) -> Iterator[float]:
    for step in range(run.first_step, run.last_step + 1):
        ego = run.ego_at(step)
        for _, body in world.others_of(run, step).values() if ego is not None else ():
            if ego is not None and math.dist((ego.x, ego.y), (body.x, body.y)) < 60.0:
                yield ego.gap_to(body)


def _figures(fields: Fields, run: StoredRun, world: World, verdict: Verdict) -> None:
    """Check the driven distance of a single run, and its events one by one."""
    steps = list(zip(run.series("x_m"), run.series("y_m"), strict=True))
    driven = sum(math.dist(one, other) for one, other in itertools.pairwise(steps))
    for metric in fields.get("metrics", ()):
        if metric["name"] == "distance_m":
            verdict.close("distance driven", metric["median"], driven, 0.005 * driven)
    for moment in fields.get("timeline", ()):
        ego, other = _ego_and_other(run, world, moment)
        if ego is not None:
            verdict.close(f"speed at {moment['time_s']} s", moment["speed_mps"], ego.speed)
        if ego is not None and other is not None:
            verdict.close(f"gap at {moment['time_s']} s", moment["gap_m"], ego.gap_to(other[1]), 0.02)


def _comparison(told: GivenAnswer, world: World, verdict: Verdict) -> None:
    for comparison in told.structured["comparisons"]:
        for pair in comparison["edited"]:
            parents = world.recipe(pair["after"]).get("parents", [])
            verdict.holds(f"{pair['after']} is edited from {pair['before']}", pair["before"] in parents, parents)
        if comparison["single"] is None:
            continue
        runs = [world.run(side["run_id"]) for side in comparison["single"]]
        for side, run in zip(comparison["single"], runs, strict=True):
            if run is not None:
                verdict.holds(f"outcome {side['outcome']}", side["outcome"] == run.outcome, run.outcome)
                _moments(side["review"], run, world, verdict)
        before, after = runs
        if before is None or after is None:
            continue
        goals = [run.outcome == "goal_reached" for run in (before, after)]
        alike = comparison["headline_code"] == "one_pair_same"
        verdict.holds(comparison["headline_code"], alike == (goals[0] == goals[1]), goals)
        for metric in comparison["metrics"]:
            for end, run in (("median_before", before), ("median_after", after)):
                if metric[end] is not None:
                    verdict.close(f"{metric['name']} {end}", metric[end], run.record["metrics"][metric["name"]])


# Searches and configurations


def _search(told: GivenAnswer, world: World, verdict: Verdict) -> None:
    fields, scenes = told.structured, world.scenes()
    verdict.holds(f"of {fields['catalogue']} scenarios", fields["catalogue"] == len(scenes), len(scenes))
    fit = [key for key, scene in scenes.items() if _fits(scene, told.asked)]
    judged = set(told.asked) <= {"obstacles", "ego_speed", "tags", "country", "city", "limit", "sort", "scenario_id"}
    if judged:
        verdict.holds(f"{fields['total']} match", fields["total"] == len(fit), len(fit))
    for found in (*fields["matches"], *fields["fallback"]):
        scene = scenes.get(found["scenario_id"])
        is_match = found in fields["matches"]
        fits = scene is not None and (not judged or (found["scenario_id"] in fit) == is_match)
        verdict.holds(f"{found['scenario_id']} matches: {is_match}", fits)
        if scene is not None:
            counts = {kind: count for kind, count in scene.counts.items() if count}
            verdict.holds(f"{found['scenario_id']}: {found['counts']}", found["counts"] == counts, counts)
            if scene.problems:
                verdict.close(found["scenario_id"], found["ego_speed_mps"], scene.problems[0].start.speed)


def _plain(kind: str) -> str:
    """Return a class in comparable form, without case and blanks."""
    plain = re.sub(r"[^a-z]", "", kind.lower())
    return {"person": "pedestrian"}.get(plain, plain)


def _fits(scene: SceneFile, asked: Mapping[str, Any]) -> bool:
    """Return True if a file meets the conditions on classes, the ego's speed, tags and place."""
    counts = Counter({_plain(kind): many for kind, many in scene.counts.items()})
    for condition in asked.get("obstacles", []):
        name, sign, number = re.fullmatch(r"(\w+)(>=|<=|=)?(\d+)?", condition).groups()  # type: ignore[union-attr]
        many = counts[_plain(name)]
        wanted = int(number or 1)
        if not {">=": many >= wanted, None: many >= wanted, "<=": many <= wanted, "=": many == wanted}[sign]:
            return False
    if (speed := asked.get("ego_speed")) is not None:
        low, high = re.fullmatch(r"([\d.]+)\.\.([\d.]+)m/s", speed).groups()  # type: ignore[union-attr]
        if not scene.problems or not float(low) <= scene.problems[0].start.speed <= float(high):
            return False
    if not set(asked.get("tags", [])) <= scene.tags:
        return False
    return (asked.get("country", scene.country), asked.get("city", scene.place)) == (scene.country, scene.place)


def _configuration(told: GivenAnswer, world: World, verdict: Verdict) -> None:
    config_id = told.structured["config_id"]
    stored = world.record("config", config_id)
    verdict.holds(f"{config_id} is stored", stored is not None)
    weights = {} if stored is None else stored.get("weights", {})
    for change in told.structured["changes"]:
        if change["name"] in weights:
            verdict.close(change["name"], change["after"], weights[change["name"]], 1e-9)


# All answers


def _against_itself(told: GivenAnswer, verdict: Verdict) -> None:
    text, structured = told.text, told.structured
    for key in ("scenario_id", "search_id", "batch_id", "config_id"):
        value = structured.get(key)
        if told.tool not in ("describe_scenario", "list_planners") and isinstance(value, str) and value not in text:
            verdict.excludes(f"structured {key} {value} is not in the text")
    for part in _parts(structured):
        count, of = part.get("count"), part.get("of")
        if isinstance(count, int) and isinstance(of, int) and count > of:
            verdict.excludes(f"{count} of {of}")


def _parts(content: Any) -> Iterator[Fields]:
    """Yield every object in structured content."""
    if isinstance(content, Mapping):
        yield content
    for part in content.values() if isinstance(content, Mapping) else content if isinstance(content, list) else ():
        yield from _parts(part)


_RULES: Mapping[str, Callable[[GivenAnswer, World, Verdict], None]] = {
    "describe_scenario": _description,
    "generate_scenarios": _generation,
    "modify_scenario": _edit,
    "run_planner": _runs,
    "analyze_results": _runs,
    "compare_results": _comparison,
    "find_scenarios": _search,
    "configure_planner": _configuration,
}


def unanswered(told: GivenAnswer, asks: Sequence[str]) -> Iterator[str]:
    """Return the fields, such as ``runs.outcome``, that an answer leaves empty or does not repeat in its text.

    A field may be in any element of a list, and any alternative separated by ``|`` suffices. A name without a blank and
    a number must appear in the text.
    """
    for ask in asks:
        values = [value for path in ask.split("|") for value in _at(told.structured, path.split("."))]
        if not any(_is_reported(value, told.text) for value in values):
            yield ask


def _at(content: Any, path: Sequence[str]) -> Iterator[Any]:
    if isinstance(content, list):
        for part in content:
            yield from _at(part, path)
    elif not path:
        yield content
    elif isinstance(content, Mapping) and path[0] in content:
        yield from _at(content[path[0]], path[1:])


def _is_reported(value: Any, text: str) -> bool:
    if isinstance(value, bool):
        return True
    if isinstance(value, int | float):
        return any(agrees(figure, value) for figure in figures_in(text))
    if isinstance(value, str):
        return bool(value) and (bool(re.search(r"\s", value)) or value.replace("_", " ") in text.replace("_", " "))
    return bool(value)
