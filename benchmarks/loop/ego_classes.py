"""Checks that an ego of a class has that class everywhere: in files, judge, planners, answers and pictures.

Requests for egos of six classes (car, taxi, motorcycle, bus, truck, semi-trailer) use only the tools, and every way to
state a class: generation, a file, an edit that names the class, an edit that replaces a recorded vehicle with the ego,
and a configuration with another vehicle. The seed draws the ego's start, speed and road.

A request is right if all of this holds:

- the stored file names the class, and the description and the text of the picture name class and size;
- the judge finds an initial collision with a body 6 cm inside the class's length or width, and no collision with one 6
  cm outside;
- the ego in the picture is as long and as wide as the class, measured in pixels against a bus of known size;
- each planner's run states class and size, and its motion keeps the class's limits of speed, acceleration (friction and
  power), steering angle and steering rate;
- its rear axle, if the class has one, does not slide, by the kinematic single-track model with that wheelbase;
- a semi-trailer is refused by name with the classes that can be driven, and its tractor drives if a configuration
  states vehicle 4.

The table of truths below and all measurements share no code with the product.

Keys: ``ego_classes_right``: share of the requests that are right; ``ego_requests``: their number.
"""

import base64
import io
import itertools
import json
import math
import random
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import anyio
import numpy as np
from mcp import Client
from numpy.typing import NDArray

from plannerforge.engine.workspace import Workspace
from plannerforge.schemas.runs import RunRecord
from plannerforge.server.assembly import create_server

from ..harness import Figures, SeededBench, settings_for, share

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _Truth:
    """The truth about a class: lengths in m, speeds in m/s, accelerations in m/s², angles in rad.

    ``switch_mps``: the speed above which the power limits the acceleration. ``kind``, ``size_m``: CommonRoad's type and
    the size of such a recorded vehicle.
    """

    word: str
    length: float
    width: float
    wheelbase: float
    rear: float
    hardest: float
    fastest: float
    switch_mps: float
    steering: float
    rate: float
    kind: str
    size_m: tuple[float, float]

    @property
    def in_player(self) -> list[object]:
        """Class and size in cm, as a player gets them."""
        return [self.word, round(100 * self.length), round(100 * self.width)]


TRUTHS = (
    # CommonRoad's vehicle 2 (BMW 320i), as its parameter file has it.
    _Truth("car", 4.508, 1.61, 2.5789, 1.4227, 11.5, 50.8, 7.319, 1.066, 0.4, "car", (4.5, 1.8)),
    # A passenger car: limits of vehicle 2, size and axles of the traffic's taxis.
    _Truth("taxi", 4.8, 1.85, 2.85, 1.5, 11.5, 50.8, 7.319, 1.066, 0.4, "taxi", (4.8, 1.85)),
    # SUMO's emergencyDecel of 10 m/s²; a Honda CB500F: 128 W/kg with its rider, 1.41 m wheelbase turning on 2.7 m.
    _Truth("motorcycle", 2.2, 0.9, 1.45, 0.72, 10.0, 55.6, 12.8, math.asin(1.41 / 2.7), 0.4, "motorcycle", (2.2, 0.9)),
    # SUMO's emergencyDecel of 7 m/s²; a Citaro: 210 kW, 18 t, wheels at 53° and 46°; vehicle 4's steering rate.
    _Truth("bus", 12.0, 2.5, 5.9, 2.65, 7.0, 23.6, 210 / 18 / 7, math.radians(49.5), 0.7103, "bus", (12.0, 2.5)),
    # SUMO's emergencyDecel of 7 m/s²; an Atego 818: 130 kW, 7.5 t; steering of CommonRoad's vehicle 4.
    _Truth("truck", 7.1, 2.4, 4.2, 1.9, 7.0, 36.1, 130 / 7.5 / 7, 0.55, 0.7103, "truck", (7.1, 2.4)),
    # CommonRoad's vehicle 4 with its trailer; without it, the tractor is 5.1 m long.
    _Truth("trailer", 16.5, 2.55, 3.6, 1.8, 11.5, 22.22, 7.824, 0.55, 0.7103, "truck", (16.5, 2.55)),
)
_BY_WORD = {truth.word: truth for truth in TRUTHS}
_CAR, _TRAILER = _BY_WORD["car"], _BY_WORD["trailer"]
_TRACTOR = replace(_TRAILER, length=5.1)
SPOKEN = {"truck": "lorry", "trailer": "semi-trailer", "motorcycle": "motorbike", "taxi": "cab"}
"""Other words for a class, which half of the requests use."""
PLANNERS = ("frenetix", "mp_rbfn", "idm")
_INSIDE_M = 0.06
_STEP_S = 0.1
_VERMILLION, _YELLOW = (0xD5, 0x5E, 0x00), (0xF0, 0xE4, 0x42)
"""The colours of the ego and of buses (Okabe and Ito's palette)."""
_PIXELS_M = 0.4
"""Tolerance of a body's side measured in a picture, about two pixels (chosen)."""
_ABOVE_LEGEND, _NOSE_PX = 0.85, 8
"""Share of a picture's height above its legend, and the width in pixels of the gap at a nose's base."""
_SLIDE_M = 0.02
"""Largest lateral motion of the rear axle in a step: the drivability checker's tolerance of a position."""
_PLACES = ("Musterstadt", "Fahrhausen", "Quadratstadt")
"""Built-in maps with junctions."""


def measure(bench: SeededBench) -> Figures:
    """Return the figures of the keys above."""
    verdicts = anyio.run(_measured, bench)
    return {"ego_classes_right": share(verdicts), "ego_requests": len(verdicts)}


async def _measured(bench: SeededBench) -> list[bool]:
    folder, choice = bench.folder("ego_files"), random.Random(bench.seed)  # noqa: S311 - reproducible, not secret
    settings = settings_for(bench.scratch / "ego_classes", folder, 1)
    async with Client(create_server(settings)) as client:
        asking = _Asking(client, bench.scratch / "ego_classes", folder, choice)
        kinds = (asking.named, asking.edited, asking.replaced, asking.generated, asking.stated)
        wanted = [(kind, truth) for kind in kinds for truth in TRUTHS]
        wanted += [(asking.generated, truth) for truth in TRUTHS]
        verdicts = []
        for kind, truth in wanted[: bench.limit]:
            wrong = [text async for text in kind(truth)]
            if wrong:
                sys.stderr.write(f"{kind.__name__} {truth.word}: {'; '.join(wrong)}\n")
            verdicts.append(not wrong)
        return verdicts


@dataclass(frozen=True)
class _Made:
    """A scenario of the bench: a road, an ego on it, recorded vehicles as (kind, size, x, y), and a goal ahead."""

    number: int
    ego_x: float
    speed: float
    others: tuple[tuple[str, tuple[float, float], float, float], ...] = ()
    ego_class: str = ""
    bend_radius_m: float = 0.0
    goal_m: float = 150.0
    last_step: int = 120

    @property
    def name(self) -> str:
        """A benchmark id."""
        return f"ZAM_Egoclasses-{self.number}_1_T-1"


@dataclass
class _Asking:
    """The requests; each yields the faults of its answer."""

    client: Client
    workspace: Path
    folder: Path
    choice: random.Random
    made: int = 0

    async def named(self, truth: _Truth) -> Any:
        """Return a file that names its ego's class."""
        scenario = await self._imported(self._straight(truth.word))
        async for text in self._is(scenario, truth, in_picture=True):
            yield text
        async for text in self._judged(truth):
            yield text
        async for text in self._driven(scenario, truth):
            yield text
        bend = replace(self._straight(truth.word), number=self._number(), bend_radius_m=self.choice.uniform(20, 30))
        async for text in self._driven(await self._imported(replace(bend, speed=6.0, goal_m=60.0)), truth):
            yield text

    async def edited(self, truth: _Truth) -> Any:
        """Return an edit that names the class, by another word if there is one."""
        base = await self._imported(self._straight(""))
        word = SPOKEN.get(truth.word, truth.word)
        scenario = await self._modified(base, {"op": "set_ego", "vehicle_class": word})
        async for text in self._is(scenario, truth, in_picture=True):
            yield text
        async for text in self._driven(scenario, truth, PLANNERS[:1]):
            yield text

    async def replaced(self, truth: _Truth) -> Any:
        """Return an edit that puts the ego in the place of a recorded vehicle of the class."""
        plain = self._straight("")
        ahead_m = self.choice.uniform(60.0, 80.0)
        place_m = plain.ego_x + ahead_m
        bus = ("bus", (12.0, 2.5), place_m + self.choice.uniform(20.0, 26.0), _WIDTH_M)
        base = await self._imported(replace(plain, others=(bus, (truth.kind, truth.size_m, place_m, 0.0))))
        scenario = await self._modified(base, {"op": "set_ego", "vehicles": ["2"]})
        async for text in self._is(scenario, truth, in_picture=True):
            yield text
        async for text in self._driven(scenario, truth, PLANNERS[:1]):
            yield text

    async def generated(self, truth: _Truth) -> Any:
        """Return a generation that asks for the class."""
        word = self.choice.choice([truth.word, SPOKEN.get(truth.word, truth.word)])
        asked = {"place": self.choice.choice(_PLACES), "ego": f"type:{word}", "seed": self.choice.randrange(1000)}
        answer = await self.client.call_tool("generate_scenarios", {**asked, "duration_s": 15})
        if answer.is_error:
            yield f"{asked} is refused: {_text(answer)}"
            return
        if truth is not _CAR and not re.search(
            rf"Ego: {truth.word}, {truth.length:g} × {truth.width:g} m", _text(answer)
        ):
            yield f"{asked}: {_text(answer)}"
        scenario = answer.structured_content["scenarios"][0]["scenario_id"]
        async for text in self._is(scenario, truth, in_picture=False):
            yield text
        async for text in self._driven(scenario, truth, PLANNERS[:1]):
            yield text

    async def stated(self, truth: _Truth) -> Any:
        """Return a configuration that states a vehicle, which comes before the class."""
        scenario = await self._imported(self._straight(truth.word))
        number, vehicle = (4, _TRACTOR) if truth is _TRAILER else (2, _CAR)
        settings = {"planner": "frenetix", "settings": [f"vehicle={number}"]}
        made = (await self.client.call_tool("configure_planner", settings)).structured_content
        async for text in self._driven(scenario, vehicle, (made["config_id"],), refused=False):
            yield text

    def _number(self) -> int:
        self.made += 1
        return self.made

    def _straight(self, word: str) -> _Made:
        """Return an empty straight road but for a bus on the next lane, too far ahead to be in the way."""
        start = self.choice.uniform(40.0, 60.0)
        bus = ("bus", (12.0, 2.5), start + self.choice.uniform(20.0, 26.0), 7.0)
        speed = self.choice.uniform(6.0, 9.0)
        return _Made(self._number(), start, speed, (bus,), word, goal_m=self.choice.uniform(120.0, 150.0))

    async def _imported(self, made: _Made) -> str:
        path = self.folder / f"{made.name}.xml"
        path.write_text(_xml(made), encoding="utf-8")
        answer = await self.client.call_tool("import_files", {"path": str(path)})
        if answer.is_error:
            raise RuntimeError(_text(answer))
        return made.name

    async def _modified(self, base: str, edit: dict[str, object]) -> str:
        answer = await self.client.call_tool("modify_scenario", {"scenario_id": base, "edits": [edit]})
        if answer.is_error:
            raise RuntimeError(_text(answer))
        return str(answer.structured_content["scenario_id"])

    async def _is(self, scenario: str, truth: _Truth, *, in_picture: bool) -> Any:
        """Return the faults of the file, the description and the picture of a scenario."""
        text = (self.workspace / "scenarios" / scenario / "scenario.xml").read_text(encoding="utf-8")
        words = re.findall(r'<\?plannerforge ego-class="(\w+)"\?>', text)
        if words != ([] if truth is _CAR else [truth.word]):
            yield f"the file says {words}"
        told = _text(await self.client.call_tool("describe_scenario", {"scenario_id": scenario}))
        size = f"{truth.length:g} × {truth.width:g} m"
        if truth is not _CAR and f"Ego: {truth.word}, {size}" not in told:
            yield f"the description does not say {size}: {told}"
        shown = await self._shown(scenario)
        if [shown["scenes"][0]["start"][key] for key in ("kind", "length_cm", "width_cm")] != truth.in_player:
            yield f"the player shows {shown['scenes'][0]['start']}"
        drawn = await self.client.call_tool("render", {"ids": [scenario], "kind": "picture"})
        if truth is not _CAR and f"ego ({truth.word}) of {size}" not in _text(drawn):
            yield f"the picture's words are {_text(drawn)}"
        if in_picture:
            found = _measured_in(_image(drawn))
            if found is None or max(abs(found[0] - truth.length), abs(found[1] - truth.width)) > _PIXELS_M:
                yield f"in the picture it measures {found}"

    async def _judged(self, truth: _Truth) -> Any:
        """Return the faults in initial collisions with a 2 m by 2 m box next to and ahead of the class's body."""
        for gap_m, hits in ((-_INSIDE_M, True), (_INSIDE_M, False)):
            for along in (True, False):
                made = replace(self._straight(truth.word), number=self._number())
                x = made.ego_x + (truth.length / 2 + 1.0 + gap_m if along else 0.0)
                y = 0.0 if along else truth.width / 2 + 1.0 + gap_m
                made = replace(made, others=(("parkedVehicle", (2.0, 2.0), x, y),))
                scenario = await self._imported(made)
                if truth is _TRAILER:
                    checks = {"scenario_id": scenario, "detail": "checks"}
                    told = _text(await self.client.call_tool("describe_scenario", checks))
                    collides = "the ego overlaps" in told
                else:
                    record = (await self._run(scenario, "idm"))[0]
                    collides = record is not None and record["invalid_reason"] == "initial_collision"
                if collides != hits:
                    yield f"a body {gap_m} m away, along={along}: collision {collides}"

    async def _driven(
        self, scenario: str, truth: _Truth, configs: Sequence[str] = PLANNERS, *, refused: bool | None = None
    ) -> Any:
        """Return the faults of runs on a scenario."""
        for config in configs:
            record, told = await self._run(scenario, config)
            if truth is _TRAILER if refused is None else refused:
                others = [each.word for each in TRUTHS if each is not _TRAILER]
                if record is not None or "trailer" not in told or not all(word in told for word in others):
                    yield f"{config} does not refuse a semi-trailer by name: {told}"
                continue
            if record is None:
                yield f"{config} does not run: {told}"
                continue
            size = record["ego_length_m"], record["ego_width_m"]
            word = "truck" if truth is _TRACTOR else truth.word
            if size != (truth.length, truth.width) or record.get("ego_class", "car") != word:
                yield f"{config} drove {record.get('ego_class', 'car')} {size}"
            shown = await self._shown(record["run_id"])
            if [shown["panes"][0]["drive"]["ego"][key] for key in ("length_cm", "width_cm")] != truth.in_player[1:]:
                yield f"the player shows {config} driving another size"
            steps = self.workspace / "runs" / record["run_id"] / "steps.json"
            wrong = list(_beyond(json.loads(steps.read_text(encoding="utf-8")), truth))
            if wrong:
                yield f"{config} on {scenario} ({record['outcome']}): {', '.join(wrong)}"

    async def _shown(self, artifact_id: str) -> Any:
        """Return the data that a player shows of a scenario or run."""
        answer = await self.client.read_resource(f"plannerforge://view/{artifact_id}")
        return json.loads(answer.contents[0].text)  # type: ignore[union-attr]

    async def _run(self, scenario: str, config: str) -> tuple[dict[str, Any] | None, str]:
        """Return the record of a run (None if it was refused) and the answer's text."""
        answer = await self.client.call_tool("run_planner", {"scenarios": [scenario], "configs": [config]})
        if answer.is_error or not answer.structured_content["runs"]:
            return None, _text(answer)
        run_id = answer.structured_content["runs"][0]["run_id"]
        record = Workspace(self.workspace).get(run_id, "run").read(RunRecord)
        return record.model_dump(mode="json"), _text(answer)


def _beyond(steps: dict[str, Any], truth: _Truth) -> Iterator[str]:
    """Yield the limits that a driven motion exceeds, in words."""
    speed, heading = np.array(steps["speed_mps"]), np.unwrap(np.array(steps["heading_rad"]))
    center = np.column_stack([steps["x_m"], steps["y_m"]])
    if len(speed) < 3:
        return
    if speed.max() > truth.fastest + 0.05:
        yield f"speed {speed.max():.1f}"
    along, turn, mean = np.diff(speed) / _STEP_S, np.diff(heading), (speed[1:] + speed[:-1]) / 2
    whole = np.hypot(along, mean * turn / _STEP_S)
    if whole.max() > truth.hardest * 1.01 + 0.05:
        yield f"acceleration {whole.max():.2f}"
    power = truth.hardest * np.minimum(1.0, truth.switch_mps / np.maximum(mean, 1e-3))
    if (along - power).max() > 0.05 + 0.01 * truth.hardest:
        at = int(np.argmax(along - power))
        yield f"acceleration {along[at]:.2f} at {mean[at]:.1f} m/s, power gives {power[at]:.2f}"
    moving = mean > 0.5
    steering = np.arctan2(truth.wheelbase * turn, mean * _STEP_S)
    if moving.any() and np.abs(steering[moving]).max() > truth.steering + 0.02:
        yield f"steering {np.abs(steering[moving]).max():.2f}"
    both = moving[1:] & moving[:-1]
    rates = np.abs(np.diff(steering)) / _STEP_S
    if both.any() and rates[both].max() > truth.rate * 1.02 + 0.02:
        yield f"steering rate {rates[both].max():.2f}"
    middle = heading[:-1] + turn / 2
    ahead = np.column_stack([np.cos(heading), np.sin(heading)])
    moved = np.diff(center - truth.rear * ahead, axis=0)
    aside = np.abs(moved[:, 1] * np.cos(middle) - moved[:, 0] * np.sin(middle))
    if aside.max() > _SLIDE_M:
        yield f"the rear axle slides {aside.max():.3f} m in a step"


def _text(answer: object) -> str:
    return "\n".join(getattr(part, "text", "") for part in getattr(answer, "content", ()))


def _image(answer: object) -> Array:
    """Return the picture of an answer, shape (height, width, 3)."""
    from PIL import Image

    data = next(part.data for part in getattr(answer, "content", ()) if getattr(part, "type", "") == "image")
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB"), dtype=float)


def _measured_in(picture: Array) -> tuple[float, float] | None:
    """Return the ego's length and width in m, scaled by the 12 m by 2.5 m bus on the next lane, parallel to it.

    The outline takes the same number of pixels off every side, which follows from the two sides of the bus, as the
    scale does.
    """
    bus, ego = _body(picture, _YELLOW), _body(picture, _VERMILLION)
    if bus is None or ego is None:
        return None
    per_m = (bus[0] - bus[1]) / (12.0 - 2.5)
    outline = 12.0 * per_m - bus[0]
    return (ego[0] + outline) / per_m, (ego[1] + outline) / per_m


def _body(picture: Array, colour: tuple[int, int, int]) -> tuple[float, float] | None:
    """Return length and width in pixels of the largest body of a colour above the legend; its nose divides it."""
    from scipy.ndimage import find_objects, label

    like = np.abs(picture - np.array(colour, dtype=float)).max(axis=2) < 12.0
    like[int(_ABOVE_LEGEND * len(like)) :] = False
    numbers, count = label(like)
    if not count:
        return None
    sizes = np.bincount(numbers.ravel())[1:]
    found = find_objects(numbers)
    rows, columns = found[int(np.argmax(sizes))]
    left, right, top, bottom = columns.start, columns.stop, rows.start, rows.stop
    for other_rows, other_columns in found:
        is_beside = other_rows.start >= rows.start - 3 and other_rows.stop <= rows.stop + 3
        if is_beside and other_columns.start < columns.stop + _NOSE_PX and other_columns.stop > columns.start:
            left, right = min(left, other_columns.start), max(right, other_columns.stop)
            top, bottom = min(top, other_rows.start), max(bottom, other_rows.stop)
    return float(right - left), float(bottom - top)


_WIDTH_M = 7.0


def _line(made: _Made) -> list[tuple[float, float, float]]:
    """Return points and headings of the middle of the ego's lane: straight, or with a quarter of a circle in it."""
    straight = [(float(x), 0.0, 0.0) for x in range(0, 401, 5)]
    radius = made.bend_radius_m
    if not radius:
        return straight
    begin = made.ego_x + 30.0
    before = [(float(x), 0.0, 0.0) for x in range(0, int(begin), 5)]
    turns = [math.pi / 2 * share / 30 for share in range(31)]
    arc = [(begin + radius * math.sin(a), radius * (1 - math.cos(a)), a) for a in turns]
    after = [(begin + radius, radius + 5.0 * step, math.pi / 2) for step in range(1, 40)]
    return [*before, *arc, *after]


def _goal_at(made: _Made) -> tuple[float, float, float]:
    """Return the goal's position along the lane, by its distance from the ego's start."""
    left = made.goal_m
    points = [point for point in _line(made) if made.bend_radius_m or point[0] >= made.ego_x]
    points = [point for point in points if point[0] >= made.ego_x or point[2] > 0]
    for (x, y, _), after in itertools.pairwise(points):
        left -= math.hypot(after[0] - x, after[1] - y)
        if left <= 0:
            return after
    return points[-1]


def _xml(made: _Made) -> str:
    """Return the scenario as a CommonRoad file, with a second lane to the left if the road is straight."""
    lines = [
        "<?xml version='1.0' encoding='UTF-8'?>",
        (
            f'<commonRoad timeStepSize="0.1" commonRoadVersion="2020a" author="bench" affiliation="none" '
            f'source="by hand" benchmarkID="{made.name}" date="2020-01-01">'
        ),
        "<location><geoNameId>-999</geoNameId><gpsLatitude>999</gpsLatitude><gpsLongitude>999</gpsLongitude></location>",
        "<scenarioTags><urban/></scenarioTags>",
    ]
    line = _line(made)
    beside = "" if made.bend_radius_m else '<adjacentLeft ref="102" drivingDir="same"/>'
    lines.append(_lanelet(101, line, 0.0, beside))
    if not made.bend_radius_m:
        lines.append(_lanelet(102, line, _WIDTH_M, '<adjacentRight ref="101" drivingDir="same"/>'))
    kept = () if made.bend_radius_m else made.others
    lines += [_vehicle(number, made, *other) for number, other in enumerate(kept, start=1)]
    says = f'<?plannerforge ego-class="{made.ego_class}"?>' if made.ego_class not in ("", "car") else ""
    gx, gy, heading = _goal_at(made)
    lines.append(
        f'<planningProblem id="900">{says}<initialState>{_point(made.ego_x, 0.0)}<orientation><exact>0.0</exact>'
        f"</orientation><time><exact>0</exact></time><velocity><exact>{made.speed:.4f}</exact></velocity>"
        "<yawRate><exact>0.0</exact></yawRate><slipAngle><exact>0.0</exact></slipAngle></initialState>"
        f"<goalState><time><intervalStart>1</intervalStart><intervalEnd>{made.last_step}</intervalEnd></time><position>"
        f"<rectangle><length>12.0</length><width>6.0</width><orientation>{heading:.6f}</orientation>"
        f"<center><x>{gx:.4f}</x><y>{gy:.4f}</y></center></rectangle></position></goalState></planningProblem>"
    )
    return "\n".join([*lines, "</commonRoad>", ""])


def _lanelet(key: int, line: Sequence[tuple[float, float, float]], aside_m: float, beside: str) -> str:
    bounds = []
    for name, offset in (("leftBound", aside_m + _WIDTH_M / 2), ("rightBound", aside_m - _WIDTH_M / 2)):
        points = "".join(
            f"<point><x>{x - math.sin(h) * offset:.4f}</x><y>{y + math.cos(h) * offset:.4f}</y></point>"
            for x, y, h in line
        )
        bounds.append(f"<{name}>{points}</{name}>")
    return f'<lanelet id="{key}">{"".join(bounds)}{beside}<laneletType>urban</laneletType></lanelet>'


def _point(x: float, y: float) -> str:
    return f"<position><point><x>{x:.4f}</x><y>{y:.4f}</y></point></position>"


def _vehicle(number: int, made: _Made, kind: str, size_m: tuple[float, float], x: float, y: float) -> str:
    """Return a vehicle that drives straight on at the ego's initial speed, or a parked one."""
    head = (
        f"<type>{kind}</type><shape><rectangle><length>{size_m[0]}</length><width>{size_m[1]}</width></rectangle>"
        "</shape>"
    )

    def state(step: int) -> str:
        return (
            f"{_point(x + made.speed * _STEP_S * step, y)}<orientation><exact>0.0</exact></orientation>"
            f"<time><exact>{step}</exact></time><velocity><exact>{made.speed:.4f}</exact></velocity>"
        )

    if kind == "parkedVehicle":
        still = f"{_point(x, y)}<orientation><exact>0.0</exact></orientation><time><exact>0</exact></time>"
        return f'<staticObstacle id="{number}">{head}<initialState>{still}</initialState></staticObstacle>'
    states = "".join(f"<state>{state(step)}</state>" for step in range(1, made.last_step + 1))
    return (
        f'<dynamicObstacle id="{number}">{head}<initialState>{state(0)}</initialState>'
        f"<trajectory>{states}</trajectory></dynamicObstacle>"
    )
