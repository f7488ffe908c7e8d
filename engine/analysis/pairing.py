"""Which runs belong together: the same problem under the same conditions on both sides."""

from dataclasses import dataclass

from plannerforge.schemas.comparison import Side
from plannerforge.schemas.errors import InvalidRequest
from plannerforge.schemas.runs import RunRecord

Key = tuple[str, int, str, str, int]


@dataclass(frozen=True)
class Pairing:
    """Pairs (before, after) in the order of their scenarios; what could not be paired is counted.

    ``invalid``: pairs in which a run could not be attempted.
    """

    pairs: tuple[tuple[RunRecord, RunRecord], ...]
    unpaired: int
    invalid: int


def key_of(record: RunRecord) -> Key:
    """What two runs must share to be compared."""
    return (record.scenario_id, record.problem_id, record.prediction, record.traffic, record.seed)


def pair(before: Side, after: Side, records: dict[str, RunRecord]) -> Pairing:
    """Pair the runs of two sides.

    Raises:
        InvalidRequest: a side holds two runs of the same problem under the same conditions.
    """
    first, second = (_by_key(side, records) for side in (before, after))
    shared = sorted(first.keys() & second.keys())
    both = [(first[key], second[key]) for key in shared]
    valid = tuple(found for found in both if "invalid" not in (found[0].outcome, found[1].outcome))
    return Pairing(valid, len(first) + len(second) - 2 * len(shared), len(both) - len(valid))


def _by_key(side: Side, records: dict[str, RunRecord]) -> dict[Key, RunRecord]:
    found: dict[Key, RunRecord] = {}
    for run_id in side.run_ids:
        record = records[run_id]
        other = found.get(key_of(record))
        if other is not None and other.run_id != run_id:
            raise InvalidRequest(
                f"{side.label} holds {other.run_id} and {run_id}, both on {record.scenario_id}: which one is meant",
                next_step="compare batches, or name single runs",
            )
        found[key_of(record)] = record
    return found
