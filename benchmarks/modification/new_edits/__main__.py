"""``make bench-edits``: the newer edits on scenarios of a folder, judged by independent code from the written files.

The bench takes the half of the folder with odd name digests (``--half even`` takes the other one). Each file gets one
drawn edit of each kind that it allows. Every file with lights also gets a behaviour for all of its vehicles, and the
traffic of a reactive run around a standing ego.

Keys: ``new_edits`` (carried out), ``new_edits_right`` (share of them), ``new_edits_refused``, ``red_crossed`` (driven
vehicles that cross at red without a request), ``red_judged`` (driven vehicles in files with lights), ``standing_moves``
(vehicles added with speed 0 that move), ``edit_median_s``. With ``--advice``, as in ``make bench-edits``, also those of
``benchmarks.modification.advice``: ``advice_succeeds``, ``advice_mends`` …
"""

import argparse
import hashlib
import random
import statistics
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import anyio

from plannerforge.engine.commonroad import read_scenario
from plannerforge.engine.edits import apply_edits
from plannerforge.engine.execution import silent
from plannerforge.engine.planners import EgoState
from plannerforge.engine.planners.registry import open_traffic
from plannerforge.engine.vehicles import BMW_320I
from plannerforge.schemas.errors import PlannerForgeError
from plannerforge.schemas.modification import Edit, ModificationOutcome, ModificationRequest

from ...harness import existing, print_figures, shared_scenarios
from ..advice.measure import measure_advice
from ..written_tracks import RoadUser, WrittenFile
from .motion import MOTION_KINDS, Drawn, StatedVerdicts
from .red_lights import red_crossings
from .scenes import SCENE_KINDS

_KINDS = (*MOTION_KINDS, *SCENE_KINDS)
_STEPS = 100
"""Number of examined steps of reactive traffic."""


def is_held_out(path: Path, half: str = "odd") -> bool:
    """Return True if a file belongs to a half of its folder, by the digest of its name."""
    return hashlib.sha256(path.name.encode()).digest()[0] % 2 == (half == "odd")


class _Counts:
    """The results so far."""

    def __init__(self) -> None:
        self.made: Counter[str] = Counter()
        self.wrong: list[str] = []
        self.refused: Counter[str] = Counter()
        self.reasons: list[str] = []
        self.seconds: list[float] = []
        self.red_judged = self.red_crossed = self.standing_moves = 0


def _apply(path: Path, edits: Sequence[Mapping[str, object]], folder: Path, counts: _Counts) -> ModificationOutcome:
    request = ModificationRequest(
        xml=path,
        edits=tuple(Edit.model_validate(edit) for edit in edits),
        benchmark_id="ZAM_Bench-1_1_T-1",
        output=folder,
    )
    begin = time.perf_counter()
    outcome = apply_edits(request, silent)
    counts.seconds.append(time.perf_counter() - begin)
    return outcome


def _judge(path: Path, base: WrittenFile, drawn: Drawn, folder: Path, counts: _Counts) -> None:
    name = f"{drawn.kind} {path.stem}"
    try:
        outcome = _apply(path, drawn.edits, folder, counts)
    except PlannerForgeError as refusal:
        counts.refused[drawn.kind] += 1
        counts.reasons.append(f"{name}: {refusal}")
        return
    if outcome.xml is None:
        raise ValueError("nothing was written")
    new = WrittenFile.read(outcome.xml)
    told = StatedVerdicts(
        tuple(tuple(key for key in report.vehicles if key not in base.users) for report in outcome.edits),
        tuple(report.verdict for report in outcome.edits),
        frozenset(outcome.handed_over),
    )
    counts.made[drawn.kind] += 1
    fault = drawn.judge(base, new, told)
    if fault:
        counts.wrong.append(f"{name}: {fault}")
        counts.standing_moves += drawn.kind == "standing"
    if new.lights:
        _count_red(name, new, outcome, drawn.may_cross | frozenset(told.added[0] if told.added else ()), counts)


def _count_red(
    name: str, new: WrittenFile, outcome: ModificationOutcome, may_cross: frozenset[int], counts: _Counts
) -> None:
    for vehicle in outcome.touched:
        if vehicle.cause in ("edited", "handed_over") and vehicle.vehicle_id not in may_cross:
            counts.red_judged += 1
            found = red_crossings(new, vehicle.vehicle_id, round(vehicle.from_time_s / new.step_s))
            counts.red_crossed += bool(found)
            counts.wrong += [f"red: {name}: {one}" for one in found]


def _lights(path: Path, base: WrittenFile, folder: Path, counts: _Counts) -> None:
    """Run behaviour edits of all vehicles, and the reactive traffic of a run, in a file with lights."""
    for preset in ("balanced", "aggressive"):
        edit = {"op": "set_behaviour", "vehicles": ["all"], "preset": preset}
        try:
            outcome = _apply(path, (edit,), folder / preset, counts)
        except PlannerForgeError:
            continue
        if outcome.xml is not None:
            _count_red(f"{preset} {path.stem}", WrittenFile.read(outcome.xml), outcome, frozenset(), counts)
    loaded = read_scenario(path)
    problem = loaded.problem()
    ego = EgoState.of(problem.initial_state)
    try:
        with open_traffic("reactive", loaded, problem, BMW_320I, 0) as traffic:
            for step in range(1, _STEPS):
                traffic.advance(replace(ego, step=ego.step + step, speed_mps=0.0))
            driven = traffic.driven
    except PlannerForgeError:
        return
    for track in driven:
        user = RoadUser(
            track.obstacle_id,
            track.kind,
            track.length_m,
            track.width_m,
            track.first_step,
            track.positions,
            track.headings_rad,
            track.speeds_mps,
        )
        base.users[track.obstacle_id] = user
        counts.red_judged += 1
        found = red_crossings(base, track.obstacle_id, track.first_step)
        counts.red_crossed += bool(found)
        counts.wrong += [f"red: reactive {path.stem}: {one}" for one in found]


def _main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=shared_scenarios())
    parser.add_argument("--half", choices=["odd", "even", "both"], default="odd")
    parser.add_argument("--seed", type=int, default=37)
    parser.add_argument("--limit", type=int, default=None, help="number of files (a sample)")
    parser.add_argument("--kinds", nargs="*", default=None, help="only these kinds of edits")
    parser.add_argument("--advice", type=int, default=0, help="number of refusals to draw and follow")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    files = sorted(existing(given.folder).rglob("*.xml"))
    files = [path for path in files if given.half == "both" or is_held_out(path, given.half)]
    random.Random(given.seed).shuffle(files)  # noqa: S311 - a draw, no secret
    counts = _Counts()
    for path in files[: given.limit]:
        base = WrittenFile.read(path)
        with tempfile.TemporaryDirectory() as scratch:
            for number, draw in enumerate(_KINDS):
                kind = draw.__name__.removeprefix("draw_")
                if given.kinds and kind not in given.kinds:
                    continue
                drawn = draw(base, random.Random(f"{given.seed} {path.name} {kind}"))  # noqa: S311
                if drawn is not None:
                    _judge(path, base, drawn, Path(scratch) / str(number), counts)
            if base.lights and not given.kinds:
                _lights(path, base, Path(scratch), counts)
    made = sum(counts.made.values())
    right = made - sum(not text.startswith("red: ") for text in counts.wrong)
    for line in (*counts.wrong, *(f"refused {reason}" for reason in counts.reasons)):
        sys.stderr.write(f"{line[:300]}\n")
    rows = [(kind, f"{count} made, {counts.refused[kind]} refused") for kind, count in sorted(counts.made.items())]
    figures: dict[str, float | int | str] = {
        "seed": given.seed,
        "files": len(files[: given.limit]),
        "new_edits": made,
        "new_edits_right": round(right / max(made, 1), 4),
        "new_edits_refused": sum(counts.refused.values()),
        "red_judged": counts.red_judged,
        "red_crossed": counts.red_crossed,
        "standing_moves": counts.standing_moves,
        "edit_median_s": round(statistics.median(counts.seconds or [0.0]), 3),
    }
    if given.advice:
        figures |= anyio.run(measure_advice, existing(given.folder), given.half, given.seed, given.advice)
    print_figures("Edits", figures, [*rows, *((key, str(value)) for key, value in figures.items())])
    return 0


if __name__ == "__main__":
    sys.exit(_main())
