"""Checks the kind and the preventability of collisions on synthetic encounters.

The seed draws 12 collisions of each kind: a recorded follower, a standing ego, a slower or standing leader, a braking
leader, a cut-in, a crossing vehicle and an oncoming one. The construction determines the kind and the sides that meet.
This module shares no code with the product: it decides whether full braking prevents the collision by trying every
start in steps of 5 ms, with separating axes for overlaps, until 30 s after the contact. ``loop.verdicts`` judges
the other drivers.

Keys:

- ``class_right``: share of collisions reported with the right kind.
- ``fault_right``: share reported correctly as preventable or not, among the clear cases.
- ``braking_until_error_s``: largest error of the latest start of braking.
- ``causes_collisions``: number of collisions; ``unclear``: collisions left out of ``fault_right``, because 2 % more
  speed or 0.1 m more width changes the truth.
- ``recorded_class_right``, ``recorded_fault_right``: the same for collisions of Frenetix and IDM on the public
  scenarios. The second covers each verdict on full braking, the careful and the fuzzy driver and RSS just before the
  contact; the truth comes from ``recorded`` and ``recorded_drivers``.
- ``recorded_collisions``, ``recorded_verdicts``, ``recorded_unclear``: numbers of collisions, verdicts and verdicts
  left out.

``loop.verdicts`` judges the drivers from the start of a scenario.
"""

import math
import random
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import anyio
import numpy as np

from plannerforge.engine.analysis import review_runs
from plannerforge.engine.execution import silent
from plannerforge.schemas.measures import RunMetrics
from plannerforge.schemas.reviews import ContactKind, RunReview
from plannerforge.schemas.runs import CollisionRecord, DrivenObstacle, ReviewRequest, RunRecord, RunSource, RunSteps

from ..harness import Figures, SeededBench, share
from .recorded import Array, Hit, corners, kind_of, public_hits, side_of
from .recorded_drivers import DRIVERS, prevented_by

STEP_S, FINE_S = 0.1, 0.005
LENGTH_M, WIDTH_M = 4.508, 1.61
FULL_MPS2, JERK_MPS3 = 0.774 * 9.81, 12.65
HORIZON_S, AFTER_S = 12.0, 30.0
Pose = tuple[float, float, float]
"""x, y in m and heading in rad."""


@dataclass(frozen=True)
class Body:
    """A motion in closed form: position and speed at a time."""

    pose: Callable[[float], Pose]
    speed: Callable[[float], float]


@dataclass(frozen=True)
class Made:
    """An encounter: the kind that it is, the ego's speed along the x axis, and the other."""

    kind: ContactKind
    ego_mps: float
    other: Body


def straight(x: float, y: float, heading: float, speed: float) -> Body:
    """Return a straight motion at constant speed."""
    along, across = math.cos(heading), math.sin(heading)
    return Body(lambda t: (x + speed * t * along, y + speed * t * across, heading), lambda _: speed)


def braking(x: float, speed: float, begins: float, by: float) -> Body:
    """Return a motion along the x axis that brakes to a stop from a time on."""

    def place(t: float) -> Pose:
        after = min(max(t - begins, 0.0), speed / by)
        return x + speed * min(t, begins) + speed * after - by * after**2 / 2, 0.0, 0.0

    return Body(place, lambda t: max(speed - by * max(t - begins, 0.0), 0.0))


def cutting_in(x: float, speed: float, begins: float, takes: float) -> Body:
    """Return a motion parallel to the x axis that moves evenly across to it from a time on."""

    def place(t: float) -> Pose:
        share_across = min(max((t - begins) / takes, 0.0), 1.0)
        heading = -math.atan2(3.5 / takes, speed) if begins <= t < begins + takes else 0.0
        return x + speed * t, 3.5 * (1.0 - share_across), heading

    return Body(place, lambda _: speed)


def drawn(choice: random.Random) -> Iterator[Made]:
    """Return one encounter of each kind; not all of them end in a collision."""
    ego, other = choice.uniform(4, 14), choice.uniform(3, 12)
    aside = choice.uniform(-0.6, 0.6)
    yield Made("rear_end_by_other", ego, straight(-choice.uniform(8, 25), 0.0, 0.0, ego + choice.uniform(3, 9)))
    yield Made("onto_standing_ego", 0.0, straight(-choice.uniform(10, 30), aside, 0.0, other))
    yield Made("rear_end_by_ego", ego + 4, straight(choice.uniform(10, 60), 0.0, 0.0, choice.uniform(0.5, ego)))
    yield Made("into_standing", ego, straight(choice.uniform(8, 50), aside, 0.0, 0.0))
    gap, begins, force = choice.uniform(8, 20), choice.uniform(0.5, 2), choice.uniform(1.5, 4)
    yield Made("rear_end_by_ego", ego, braking(gap, ego, begins, force))
    slower, begins, takes = ego + 6 - choice.uniform(3, 5.5), choice.uniform(0.2, 1.0), choice.uniform(1.0, 2.0)
    yield Made("cut_in", ego + 6, cutting_in(choice.uniform(5.5, 20), slower, begins, takes))
    met, side = choice.uniform(15, 40), choice.choice((-1.0, 1.0))
    yield Made("crossing", ego, straight(met, -side * other * met / ego, side * math.pi / 2, other))
    yield Made("oncoming", ego, straight(choice.uniform(40, 90), aside, math.pi, other))


def overlap(one: Pose, other: Pose, more_m: float = 0.0) -> bool:
    """Return True if two cars overlap (separating axes), with the second one enlarged by a margin on every side."""
    corners = [_corners(one, 0.0), _corners(other, more_m)]
    for _, _, heading in (one, other):
        for axis in (heading, heading + math.pi / 2):
            along = math.cos(axis), math.sin(axis)
            spans = [[x * along[0] + y * along[1] for x, y in box] for box in corners]
            if max(spans[0]) < min(spans[1]) or max(spans[1]) < min(spans[0]):
                return False
    return True


def _corners(pose: Pose, more_m: float) -> list[tuple[float, float]]:
    x, y, heading = pose
    ahead, aside = LENGTH_M / 2 + more_m, WIDTH_M / 2 + more_m
    cosine, sine = math.cos(heading), math.sin(heading)
    return [(x + a * cosine - b * sine, y + a * sine + b * cosine) for a in (-ahead, ahead) for b in (-aside, aside)]


def first_touch_s(made: Made, step_s: float = STEP_S) -> float | None:
    """Return when the ego at constant speed first overlaps the other at a step; None if never, or from the start."""
    for step in range(round(HORIZON_S / step_s)):
        t = step * step_s
        if overlap((made.ego_mps * t, 0.0, 0.0), made.other.pose(t)):
            return t if step > 5 else None
    return None


def kind_at(made: Made, touch_s: float) -> ContactKind:
    """Return the kind of an encounter one step before contact: a leader may stand, a cut-in may still be alongside."""
    before = touch_s - STEP_S
    x, y, heading = made.other.pose(before)
    if made.kind == "rear_end_by_ego" and made.other.speed(before) < 0.1:
        return "into_standing"
    if made.kind == "cut_in":
        return _kind_of_cut_in(np.array([made.ego_mps * before, 0.0, 0.0]), np.array([x, y, heading]))
    return made.kind


def _kind_of_cut_in(own: Array, other: Array) -> ContactKind:
    """Return the kind of a collision with a vehicle that cuts in, by the sides that met."""
    size = np.array([LENGTH_M, WIDTH_M])
    ours = side_of(own, size, corners(other, size))
    if ours == "front":
        return "cut_in"
    return "rear_end_by_other" if ours == "rear" else "side"


def braked_m(speed: float, begins: float) -> list[float]:
    """Return the distance covered at each fine step by an ego that brakes fully from a time on."""
    way, stations, force = 0.0, [0.0], 0.0
    for step in range(round((HORIZON_S + AFTER_S) / FINE_S)):
        if step * FINE_S >= begins:
            force = min(force + JERK_MPS3 * FINE_S, FULL_MPS2)
            speed = max(speed - force * FINE_S, 0.0)
        way += speed * FINE_S
        stations.append(way)
    return stations


def latest_braking_s(made: Made, touch_s: float, more_m: float = 0.0) -> float | None:
    """Return the latest time, in run steps, from which full braking keeps the ego clear until after the contact."""
    others = {i: made.other.pose(i * FINE_S) for i in range(0, round((touch_s + AFTER_S) / FINE_S), 4)}
    near = {i: pose for i, pose in others.items() if abs(pose[1]) < 2 * LENGTH_M}
    for step in range(round(touch_s / STEP_S), -1, -1):
        stations = braked_m(made.ego_mps, step * STEP_S)
        meets = ((stations[i], pose) for i, pose in near.items() if abs(stations[i] - pose[0]) < 2 * LENGTH_M)
        if not any(overlap((station, 0.0, 0.0), pose, more_m) for station, pose in meets):
            return round(step * STEP_S, 9)
    return None


def told(made: Made, touch_s: float, folder: Path) -> RunReview:
    """Return the product's statements about a run of this encounter."""
    steps = range(round(touch_s / STEP_S) + 1)
    shown = [made.other.pose(step * STEP_S) for step in range(len(steps) + round(AFTER_S / STEP_S) + 1)]
    other = DrivenObstacle(
        obstacle_id=7,
        kind="car",
        length_m=LENGTH_M,
        width_m=WIDTH_M,
        first_step=0,
        x_m=tuple(x for x, _, _ in shown),
        y_m=tuple(y for _, y, _ in shown),
        heading_rad=tuple(heading for _, _, heading in shown),
        speed_mps=tuple(made.other.speed(step * STEP_S) for step in range(len(shown))),
    )
    driven = RunSteps(
        first_step=0,
        x_m=tuple(made.ego_mps * step * STEP_S for step in steps),
        y_m=(0.0,) * len(steps),
        heading_rad=(0.0,) * len(steps),
        speed_mps=(made.ego_mps,) * len(steps),
        acceleration_mps2=(0.0,) * len(steps),
        plan_steps=(),
        costs={},
        others=(other,),
    )
    path = folder / "steps.json"
    path.write_text(driven.model_dump_json(), encoding="utf-8")
    record = _record(touch_s, made.ego_mps)
    request = ReviewRequest(runs=(RunSource(record=record, steps_path=str(path)),), scenarios=())
    return review_runs(request, silent).reviews[0]


def _record(touch_s: float, speed: float) -> RunRecord:
    return RunRecord(
        run_id="run_made",
        scenario_id="ZAM_Made-1_1_T-1",
        problem_id=1,
        config_id="cfg_made",
        config_name="made",
        planner="made",
        prediction="constant_velocity",
        traffic="recorded",
        seed=0,
        step_s=STEP_S,
        outcome="collision",
        reason="made",
        collision=CollisionRecord(obstacle_id=7, kind="car", step=round(touch_s / STEP_S), time_s=touch_s),
        rejected_candidates={},
        metrics=RunMetrics(
            duration_s=touch_s,
            distance_m=speed * touch_s,
            mean_speed_mps=speed,
            minimum_distance_m=0.0,
            minimum_time_to_collision_s=0.0,
            maximum_jerk_mps3=0.0,
            mean_squared_jerk=0.0,
            maximum_lateral_acceleration_mps2=0.0,
            mean_total_cost=None,
        ),
        ego_length_m=LENGTH_M,
        ego_width_m=WIDTH_M,
    )


def measure(bench: SeededBench) -> Figures:
    """Measure the keys above on 12 synthetic collisions of each kind (or the bench's limit) and all recorded ones."""
    figures = dict(compared(bench.seed, bench.limit or 12, bench.folder("causes")))
    hits, contacts = anyio.run(public_hits, bench)
    return figures | _of_recorded(hits, contacts)


def _of_recorded(hits: Sequence[Hit], contacts: Mapping[str, Mapping[str, Any] | None]) -> dict[str, float]:
    """Return the figures of collisions on public scenarios."""
    classes, faults, unclear = list[bool](), list[bool](), 0
    for hit in hits:
        contact, kind = contacts[hit.record.run_id], kind_of(hit)
        classes.append(contact is not None and contact["kind"] == kind)
        if not classes[-1]:
            sys.stderr.write(f"{hit.record.run_id} {hit.record.scenario_id}: truth {kind}, told {contact}\n")
        prevention = None if contact is None else contact["prevention"]
        verdicts = [] if prevention is None else prevention["drivers"]
        told = {one["driver"]: one for one in verdicts if one["start"] == "before_contact"}
        for driver in DRIVERS:
            truth = prevented_by(hit, driver)
            if truth is None:
                unclear += 1
                continue
            faults.append(driver in told and told[driver]["prevents"] == truth)
            if not faults[-1]:
                where = f"{hit.record.run_id} {hit.record.scenario_id} ({kind})"
                sys.stderr.write(f"{where}: {driver} prevents it: {truth}, told {told.get(driver)}\n")
    return {
        "recorded_class_right": share(classes),
        "recorded_fault_right": share(faults),
        "recorded_collisions": len(classes),
        "recorded_verdicts": len(faults),
        "recorded_unclear": unclear,
    }


def compared(seed: int, each: int, folder: Path) -> Figures:
    """Create the given number of collisions of each kind, and compare the statements with the truth."""
    choice = random.Random(seed)  # noqa: S311 - reproducible, not secret
    classes: list[bool] = []
    faults: list[bool] = []
    errors: list[float] = []
    unclear = 0
    counts: dict[int, int] = {}
    while min(counts.values(), default=0) < each:
        for number, made in enumerate(drawn(choice)):
            touch = first_touch_s(made)
            if touch is None or counts.setdefault(number, 0) >= each:
                continue
            counts[number] += 1
            contact = told(made, touch, folder).contact
            classes.append(contact is not None and contact.kind == kind_at(made, touch))
            if not classes[-1]:
                sys.stderr.write(f"made {made.kind}, told {contact and contact.in_words()}\n")
            truth, wider = latest_braking_s(made, touch), latest_braking_s(made, touch, 0.1)
            slower = latest_braking_s(replace(made, ego_mps=made.ego_mps * 1.02), touch)
            if not (truth is None) == (wider is None) == (slower is None):
                unclear += 1
                continue
            prevention = None if contact is None else contact.prevention
            faults.append(prevention is not None and prevention.possible == (truth is not None))
            if not faults[-1]:
                sys.stderr.write(f"{made.kind}: truth {truth}, told {contact and contact.in_words()}\n")
            until = None if prevention is None else prevention.by_braking_until_s
            if truth is not None and until is not None:
                errors.append(abs(until - truth))
    return {
        "class_right": share(classes),
        "fault_right": share(faults),
        "braking_until_error_s": round(max(errors, default=0.0), 3),
        "causes_collisions": len(classes),
        "unclear": unclear,
    }
