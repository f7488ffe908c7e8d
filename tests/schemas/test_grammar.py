"""The grammar of comparisons, assignments, selectors, quantities and intervals."""

import math
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plannerforge.schemas.errors import InvalidRequest, PlannerForgeError, UnknownName
from plannerforge.schemas.grammar import (
    Assignment,
    BaseUnit,
    Condition,
    Interval,
    Selector,
    parse_assignment,
    parse_condition,
    parse_interval,
    parse_quantity,
    parse_selector,
)

NAMES = st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,15}", fullmatch=True)
NUMBERS = st.floats(allow_nan=False, allow_infinity=False, width=32).map(float)
LIKELY_TEXT = st.text(alphabet="abe0159.+-*=<>!@:/_ kmhs∞é\n", max_size=24) | st.text(max_size=24)


@pytest.mark.parametrize(
    ("text", "unit", "expected"),
    [
        ("50km/h", "m/s", 50 / 3.6),
        ("36 km/h", "m/s", 10.0),
        ("30mph", "m/s", 13.4112),
        ("13.9", "m/s", 13.9),
        ("13.9 m/s", "m/s", 13.9),
        ("50 KM/H", "m/s", 50 / 3.6),
        ("35m", "m", 35.0),
        ("1.5km", "m", 1500.0),
        ("100ft", "m", 30.48),
        ("8s", "s", 8.0),
        ("250ms", "s", 0.25),
        ("2min", "s", 120.0),
        ("-3", "", -3.0),
        (".5", "", 0.5),
        ("1e3", "", 1000.0),
    ],
)
def test_quantity_is_turned_into_the_base_unit(text: str, unit: str, expected: float) -> None:
    assert parse_quantity(text, unit) == pytest.approx(expected)  # type: ignore[arg-type]


def test_steps_are_seconds_if_the_step_is_known() -> None:
    assert parse_quantity("90steps", "s", step_s=0.1) == pytest.approx(9.0)
    with pytest.raises(InvalidRequest, match="'steps'"):
        parse_quantity("90steps", "s")


@pytest.mark.parametrize(
    ("text", "unit"),
    [("50km/h", "m"), ("50furlongs", "m/s"), ("fast", "m/s"), ("", "s"), ("1e999", ""), ("nan", ""), ("5s", "")],
)
def test_quantity_of_another_kind_is_refused_and_named(text: str, unit: str) -> None:
    with pytest.raises(InvalidRequest) as caught:
        parse_quantity(text, unit)  # type: ignore[arg-type]
    assert f"'{text}'" in caught.value.text
    assert caught.value.valid


@pytest.mark.parametrize(
    ("text", "unit", "expected"),
    [
        ("8..12s", "s", Interval(8, 12)),
        ("8s..12s", "s", Interval(8, 12)),
        ("1min..90s", "s", Interval(60, 90)),
        ("=2..5", "", Interval(2, 5)),
        ("<=3", "", Interval(None, 3)),
        (">=20", "m/s", Interval(20, None)),
        ("=3", "", Interval(3, 3, exact=True)),
        ("3", "", Interval(3, 3, exact=True)),
        ("36..72km/h", "m/s", Interval(10, 20)),
        (" 1 .. 2 ", "", Interval(1, 2)),
    ],
)
def test_interval(text: str, unit: str, expected: Interval) -> None:
    found = parse_interval(text, unit)  # type: ignore[arg-type]
    assert (found.low, found.high, found.exact) == (
        pytest.approx(expected.low),
        pytest.approx(expected.high),
        expected.exact,
    )


def test_a_reversed_interval_is_refused_with_the_right_order() -> None:
    with pytest.raises(InvalidRequest) as caught:
        parse_interval("12..8km/h", "m/s")
    assert parse_interval(caught.value.valid[0], "m/s") == parse_interval("8..12km/h", "m/s")


def test_an_interval_contains_its_ends() -> None:
    interval = Interval(1.0, 2.0)
    assert [interval.contains(value) for value in (0.99, 1.0, 1.5, 2.0, 2.01)] == [False, True, True, True, False]
    assert Interval(None, None).contains(-1e300)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("truck>=1", Condition("truck", Interval(1, None))),
        ("truck >= 1", Condition("truck", Interval(1, None))),
        ("bus=2", Condition("bus", Interval(2, 2, exact=True))),
        ("bus==2", Condition("bus", Interval(2, 2, exact=True))),
        ("car=2..5", Condition("car", Interval(2, 5))),
        ("bicycle", Condition("bicycle", Interval(1, None))),
        ("!yield", Condition("yield", Interval(1, None), negated=True)),
        ("traffic_light@map", Condition("traffic_light", Interval(1, None), scope="map")),
        ("car@ego<=3", Condition("car", Interval(None, 3), scope="ego")),
        ("outcome=collision", Condition("outcome", Interval(None, None), "collision")),
    ],
)
def test_condition(text: str, expected: Condition) -> None:
    assert parse_condition(text, words=True) == expected


def test_a_word_in_a_comparison_with_a_number_is_refused() -> None:
    with pytest.raises(InvalidRequest, match="compares with 'many', which is not a number"):
        parse_condition("car=many", whole=True)


def test_strict_condition_of_counts_moves_by_one() -> None:
    assert parse_condition("truck>1", whole=True).interval == Interval(2, None)
    assert parse_condition("truck<3", whole=True).interval == Interval(None, 2)
    assert parse_condition("ttc<3").interval == Interval(None, 3)


@pytest.mark.parametrize("text", ["truck>=1.5", "truck=0.5..2", "truck<0.1"])
def test_count_with_a_fraction_is_refused(text: str) -> None:
    with pytest.raises(InvalidRequest, match="fraction"):
        parse_condition(text, whole=True)


def test_comparison_with_a_unit() -> None:
    assert parse_condition("speed_limit=50km/h", "m/s").interval.low == pytest.approx(50 / 3.6)


@pytest.mark.parametrize("text", ["", " ", "=3", "3>=2", "truck>=", "truck>=many", "a b", "truck>=1 2", "config!=3"])
def test_malformed_comparison_is_refused_with_its_text(text: str) -> None:
    with pytest.raises(InvalidRequest) as caught:
        parse_condition(text)
    assert caught.value.valid


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("tau=0.7", Assignment("tau", "=", 0.7)),
        ("jerk*2", Assignment("jerk", "*", 2.0)),
        ("jerk+0.1", Assignment("jerk", "+", 0.1)),
        ("jerk-0.1", Assignment("jerk", "-", 0.1)),
        ("jerk = -0.1", Assignment("jerk", "=", -0.1)),
        ("jerk=lateral_jerk", Assignment("jerk", "=", None, copied_from="lateral_jerk")),
        ("jerk=1e-3", Assignment("jerk", "=", 0.001)),
    ],
)
def test_assignment(text: str, expected: Assignment) -> None:
    assert parse_assignment(text) == expected


@pytest.mark.parametrize("text", ["jerk", "jerk=", "jerk=nan", "jerk=inf", "jerk=1e999", "jerk*other", "=1", "jerk/2"])
def test_assignment_of_no_finite_number_is_refused(text: str) -> None:
    with pytest.raises(InvalidRequest) as caught:
        parse_assignment(text)
    assert "name=0.5" in caught.value.valid


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("12", Selector("id", "12")),
        ("0012", Selector("id", "12")),
        ("!12", Selector("id", "12", negated=True)),
        ("all", Selector("all")),
        ("nearest", Selector("nearest", "1")),
        ("nearest:3", Selector("nearest", "3")),
        ("one:truck", Selector("one", "truck")),
        ("class:truck", Selector("class", "truck")),
        ("new:0", Selector("new", "0")),
        ("! lead", Selector("lead", negated=True)),
    ],
)
def test_selector(text: str, expected: Selector) -> None:
    assert parse_selector(text) == expected
    assert parse_selector(str(expected)) == expected


@pytest.mark.parametrize(
    ("text", "error", "offered"),
    [
        ("neares", UnknownName, "nearest:3"),
        ("nearest:many", InvalidRequest, "nearest:1"),
        ("fastes", UnknownName, "fastest"),
        ("class:", UnknownName, "class:truck"),
        ("", UnknownName, "an id"),
        ("-3", UnknownName, "an id"),
    ],
)
def test_a_word_without_matches_is_refused_with_the_nearest(
    text: str, error: type[InvalidRequest], offered: str
) -> None:
    with pytest.raises(error) as caught:
        parse_selector(text)
    assert offered in caught.value.valid


@given(NAMES, NUMBERS, st.sampled_from("=*+-"))
def test_written_assignment_reads_back(name: str, number: float, operator: str) -> None:
    assert parse_assignment(f"{name}{operator}{number!r}") == Assignment(name, operator, number)  # type: ignore[arg-type]


@given(NAMES, NUMBERS, st.sampled_from((">=", "<=", "=")), st.booleans())
def test_written_comparison_reads_back(name: str, number: float, operator: str, negated: bool) -> None:
    expected = {">=": Interval(number, None), "<=": Interval(None, number), "=": Interval(number, number, exact=True)}[
        operator
    ]
    assert parse_condition(f"{'!' if negated else ''}{name}{operator}{number!r}") == Condition(
        name, expected, negated=negated
    )


@given(st.tuples(NUMBERS, NUMBERS).map(sorted))
def test_written_interval_reads_back(ends: list[float]) -> None:
    low, high = ends
    interval = parse_interval(f"{low!r}..{high!r}")
    assert (interval.low, interval.high) == (low, high)
    assert interval.contains(low)
    assert interval.contains(high)


@given(st.sampled_from(("m/s", "m", "s")), NUMBERS)
def test_bare_number_is_in_the_base_unit(unit: str, number: float) -> None:
    assert parse_quantity(repr(number), unit) == number  # type: ignore[arg-type]


@given(LIKELY_TEXT)
def test_arbitrary_text_is_read_or_refused_but_never_a_crash(text: str) -> None:
    for parse in (parse_condition, parse_assignment, parse_selector, parse_interval, parse_quantity):
        with suppress(PlannerForgeError):
            parse(text)


@given(LIKELY_TEXT)
def test_only_finite_numbers_are_read(text: str) -> None:
    for unit in ("m/s", "m", "s", ""):
        try:
            interval = parse_interval(text, unit)  # type: ignore[arg-type]
        except PlannerForgeError:
            continue
        assert all(end is None or math.isfinite(end) for end in (interval.low, interval.high))


@pytest.mark.parametrize("text", ["1e308km", ">=1e308km", "1..1e308km"])
def test_number_that_its_unit_makes_infinite_is_refused(text: str) -> None:
    with pytest.raises(InvalidRequest):
        parse_interval(text, "m")


@pytest.mark.parametrize("text", ["٣", "nearest:²", "²", "new:٣"])
def test_digits_of_other_scripts_never_crash(text: str) -> None:
    for parse in (parse_selector, parse_condition, parse_quantity, parse_interval, parse_assignment):
        with suppress(PlannerForgeError):
            parse(text)


@pytest.mark.parametrize(
    ("text", "low", "high"),
    [
        ("30-40 mph", 30 * 0.44704, 40 * 0.44704),
        ("30 – 40 mph", 30 * 0.44704, 40 * 0.44704),
        ("10 to 15 m/s", 10.0, 15.0),
        ("36km/h-15m/s", 10.0, 15.0),
        ("18 km/h ± 1 m/s", 4.0, 6.0),
        ("36 +/- 3.6 km/h", 9.0, 11.0),
        ("5 ± 1", 4.0, 6.0),
        ("1e-3", 1e-3, 1e-3),
        ("-2..3m/s", -2.0, 3.0),
    ],
)
def test_intervals_are_read_as_people_write_them(text: str, low: float, high: float) -> None:
    interval = parse_interval(text, "m/s")
    assert (interval.low, interval.high) == (pytest.approx(low), pytest.approx(high))


@pytest.mark.parametrize(
    ("text", "unit", "proposed"),
    [("3m", "s", ["3s"]), ("50 km", "m/s", ["50km/h"]), ("5 mpps", "m/s", ["5mps"]), ("5 xyz", "s", [])],
)
def test_a_wrong_unit_is_replaced_by_its_quotient_the_base_unit_or_a_similar_one(
    text: str, unit: BaseUnit, proposed: list[str]
) -> None:
    with pytest.raises(InvalidRequest) as refusal:
        parse_quantity(text, unit)
    assert [word for remedy in refusal.value.remedies for word in remedy.changes[0].words.values()] == proposed


@pytest.mark.parametrize("text", ["car>-3", "car=-2", "car<=-1", "car=-2..3"])
def test_a_count_is_never_compared_with_a_negative_number(text: str) -> None:
    with pytest.raises(InvalidRequest):
        parse_condition(text, whole=True)
