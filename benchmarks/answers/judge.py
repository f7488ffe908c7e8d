"""Reads the statements of an answer's text and says of each whether the files bear it out.

A statement is what a rule's pattern finds in the text: a count, a speed, a distance, a time, who hit whom, what is as
it was. A rule compares it with what ``files`` reads, to the digits that are printed. Statements that exclude one
another are contradictions: of one text, or of the text and the structured content beside it.
"""

import itertools
import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from plannerforge.evals.scoring.files import Body, RoadUser, SceneFile, StoredRun, World

_STANDS_MPS = 0.1
_SLACK_M = 0.75
"""A body's centre may lie this far beside a lanelet that it is on, as the matching to lanes has it (chosen)."""
_SIDES = ("alongside", "ahead", "behind", "left", "right")


@dataclass(frozen=True)
class Told:
    """An answer as a client has it; ``asked``: the arguments of the call."""

    tool: str
    asked: Mapping[str, Any]
    text: str
    structured: Mapping[str, Any]
    is_error: bool


@dataclass
class Verdict:
    """What was found in one answer: how many statements were compared, and those that do not hold."""

    compared: int = 0
    false_statements: list[str] = field(default_factory=list)
    contradictions: list[str] = field(default_factory=list)

    def holds(self, statement: str, true: bool, found: object = "") -> None:
        """Count a statement, and keep it where it is false, with what the files say."""
        self.compared += 1
        if not true:
            self.false_statements.append(f"{statement} (the files: {found})")

    def excludes(self, words: str) -> None:
        """Note two statements that cannot both be true."""
        self.contradictions.append(words)


def judge(told: Told, world: World) -> Verdict:
    """Compare all statements of an answer that a rule reads."""
    verdict = Verdict()
    for artifact in sorted(set(re.findall(r"\b(?:run|cfg|batch|search)_[0-9a-f]{12}\b", told.text))):
        verdict.holds(f"there is {artifact}", world.kind_of(artifact) is not None, "no such artifact")
    if told.is_error:
        return verdict
    for rule in _RULES.get(told.tool, ()):
        rule(told, world, verdict)
    _against_itself(told, verdict)
    return verdict


# Scenarios


def _description(told: Told, world: World, verdict: Verdict) -> None:
    scene = _scene(told, world, r"^(\S+) \(")
    if scene is None:
        return
    _road_users(told.text, scene, verdict)
    _ego(told.text, scene, verdict)
    _vehicles(told, scene, verdict)


def _scene(told: Told, world: World, pattern: str) -> SceneFile | None:
    found = re.search(pattern, told.text, re.MULTILINE)
    return None if found is None else world.scene(found[1])


def _road_users(text: str, scene: SceneFile, verdict: Verdict) -> None:
    if (found := re.search(r"(\d+|no) road users? beside the ego(?: \(([^)]*)\))?", text)) is None:
        return
    counts, total = scene.counts, sum(scene.counts.values())
    verdict.holds(found[0], _number(found[1]) == total, total)
    for count, name in re.findall(r"(\d+) ([a-zA-Z ]+?)s?(?:,|$)", found[2] or ""):
        real = sum(many for kind, many in counts.items() if _plain(kind) == _plain(name))
        verdict.holds(f"{count} {name}", int(count) == real, real)


def _number(word: str) -> int:
    return 0 if word == "no" else int(word)


def _plain(kind: str) -> str:
    """A class as it is compared: without case, blanks and the plural."""
    plain = re.sub(r"[^a-z]", "", kind.lower())
    return {"buse": "bus", "person": "pedestrian"}.get(plain, plain)


def _ego(text: str, scene: SceneFile, verdict: Verdict) -> None:
    if (
        not scene.problems
        or (found := re.search(r"^Ego: ([\d.]+) m/s on lanelets? ([\d, ]+?), (\d+) lane", text, re.MULTILINE)) is None
    ):
        return
    problem = scene.problems[0]
    start = problem.start
    verdict.holds(f"ego {found[1]} m/s", _shown(start.speed, found[1]), start.speed)
    under = scene.under(start.x, start.y, 0.3)
    named = {int(key) for key in found[2].split(", ")}
    verdict.holds(f"ego on lanelets {found[2]}", named <= under, sorted(under))
    lanes = {scene.lanes_beside(key) for key in named & set(scene.lanelets)}
    verdict.holds(f"{found[3]} lanes", int(found[3]) in lanes, sorted(lanes))
    goals = re.search(r"Goal: [^.]*?at (\d+(?:\.\d+)?)(?:\.\.(\d+(?:\.\d+)?))? s", text)
    if goals is not None and len(problem.goals) == 1:
        goal = problem.goals[0]
        first, last = ((step - start.step) * scene.step_s for step in (goal.first_step, goal.last_step))
        told = (goals[1], goals[2] or goals[1])
        verdict.holds(goals[0][-30:], _shown(first, told[0]) and _shown(last, told[1]), (first, last))
    region = re.search(r"region ([\d.]+) m away(?: on lanelet (\d+))?", text)
    if region is not None and problem.goals and problem.goals[0].areas:
        middle = problem.goals[0].areas[0].centroid
        away = math.dist((start.x, start.y), middle.coords[0])
        verdict.holds(region[0], _shown(away, region[1], 0.3), away)
        if region[2]:
            lane = scene.lanelets.get(int(region[2]))
            verdict.holds(region[0], lane is not None and lane.polygon.distance(middle) <= _SLACK_M)


_VEHICLE = re.compile(r"^- (\d+) (\w+)(?: \(\w+\))?: (.*)$", re.MULTILINE)


def _vehicles(told: Told, scene: SceneFile, verdict: Verdict) -> None:
    if not scene.problems:
        return
    start, first = scene.problems[0].start, scene.problems[0].start.step
    ego = Body(start.x, start.y, start.heading, start.speed, 4.508, 1.61)
    around = _focus(told.text, scene, first, verdict)
    middle = around or ego
    lines = _VEHICLE.findall(told.text)
    for key, kind, words in lines:
        user = scene.users.get(int(key))
        verdict.holds(f"{key} is a {kind}", user is not None and _plain(user.kind) == _plain(kind), user and user.kind)
        if user is not None:
            _place(key, words, user, scene, ego, middle if around else None, verdict)
    _listed(told.text, [int(key) for key, *_ in lines], scene, middle, first, around is not None, verdict)


def _focus(text: str, scene: SceneFile, step: int, verdict: Verdict) -> Body | None:
    """The vehicle that the description is about; None where that is the ego."""
    if (found := re.search(r"^Vehicle (\d+)(?: \([^)]*\))?: (.*)$", text, re.MULTILINE)) is None:
        return None
    user = scene.users.get(int(found[1]))
    verdict.holds(f"there is a vehicle {found[1]}", user is not None)
    if user is None:
        return None
    if (way := re.search(r"Recorded way: lanelets? ([\d → ]+)", found[2])) is not None:
        for key in way[1].split(" → "):
            lane = scene.lanelets.get(int(key))
            near = lane is not None and any(
                lane.polygon.distance(_point(state.x, state.y)) <= _SLACK_M for state in user.states.values()
            )
            verdict.holds(f"vehicle {found[1]} is recorded on lanelet {key}", near)
    return user.at(min(user.states) if step not in user.states and not user.is_static else step)


def _point(x: float, y: float) -> Any:
    import shapely

    return shapely.Point(x, y)


def _place(
    key: str, words: str, user: RoadUser, scene: SceneFile, ego: Body, focus: Body | None, verdict: Verdict
) -> None:
    """Distance, side, speed, gap and lanelet of a vehicle, as seen when the ego starts or when it comes."""
    late = re.search(r"(?:comes|appears|from) (?:at |after )?([\d.]+) s", words)
    start = scene.problems[0].start.step
    step = start if late is None and (user.is_static or start in user.states) else min(user.states)
    body = user.at(step)
    if body is None or step != start:
        return
    away = math.dist((body.x, body.y), (ego.x, ego.y))
    if focus is not None and (found := re.search(r"(\d+) m from vehicle", words)) is not None:
        from_focus = math.dist((body.x, body.y), (focus.x, focus.y))
        verdict.holds(f"{key}: {found[0]}", _shown(from_focus, found[1], 0.51), from_focus)
    if (
        found := re.search(r"(\d+) m (ahead|behind)?\s?(left|right)?", words.split("seen from the ego")[-1])
    ) is not None:
        along, aside = ego.local(body.x, body.y)
        metres = float(found[1])
        lane_m = min((abs(ahead) for ahead in _along_lanes(scene, ego, body)), default=away)
        fits = min(abs(along), away, lane_m) - 1.0 <= metres <= 1.6 * away + 3.0
        verdict.holds(f"{key}: {found[0]}", fits, f"{away:.1f} m, {along:.1f} m along")
        if found[2] and away < 40.0:
            ahead = along > -2.0 if found[2] == "ahead" else along < 2.0
            verdict.holds(f"{key} is {found[2]}", ahead, f"{along:.1f} m along")
        if found[3]:
            verdict.holds(f"{key} is {found[3]}", (aside > -2.0) == (found[3] == "left") or abs(aside) < 2.0, aside)
    speed = user.states[step].speed if step in user.states else 0.0
    if (found := re.search(r"([\d.]+) m/s", words)) is not None:
        verdict.holds(f"{key}: {found[0]}", _shown(speed, found[1]), speed)
    elif re.search(r"\bstands\b|\bparked\b", words):
        verdict.holds(f"{key} stands", abs(speed) <= _STANDS_MPS + 0.05, speed)
    if (found := re.search(r"gap ([\d.]+) m", words)) is not None:
        gap = ego.gap_to(body)
        verdict.holds(f"{key}: {found[0]}", gap - 1.5 <= float(found[1]) <= 1.6 * gap + 4.0, gap)
    if (found := re.search(r"lanelet (\d+)", words)) is not None:
        lane = scene.lanelets.get(int(found[1]))
        near = lane is not None and lane.polygon.distance(body.polygon) <= 0.3
        verdict.holds(f"{key}: {found[0]}", near, sorted(scene.under(body.x, body.y, _SLACK_M)))


def _along_lanes(scene: SceneFile, ego: Body, body: Body) -> Iterator[float]:
    """How far a body is ahead of the ego along the centre of each lanelet that the ego is on."""
    for key in scene.under(ego.x, ego.y, 0.3):
        centre = scene.lanelets[key].centre
        yield centre.project(_point(body.x, body.y)) - centre.project(_point(ego.x, ego.y))


def _listed(
    text: str, keys: Sequence[int], scene: SceneFile, middle: Body, step: int, focused: bool, verdict: Verdict
) -> None:
    """The nearest come first, and with those that are not shown they are all."""
    present = scene.present(step)
    away = {key: math.dist((body.x, body.y), (middle.x, middle.y)) for key, body in present.items()}
    shown = [away[key] for key in keys if key in away]
    if re.search(r"^Vehicles, nearest", text, re.MULTILINE) and shown:
        sorted_enough = all(one <= other + 3.0 for one, other in itertools.pairwise(shown))
        verdict.holds("nearest first", sorted_enough, [round(value, 1) for value in shown])
    if (more := re.search(r"\((\d+) more: ", text)) is not None and keys:
        total = sum(scene.counts.values()) - focused
        verdict.holds(f"{len(keys)} shown and {more[0]}", len(keys) + int(more[1]) == total, total)


def _generation(told: Told, world: World, verdict: Verdict) -> None:
    for made in told.structured.get("scenarios", []):
        scene = world.scene(str(made["scenario_id"]))
        verdict.holds(f"{made['scenario_id']} is there", scene is not None)
        if scene is None or len(told.structured["scenarios"]) > 1:
            continue
        real = sum(scene.counts.values()) + 1
        if (
            found := re.search(r"(\d+) vehicles?(?: of (\d+) that[^:]*)?: the ego((?:, \d+ \w+)*)", told.text)
        ) is not None:
            verdict.holds(found[0], int(found[1]) == real, real)
            parts = [int(count) for count in re.findall(r"\d+", found[3])]
            verdict.holds(f"{found[0]} add up", 1 + sum(parts) == int(found[1]), 1 + sum(parts))
        problem = scene.problems[0]
        if found := re.search(
            r"at ([\d.]+) m/s; goal (\d+) m ahead on lanelet (\d+) within ([\d.]+) to ([\d.]+) s", told.text
        ):
            verdict.holds(f"ego at {found[1]} m/s", _shown(problem.start.speed, found[1]), problem.start.speed)
            goal = problem.goals[0]
            window = (goal.first_step * scene.step_s, goal.last_step * scene.step_s)
            fits = _shown(window[0], found[4]) and _shown(window[1], found[5])
            verdict.holds(f"goal within {found[4]} to {found[5]} s", fits, window)
            centre = goal.areas[0].centroid if goal.areas else None
            lane = scene.lanelets.get(int(found[3]))
            if centre is not None:
                on_it = lane is not None and lane.polygon.distance(centre) <= _SLACK_M
                verdict.holds(f"goal on lanelet {found[3]}", on_it)
                straight = math.dist((problem.start.x, problem.start.y), centre.coords[0])
                verdict.holds(f"goal {found[2]} m ahead", float(found[2]) >= straight - 1.0, straight)


# Edits


def _edit(told: Told, world: World, verdict: Verdict) -> None:
    if (found := re.search(r"^(\S+) \(from (\S+?)\)", told.text)) is None:
        return
    scene, base = world.scene(found[1]), world.scene(found[2])
    verdict.holds(f"{found[1]} is there", scene is not None and base is not None)
    if scene is None or base is None:
        return
    same = sum(base.texts.get(key) == text for key, text in scene.texts.items())
    if (kept := re.search(r"^(\d+|No|All \d+) vehicles? exactly as recorded", told.text, re.MULTILINE)) is not None:
        verdict.holds(kept[0], int((re.findall(r"\d+", kept[1]) or ["0"])[0]) == same, same)
    for removed in re.findall(r"removed \d+: ([\d, ]+)", told.text):
        for key in re.findall(r"\d+", removed):
            verdict.holds(f"{key} is removed", int(key) not in scene.users and int(key) in base.users)
    for kind, key, lane, speed in re.findall(
        r"add_vehicle \(P\): (\w+) (\d+) on lanelet (\d+) at [\d.]+ m(?: \([^)]*\))?, ([\d.]+) m/s", told.text
    ):
        user = scene.users.get(int(key))
        verdict.holds(f"{key} is added", user is not None and int(key) not in base.users)
        if user is not None:
            verdict.holds(f"added {key} at {speed} m/s", _shown(user.first.speed, speed, 0.3), user.first.speed)
            spot = _point(user.first.x, user.first.y)
            under = int(lane) in scene.lanelets and scene.lanelets[int(lane)].polygon.distance(spot) <= _SLACK_M
            verdict.holds(f"added {key} on lanelet {lane}", under)
            del kind
    _meant(told, base, verdict)
    _danger(told, verdict)


def _meant(told: Told, base: SceneFile, verdict: Verdict) -> None:
    """Who was meant by ``nearest:N``: the N nearest that move, centre to centre, when the ego starts."""
    if not base.problems or (found := re.search(r"\(nearest:(\d+): ([^)]*)\)", told.text)) is None:
        return
    named = [int(key) for key in re.findall(r"(?:^|; )(\d+) \w+", found[2])]
    start = base.problems[0].start
    away = {
        key: math.dist((body.x, body.y), (start.x, start.y))
        for key, body in base.present(start.step).items()
        if not base.users[key].is_static
    }
    nearest = sorted(away, key=away.__getitem__)[: int(found[1])]
    verdict.holds(f"nearest:{found[1]} are {named}", set(named) == set(nearest), nearest)


def _danger(told: Told, verdict: Verdict) -> None:
    """What an edit says of the ego's danger is said once: nothing new, or what changed from what to what."""
    nothing = "Nothing new for the ego" in told.text
    line = next((line for line in told.text.splitlines() if "for the ego" in line), "")
    changed = [(a, b) for a, b in re.findall(r"([\d.]+|none[^,→]*) (?:m |s )?→ ([\d.]+|none[^,.]*)", line)]
    if nothing and changed:
        verdict.excludes(f"nothing new, and {changed}")
    if line.startswith("New for the ego") and changed and all(a.strip() == b.strip() for a, b in changed):
        verdict.excludes(f"new, but the same: {changed}")
    risk = re.search(r"risk score \(0 worst, 5 best\) (?:[\d]+ → )?(\d+)", line)
    hits = re.search(r"collision (?:[^,.]*→ )?(with \d+|none)", line)
    if risk is not None and hits is not None and (risk[1] == "0") != (hits[1] != "none"):
        verdict.excludes(f"risk score {risk[1]} and collision {hits[1]}")


# Runs


def _runs(told: Told, world: World, verdict: Verdict) -> None:
    lines = told.text.splitlines()
    for number, line in enumerate(lines):
        found = re.search(r"\b(run_[0-9a-f]{12}) on \S+ under .*?: (?=[a-z])(.*)$", line)
        named = found or re.search(r"^- (?:before|after): (.*) \((run_[0-9a-f]{12})\)$", line)
        if named is None:
            continue
        run_id, words = (named[1], named[2]) if found else (named[2], named[1])
        run = world.run(run_id)
        if run is None:
            continue
        _outcome(words, run, world, verdict)
        if number == 0 and told.tool in ("run_planner", "analyze_results"):
            _moments(told.text, run, world, verdict)


def _outcome(words: str, run: StoredRun, world: World, verdict: Verdict) -> None:
    scene = world.scene(run.scenario_id)
    if scene is None:
        return
    if (found := re.match(r"reached the goal at ([\d.]+) s \(step (\d+)\)", words)) is not None:
        verdict.holds(words, run.outcome == "goal_reached" and _reaches(run, scene), run.outcome)
        taken = (run.last_step - run.first_step) * run.step_s
        verdict.holds(f"at {found[1]} s", _shown(taken, found[1]), taken)
        return
    if not words.startswith("collision"):
        verdict.holds(words, run.outcome not in ("goal_reached", "collision"), run.outcome)
        return
    found = re.search(r"(\w+) (\d+)[^(]* at ([\d.]+) s \(ego ([\d.]+) m/s(?:, (?:\w+ \d+|it) ([\d.]+) m/s)?", words)
    verdict.holds(words, run.outcome == "collision", run.outcome)
    if found is None:
        return
    step = run.first_step + round(float(found[3]) / run.step_s)
    ego, others = run.ego_at(step), world.others_of(run, step)
    other = others.get(int(found[2]))
    touches = ego is not None and other is not None and ego.gap_to(other[1]) <= 0.05
    verdict.holds(f"touches {found[2]} at {found[3]} s", touches, ego and other and ego.gap_to(other[1]))
    if ego is not None and other is not None:
        verdict.holds(f"ego {found[4]} m/s", _shown(ego.speed, found[4]), ego.speed)
        if found[5]:
            verdict.holds(f"{found[2]} {found[5]} m/s", _shown(abs(other[1].speed), found[5]), other[1].speed)
        verdict.holds(f"{found[2]} is a {found[1]}", _plain(other[0]) == _plain(found[1]), other[0])


def _reaches(run: StoredRun, scene: SceneFile) -> bool:
    """Whether the last state lies in a goal of the problem, in its time."""
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


def _moments(text: str, run: StoredRun, world: World, verdict: Verdict) -> None:
    """The closest moment, the largest motions, and the figures of a single run."""
    gaps = [
        (ego.gap_to(body), key, step)
        for step in range(run.first_step, run.last_step + 1)
        if (ego := run.ego_at(step)) is not None
        for key, (_, body) in world.others_of(run, step).items()
        if math.dist((ego.x, ego.y), (body.x, body.y)) < 60.0
    ]
    if found := re.search(
        r"^Closest: ([\d.]+) m to \w+ (\d+)[^(;]* at ([\d.]+) s \(ego ([\d.]+), it ([\d.]+) m/s", text, re.MULTILINE
    ):
        least = min(gaps)[0] if gaps else math.nan
        verdict.holds(f"closest {found[1]} m", _shown(least, found[1], 0.02), least)
        step = run.first_step + round(float(found[3]) / run.step_s)
        ego, other = run.ego_at(step), world.others_of(run, step).get(int(found[2]))
        there = ego is not None and other is not None and abs(ego.gap_to(other[1]) - least) < 0.02
        verdict.holds(f"to {found[2]} at {found[3]} s", there, min(gaps)[1:] if gaps else "nobody near")
        if ego is not None and other is not None:
            speeds = _shown(ego.speed, found[4]) and _shown(abs(other[1].speed), found[5])
            verdict.holds(f"ego {found[4]}, it {found[5]} m/s", speeds, (ego.speed, other[1].speed))
    steps = list(zip(run.series("x_m"), run.series("y_m"), strict=True))
    driven = sum(math.dist(one, other) for one, other in itertools.pairwise(steps))
    if (found := re.search(r"distance driven ([\d.]+) m", text)) is not None:
        verdict.holds(found[0], _shown(driven, found[1], 0.005 * driven), driven)
    accelerations = run.series("acceleration_mps2")
    for word, sign in (("acceleration", 1), ("braking", -1)):
        found = re.search(rf"(?:Largest:|,) {word} ([\d.]+) m/s² at ([\d.]+) s", text)
        if found is not None and len(accelerations) > 1:
            values = sign * accelerations[1:]
            verdict.holds(f"{word} {found[1]} m/s²", _shown(float(values.max()), found[1]), float(values.max()))
            at = float(accelerations[round(float(found[2]) / run.step_s)]) * sign
            verdict.holds(f"{word} at {found[2]} s", _shown(at, found[1]), at)
    for time, speed, gap, key in re.findall(
        r"^- ([\d.]+) s: ([\d.]+) m/s, [^,]*, ([\d.]+) m to (\d+)", text, re.MULTILINE
    ):
        step = run.first_step + round(float(time) / run.step_s)
        ego, other = run.ego_at(step), world.others_of(run, step).get(int(key))
        verdict.holds(f"{speed} m/s at {time} s", ego is not None and _shown(ego.speed, speed), ego and ego.speed)
        if ego is not None and other is not None:
            verdict.holds(
                f"{gap} m to {key} at {time} s", _shown(ego.gap_to(other[1]), gap, 0.02), ego.gap_to(other[1])
            )


def _comparison(told: Told, world: World, verdict: Verdict) -> None:
    _runs(told, world, verdict)
    pairs = dict(re.findall(r"^- (before|after): .*\((run_[0-9a-f]{12})\)$", told.text, re.MULTILINE))
    runs = {word: world.run(key) for word, key in pairs.items()}
    before, after = runs.get("before"), runs.get("after")
    if before is None or after is None:
        return
    same = before.outcome == after.outcome
    if "same outcome" in told.text.splitlines()[0]:
        verdict.holds("same outcome", same, (before.outcome, after.outcome))
    for parent, child in re.findall(r"^- edited \((\S+) → (\S+?)\):", told.text, re.MULTILINE):
        parents = world.recipe(child).get("parents", [])
        verdict.holds(f"{child} is edited from {parent}", parent in parents, parents)
    names = {"duration": "duration_s", "minimum distance": "minimum_distance_m", "mean speed": "mean_speed_mps"}
    names |= {"distance driven": "distance_m"}
    for line in told.text.splitlines():
        for name, first, second in re.findall(r"([a-z][a-z ]+?) ([\d.]+) → ([\d.]+)", line):
            key = names.get(name.removeprefix("worse: ").removeprefix("better: ").strip())
            if key is not None and line.startswith(("- better", "- worse")):
                values = [run.record["metrics"][key] for run in (before, after)]
                fits = _shown(values[0], first) and _shown(values[1], second)
                verdict.holds(f"{name} {first} → {second}", fits, values)


# Searches and configurations


def _search(told: Told, world: World, verdict: Verdict) -> None:
    scenes = world.scenes()
    if (found := re.search(r"^(\d+) of (\d+) scenarios? match", told.text)) is None:
        return
    verdict.holds(f"of {found[2]} scenarios", int(found[2]) == len(scenes), len(scenes))
    fit = [key for key, scene in scenes.items() if _fits(scene, told.asked)]
    judged = set(told.asked) <= {
        "obstacles",
        "ego_speed",
        "tags",
        "country",
        "city",
        "limit",
        "sort",
        "text",
        "scenario_id",
    }
    if judged and "text" not in told.asked:
        verdict.holds(f"{found[1]} match", int(found[1]) == len(fit), len(fit))
    if "FALLBACK" in told.text or int(found[1]) == 0:
        return
    for key, words in re.findall(r"^- (\S+?): (.*)$", told.text, re.MULTILINE):
        scene = scenes.get(key)
        verdict.holds(f"{key} matches", scene is not None and (not judged or key in fit))
        if scene is not None:
            for count, name in re.findall(r"(\d+) ([a-zA-Z]+?)s?(?:,| ·)", words.split(", ego ")[0] + ","):
                real = sum(many for kind, many in scene.counts.items() if _plain(kind) == _plain(name))
                verdict.holds(f"{key}: {count} {name}", int(count) == real, real)
            if (speed := re.search(r"ego ([\d.]+) m/s", words)) is not None and scene.problems:
                verdict.holds(f"{key}: {speed[0]}", _shown(scene.problems[0].start.speed, speed[1]))


def _fits(scene: SceneFile, asked: Mapping[str, Any]) -> bool:
    """Whether a file meets the conditions on classes, the ego's speed, tags and place."""
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


def _configuration(told: Told, world: World, verdict: Verdict) -> None:
    if (found := re.search(r"^(cfg_[0-9a-f]{12}) ", told.text)) is None:
        return
    stored = world.record("config", found[1])
    verdict.holds(f"{found[1]} is stored", stored is not None)
    weights = {} if stored is None else stored.get("weights", {})
    for name, value in re.findall(r"([a-z_]+) [\d.e+-]+ → ([\d.e+-]+\d|\d)", told.text):
        verdict.holds(f"{name} → {value}", name in weights and _shown(weights[name], value), weights.get(name))


# All answers


def _against_itself(told: Told, verdict: Verdict) -> None:
    text, structured = told.text, told.structured
    for key in ("scenario_id", "search_id", "batch_id", "config_id"):
        value = structured.get(key)
        if told.tool != "describe_scenario" and isinstance(value, str) and value and value not in text:
            verdict.excludes(f"structured {key} {value} is not in the text")
    for run in structured.get("runs", []) if told.tool == "run_planner" else []:
        said = next((line for line in text.splitlines() if str(run["run_id"]) in line), "")
        if said and (run["outcome"] == "collision") != (": collision: " in said):
            verdict.excludes(f"structured outcome {run['outcome']}, text: {said}")
    unexplained = re.search(r"does not (?:arrive|get there)(?![^\n]*[:(,;])", text)
    if "the edit is done" in text and unexplained:
        verdict.excludes("done, but does not arrive, without a reason")
    for count, of in re.findall(r"\b(\d+) of (\d+)\b", text):
        if int(count) > int(of):
            verdict.excludes(f"{count} of {of}")


def _shown(value: float, printed: str, slack: float = 0.0) -> bool:
    """Whether a value is what was printed, to the digits that are there."""
    digits = len(printed.partition(".")[2])
    significant = len(printed.replace(".", "").lstrip("0"))
    half = 0.5 * 10.0**-digits
    if digits == 0 and significant >= 3:
        half = max(half, 0.005 * abs(value))
    return abs(value - float(printed)) <= half + slack + 1e-6


_Rule = Callable[[Told, World, Verdict], None]
_RULES: Mapping[str, tuple[_Rule, ...]] = {
    "describe_scenario": (_description,),
    "generate_scenarios": (_generation,),
    "modify_scenario": (_edit,),
    "run_planner": (_runs,),
    "analyze_results": (_runs,),
    "compare_results": (_comparison,),
    "find_scenarios": (_search,),
    "configure_planner": (_configuration,),
}


def unanswered(told: Told, asks: Sequence[str]) -> Iterator[str]:
    """The patterns of what an answer has to hold that its text does not hold."""
    return (ask for ask in asks if re.search(ask, told.text, re.MULTILINE) is None)
