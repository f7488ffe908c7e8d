"""What is derived from a scenario is made once, dropped if it was not used for long, and never copied."""

import copy
import pickle

from plannerforge.engine.commonroad import MadeOnce


def counted(made: list[int]) -> int:
    """Return how often it was called."""
    made.append(1)
    return len(made)


def test_a_value_is_made_at_its_first_use_only() -> None:
    kept, calls = MadeOnce(), list[int]()
    assert kept.get("a", lambda: counted(calls)) == 1
    assert kept.get("a", lambda: counted(calls)) == 1
    assert kept.get("b", lambda: counted(calls)) == 2


def test_the_value_that_was_not_used_longest_is_dropped() -> None:
    kept, calls = MadeOnce(2), list[int]()
    for key in ("a", "b", "a", "c", "a", "b"):
        kept.get(key, lambda: counted(calls))
    assert len(calls) == 4


def test_none_counts_as_a_value() -> None:
    kept, calls = MadeOnce(), list[int]()
    for _ in range(2):
        kept.get("a", lambda: calls.append(1))
    assert len(calls) == 1


def test_copies_and_pickles_are_empty() -> None:
    kept = MadeOnce(3)
    kept.get("a", lambda: iter(()))  # cannot be copied
    for other in (copy.deepcopy(kept), pickle.loads(pickle.dumps(kept))):
        assert other.most == 3
        assert other.get("a", lambda: "anew") == "anew"
