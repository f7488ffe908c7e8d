"""Sets of entries as bits: they are sets of numbers, in the order of ids, and follow the catalogue's changes."""

from array import array

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.catalog import catalogue, facts

from plannerforge.engine.catalog.entry_sets import Entries, Postings
from plannerforge.engine.catalog.search import Search
from plannerforge.engine.catalog.tables import add_facts
from plannerforge.schemas.catalog import FindScenariosArguments

catalogues = st.lists(st.integers(0, 40_000), unique=True, max_size=60)
ANY_OF = "SELECT number FROM catalog_words WHERE kind = 'tag' AND word = ?"


@given(catalogues, st.sets(st.integers(-3, 41_000)), st.sets(st.integers(0, 41_000)))
def test_sets_of_entries_are_sets_of_their_numbers(numbers: list[int], some: set[int], others: set[int]) -> None:
    entries, there = Entries(array("q", numbers)), set(numbers)
    some = {number for number in some if number >= 0} | set(numbers[::3])
    others |= set(numbers[::2])
    one, other = entries.of(some), entries.of(others)
    assert set(one) == some & there
    assert len(one) == len(some & there)
    assert bool(one) == bool(some & there)
    assert set(one & other) == some & others & there
    assert set(one | other) == (some | others) & there
    assert set(one - other) == (some - others) & there
    assert (one <= other) == (some & there <= others)
    assert [number in one for number in range(-2, 50)] == [number in some & there for number in range(-2, 50)]
    assert set(entries.all) == there


@given(catalogues)
def test_the_first_entries_have_the_first_ids(numbers: list[int]) -> None:
    entries = Entries(array("q", numbers))
    assert list(entries.all) == numbers
    assert entries.of(reversed(numbers)).first(7) == numbers[:7]
    assert [entries.place(number) for number in numbers] == list(range(len(numbers)))


def test_the_cache_follows_the_catalogue() -> None:
    connection, postings = catalogue([facts("DEU_B-1_1_T-1", tags=["urban"])]), Postings()
    before = postings.entries(connection)
    assert list(postings.holding(connection, before, ANY_OF, ("urban",))) == [1]
    assert postings.entries(connection) is before
    add_facts(connection, 5, facts("DEU_A-1_1_T-1", tags=["urban"]))
    after = postings.entries(connection)
    assert list(postings.holding(connection, after, ANY_OF, ("urban",))) == [5, 1]
    assert list(postings.holding(connection, before, ANY_OF, ("urban",))) == [1]
    connection.execute("DELETE FROM catalog_scenarios WHERE number = 1")
    assert list(postings.entries(connection).all) == [5]


def test_a_column_is_in_the_order_of_ids_with_gaps_for_missing_values() -> None:
    connection, postings = catalogue([facts("DEU_B-1_1_T-1"), facts("DEU_A-1_1_T-1")]), Postings()
    connection.execute("UPDATE catalog_scenarios SET ttc_s = 2.5 WHERE number = 2")
    connection.execute("UPDATE catalog_scenarios SET ttc_s = NULL WHERE number = 1")
    assert str(list(postings.column(connection, postings.entries(connection), "ttc_s"))) == "[2.5, nan]"


@pytest.mark.parametrize("sort", ["match", "size", "criticality"])
def test_the_first_of_many_matches_follow_the_whole_order(monkeypatch: pytest.MonkeyPatch, sort: str) -> None:
    made = [facts(f"DEU_T-{number}_1_T-1", counts={"car": number * 7 % 31 + 1}) for number in range(1, 60)]
    connection, arguments = catalogue(made), FindScenariosArguments.model_validate({"sort": sort})
    whole = Search(connection, arguments).find(None)
    monkeypatch.setattr("plannerforge.engine.catalog.search.MOST_KEPT", 10)
    first = Search(connection, arguments).find(None)
    assert first.matches == whole.matches[:10]
    assert first.total == whole.total == 59
