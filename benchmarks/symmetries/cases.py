"""Cases of one file, one relation and one judge: the law of the relation compares the answers before and after.

A difference that a law permits is *stated*: ``docs/symmetries.md`` gives the reason for each, and this module its name.
"""

import random
import re
import tempfile
import traceback
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from plannerforge.schemas.errors import PlannerForgeError

from .answers import CHEAP, DEAR, DESCRIPTION_M, PLACE_M, Answer, TranslatedFile, canonical, drawn_edit, rewritten
from .relations import RELATIONS, DoesNotApply, Frame, Relation, read_root, write_root

DOCUMENT = "document"
SHOWN = 6
"""Differences that a failed case names."""


@dataclass(frozen=True)
class Case:
    """One comparison: ``differences`` that the law forbids (empty if it holds), and stated ones."""

    file: str
    relation: str
    judge: str
    differences: tuple[str, ...] = ()
    stated: tuple[str, ...] = ()


@dataclass(frozen=True)
class Task:
    """The work on one file: relations, and the judges of each in addition to the cheap ones."""

    path: Path
    seed: int
    judges: Mapping[str, tuple[str, ...]]


def measure(task: Task) -> list[Case]:
    """Return all cases of a task; a relation that changes nothing in the file has none."""
    cases: list[Case] = []
    root = read_root(task.path)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        original = folder / task.path.name
        write_root(root, original)
        edit = drawn_edit(original, random.Random(f"{task.seed} {task.path.name}")) if _asks_edit(task) else None  # noqa: S311
        before: dict[str, Answer] = {}
        for relation_name, judges in task.judges.items():
            relation, seed = RELATIONS[relation_name], f"{task.seed} {relation_name} {task.path.name}"
            try:
                changed, frame = relation.applied(root, seed)
            except DoesNotApply:
                continue
            path = folder / relation_name / task.path.name
            path.parent.mkdir()
            write_root(changed, path)
            for judge in judges:
                if judge == DOCUMENT:
                    cases.append(_document_case(relation, seed, original, path, folder))
                    continue
                if judge not in before:
                    before[judge] = _answer(judge, TranslatedFile(original, Frame(), edit))
                if not before[judge]:  # the judge has nothing to say about this file
                    continue
                after = _answer(judge, TranslatedFile(path, frame, edit))
                cases.append(_case(task.path.name, relation, frame, judge, before[judge], after))
    return cases


def _asks_edit(task: Task) -> bool:
    return any("edit" in judges for judges in task.judges.values())


def _answer(judge: str, asked: TranslatedFile) -> Answer:
    """Return a judge's answer; a refusal is an answer, and so is a defect, which fails on either side."""
    try:
        return {**CHEAP, **DEAR}[judge](asked)
    except PlannerForgeError as error:
        return {"refused": (error.code, error.reason)}
    except Exception as error:  # noqa: BLE001 - a defect of the product is a difference, not the end of the bench
        return {"raised": f"{type(error).__name__}: {traceback.format_exc(limit=-2)[-400:]}"}


def _document_case(relation: Relation, seed: str, original: Path, changed: Path, folder: Path) -> Case:
    """Check that writing and changing a file commute: the document keeps everything that it does not touch."""
    one, _ = relation.applied(read_root(rewritten(original, folder)), seed)
    write_root(one, folder / "one.xml")
    same = canonical(read_root(folder / "one.xml")) == canonical(read_root(rewritten(changed, folder)))
    return Case(original.name, relation.name, DOCUMENT, () if same else ("the two orders give different files",))


def _case(file: str, relation: Relation, frame: Frame, judge: str, before: Answer, after: Answer) -> Case:
    if judge == "run":
        return _run_case(file, relation, before, after)
    differences, stated = list[str](), list[str]()
    for key in sorted({*before, *after}):
        one, other = before.get(key), after.get(key)
        if key == "raised" or not alike(one, other, _within(relation, judge)):
            reason = _stated(relation.name, frame, judge, key, before, after)
            (stated if reason else differences).append(f"{key}: {_short(one)} → {_short(other)}")
    return Case(file, relation.name, judge, tuple(differences[:SHOWN]), tuple(stated[:SHOWN]))


_SAME_COST: Final = 1e-3
"""Relative cost difference below which rounding chooses between candidates (chosen)."""
_OF_THE_PROBLEM: Final = ("invalid_reason", "first_step", "refused", "raised")


def _run_case(file: str, relation: Relation, before: Answer, after: Answer) -> Case:
    """Check that runs are equal up to the step at which rounding decides the planner's choice."""
    keys = [key for key in sorted({*before, *after}) if key not in ("costs", "planned", "rejected")]
    if relation.name == "mirrored":
        keys = [key for key in keys if key in _OF_THE_PROBLEM]
    apart = [key for key in keys if not alike(before.get(key), after.get(key), _within(relation, "run"))]
    found = tuple(f"{key}: {_short(before.get(key))} → {_short(after.get(key))}" for key in apart)
    if found and not any(key in _OF_THE_PROBLEM for key in apart) and _is_tie(before, after, _within(relation, "run")):
        return Case(file, relation.name, "run", stated=found)
    return Case(file, relation.name, "run", found)


def _is_tie(before: Answer, after: Answer, within: float) -> bool:
    """Return True if rounding decided on the first plan that is driven differently.

    That is so if the plan costs the same in both runs, or if a candidate is at a feasibility limit and rejected in one
    run alone.
    """
    count = min(len(before["positions"]), len(after["positions"]))
    away = np.linalg.norm(before["positions"][:count] - after["positions"][:count], axis=1) > within / 100
    first = int(np.argmax(away)) if away.any() else count
    plans = sum(planned < first for planned in before["planned"])
    chosen = [(answer["costs"][:plans], answer["rejected"][:plans]) for answer in (before, after)]
    if chosen[0][1] != chosen[1][1]:
        return True
    return alike(chosen[0][0], chosen[1][0], _SAME_COST)


def _short(value: Any) -> str:
    text = " ".join(str(value).split())
    return text if len(text) < 160 else f"{text[:100]} … {text[-50:]}"


DRIVEN_M: Final = {"moved": 0.05, "turned": 0.05, "rounded": 0.05, "split": 0.05}
"""Tolerance of edited vehicles and planner runs if coordinates differ: SUMO's networks have four decimals, and a
simulation accumulates the rounding.
"""
OUTCOME_ALONE: Final = frozenset({"mirrored", "shuffled_ids", "split", "other_format"})
"""Relations under which an edit has the same outcome but its vehicles drive slightly differently: SUMO draws the random
part of driving by lane, prefers the right lane, and ends a lane at the end of a lanelet.
"""
OUTCOME: Final = frozenset({"op", "refused", "raised", "done", "removed"})


def _within(relation: Relation, judge: str) -> float:
    if judge == "rules" and relation.within:
        return max(PLACE_M, relation.within)
    if judge == "description" and relation.within:
        return DESCRIPTION_M
    if judge in ("edit", "run"):
        return DRIVEN_M.get(relation.name, relation.within)
    return relation.within


def alike(one: Any, other: Any, within: float) -> bool:
    """Return True if two values are equal: numbers within a tolerance (relative beyond 1), everything else exactly."""
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        if np.shape(one) != np.shape(other):
            return False
        apart = np.abs(np.asarray(one) - np.asarray(other))
        both_missing = np.isnan(np.asarray(one)) & np.isnan(np.asarray(other))
        return bool(np.all(both_missing | (apart <= within)))
    if isinstance(one, bool) or isinstance(other, bool):
        return one is other
    if isinstance(one, float) and isinstance(other, float):
        return one == other or abs(one - other) <= within * max(1.0, abs(one))
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(alike(a, b, within) for a, b in zip(one, other, strict=True))
    return bool(one == other)


_OF_FORKS: Final = frozenset({"ego_turns_left", "ego_turns_right", "ego_goes_straight", "intersection"})
_NO_SUCH_BRANCH: Final[Answer] = {"refused": ("not_possible", "")}
"""The answer to a reroute without a matching branch; other refusals have another code or a reason."""
_ONLY_IN_2020A: Final = frozenset(
    ("format_version", "coordinates", "signs_map", "lights_map", "signs", "traffic_light", "participants")
)
"""Facts that a file of 2018b cannot express (among signs it has speed limits)."""
_OF_SIGNS_AND_JUNCTIONS: Final = re.compile(
    r"\w+ (\w*sign\w*|\w*light\w*|stop_line\w*|phase_without_duration|unknown_colour|implausible_speed_limit"
    r"|\w*incoming\w*|unknown_lanelet_at_intersection|repeated_id) "
)
_OF_WHOLE_LANELETS: Final = re.compile(
    r"\w+ (bounds_swapped|too_short|too_narrow|too_wide|too_tight|neighbour_direction|neighbour_apart"
    r"|overlapping_lanelets|isolated_lanelet|stop_line_at_beginning|sign_far_away|neighbour_on_both_sides) "
)
"""Rules that judge a lanelet by its length, its middle or most of it."""


def _stated(relation: str, frame: Frame, judge: str, key: str, before: Answer, after: Answer) -> str:
    """Return why a law does not hold here, empty if it should."""
    name = key.rpartition(": ")[2]
    if judge == "edit" and relation in OUTCOME_ALONE and key not in OUTCOME:
        return "SUMO drives somewhat otherwise"
    if relation in ("later", "other_format") and key == "schema_valid":
        return "the schema is that of 2020a, and wants every first state at step 0"
    if relation == "other_format":
        if judge == "facts" and name in _ONLY_IN_2020A:
            return "2018b has no words for it"
        if judge == "rules" and _OF_SIGNS_AND_JUNCTIONS.match(key):
            return "2018b has no signs, lights and junctions"
    if relation == "split" and (name == "route" or (judge == "description" and _other_route(before, after))):
        route = "ego route" if judge == "description" else key
        one, other = before.get(route) or (0,), after.get(route) or (0,)
        return "lengths of lanelets choose between equal ways" if (len(one), one[-1]) == (len(other), other[-1]) else ""
    if relation == "shuffled_ids" and name == "route":
        one, other = before.get(key) or (), after.get(key) or ()
        is_tie = len(one) == len(other) > 0 and one[:-1] == other[:-1]
        return "of goal lanelets that are equally far, the id chooses" if is_tie else ""
    if relation == "split" and judge == "features":
        other = {*before.get(key, ())} ^ {*after.get(key, ())}
        return "turns and crossings follow from lanelets that share a fork" if other <= _OF_FORKS else ""
    if relation == "split" and judge == "edit" and before.get("op") == "reroute" and after == _NO_SUCH_BRANCH:
        return "a turn follows from the lanelet that leaves a fork"
    if relation == "split":
        lanelets = before.get(f"{key.removesuffix(name)}lanelets", ()) if judge == "facts" else ()
        if name in ("signs", "traffic_light") and frame.cut & set(lanelets):
            return "the ego begins on the first part, and they stand at the end of the second"
        if (
            judge == "rules"
            and _OF_WHOLE_LANELETS.match(key)
            and frame.cut & {int(one) for one in re.findall(r"\d+", key)}
        ):
            return "the rule concerns a whole lanelet, and there are two"
    return ""


def _other_route(before: Answer, after: Answer) -> bool:
    return bool(before.get("ego route") != after.get("ego route"))


def tasks(files: Sequence[Path], cases: int, seed: int, *, dear: bool = True) -> Iterator[Task]:
    """Return tasks with about as many cases: every file in turn with some relations, so that each relation meets many
    files.
    """
    names, cheap = sorted(RELATIONS), (*CHEAP, DOCUMENT)
    draw = random.Random(seed)  # noqa: S311 - nothing secret
    each = max(1, -(-cases // (len(cheap) * max(len(files), 1))))
    for path in files:
        start = zlib.crc32(f"{seed} {path.name}".encode())
        chosen = [names[(start + index) % len(names)] for index in range(min(each, len(names)))]
        judges: dict[str, tuple[str, ...]] = dict.fromkeys(chosen, cheap)
        if dear:
            judges[chosen[0]] = (*cheap, draw.choice(sorted(DEAR)))
        yield Task(path, seed, judges)
