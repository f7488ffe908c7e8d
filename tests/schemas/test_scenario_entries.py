"""What the catalogue keeps of a scenario grows with the number of its planning problems, not with its square."""

from support.catalog import facts

from plannerforge.schemas.scenarios import ScenarioFacts


def with_problems(count: int) -> ScenarioFacts:
    one = facts()
    assert one.ego is not None
    return one.model_copy(
        update={"egos": tuple(one.ego.model_copy(update={"problem_id": number}) for number in range(count))}
    )


def stored_characters(count: int) -> int:
    return sum(len(entry.model_dump_json()) for entry in with_problems(count).entries())


def test_twice_the_problems_take_twice_the_room() -> None:
    assert stored_characters(80) < 2.1 * stored_characters(40)


def test_an_entry_has_its_own_ego() -> None:
    first, *others = with_problems(3).entries()
    assert [ego.problem_id for ego in first.egos] == [0]
    assert [(entry.scenario_id, entry.egos[0].problem_id) for entry in others] == [
        ("DEU_Munich-1_1_T-1#1", 1),
        ("DEU_Munich-1_1_T-1#2", 2),
    ]


def test_the_entry_of_a_problem_is_that_of_the_catalogue() -> None:
    whole = with_problems(3)
    assert whole.seen_by(2) == whole.entries()[2]
    assert whole.seen_by(0).ego == whole.entries()[0].ego
