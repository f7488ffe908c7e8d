"""Which runs belong together: the same problem under the same conditions on both sides."""

from dataclasses import dataclass

from plannerforge.schemas.comparison import Side
from plannerforge.schemas.errors import InvalidRequest
from plannerforge.schemas.runs import RunRecord

Key = tuple[object, ...]
CONDITIONS = ("prediction", "traffic", "seed")


@dataclass(frozen=True)
class Pairing:
    """Pairs (before, after) in the order of their scenarios; what could not be paired is counted.

    ``invalid``: pairs in which a run could not be attempted; ``differing``: conditions in which the sides as a whole
    differ, such as ``prediction: constant_velocity → ground_truth``.
    """

    pairs: tuple[tuple[RunRecord, RunRecord], ...]
    unpaired: int
    invalid: int
    differing: tuple[str, ...]


def pair(before: Side, after: Side, records: dict[str, RunRecord]) -> Pairing:
    """Pair runs on the same scenario and planning problem under the same prediction, traffic mode and seed.

    A condition that is one value on all of a side and another on all of the other is what is being compared: it is
    left out of the key and named.

    Raises:
        InvalidRequest: a side holds two runs of the same problem under the same conditions.
    """
    sides = [[records[run_id] for run_id in side.run_ids] for side in (before, after)]
    differing = tuple(name for name in CONDITIONS if _differ_as_a_whole(name, *sides))
    shared_conditions = tuple(name for name in CONDITIONS if name not in differing)
    first, second = (
        _by_key(side.label, found, shared_conditions) for side, found in zip((before, after), sides, strict=True)
    )
    shared = sorted(first.keys() & second.keys(), key=repr)
    both = [(first[key], second[key]) for key in shared]
    valid = tuple(found for found in both if "invalid" not in (found[0].outcome, found[1].outcome))
    return Pairing(
        pairs=valid,
        unpaired=len(first) + len(second) - 2 * len(shared),
        invalid=len(both) - len(valid),
        differing=tuple(f"{name}: {getattr(sides[0][0], name)} → {getattr(sides[1][0], name)}" for name in differing),
    )


def _differ_as_a_whole(condition: str, first: list[RunRecord], second: list[RunRecord]) -> bool:
    before, after = ({getattr(record, condition) for record in side} for side in (first, second))
    return len(before) == 1 and len(after) == 1 and before != after


def _by_key(label: str, side: list[RunRecord], conditions: tuple[str, ...]) -> dict[Key, RunRecord]:
    found: dict[Key, RunRecord] = {}
    for record in side:
        key = (record.scenario_id, record.problem_id, *(getattr(record, name) for name in conditions))
        other = found.setdefault(key, record)
        if other.run_id != record.run_id:
            raise InvalidRequest(
                f"{label} holds {other.run_id} and {record.run_id}, both on {record.scenario_id}: which one is meant",
                next_step="compare batches, or name single runs",
            )
    return found
