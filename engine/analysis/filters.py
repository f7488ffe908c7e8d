"""Conditions on runs: ``outcome=collision``, ``country=DEU``, ``minimum_distance_m<0.5``."""

from collections.abc import Callable, Sequence

from ...schemas.errors import InvalidRequest, UnknownName, closest, instead, misspelt_names, with_values
from ...schemas.grammar import Condition, Interval, parse_condition
from ...schemas.measures import metric_of_label
from ...schemas.runs import RunRecord, configuration_id
from ..commonroad import parse_benchmark_id
from .run_set import METRICS, MetricSpec, RunSet

_WORDS: dict[str, Callable[[RunRecord], Sequence[str]]] = {
    "outcome": lambda record: [record.outcome],
    "planner": lambda record: [record.planner],
    "config": lambda record: [record.config_id, configuration_id(record.config_id), record.config_name],
    "scenario": lambda record: [record.scenario_id],
    "run": lambda record: [record.run_id],
    "country": lambda record: [parse_benchmark_id(record.scenario_id)[0]],
    "city": lambda record: [parse_benchmark_id(record.scenario_id)[1]],
    "prediction": lambda record: [record.prediction],
    "traffic": lambda record: [record.traffic],
    "world": lambda record: [record.world.in_words()],
}


def _number_of(spec: MetricSpec) -> Callable[[RunSet, RunRecord], float | None]:
    return lambda _, record: spec.value(record)


_NUMBERS: dict[str, Callable[[RunSet, RunRecord], float | None]] = {
    "seed": lambda _, record: record.seed,
    "problem": lambda _, record: record.problem_id,
    "obstacles": RunSet.obstacle_count,
    **{spec.name: _number_of(spec) for spec in METRICS},
}


def matching(runs: RunSet, conditions: Sequence[str]) -> RunSet:
    """Return the runs that meet all conditions.

    Raises:
        UnknownName: no run has the field or value; the error lists the nearest valid ones.
        InvalidRequest: a condition cannot be parsed.
    """
    kept = runs.sources
    for text in conditions:
        condition = parse_condition(text, words=True)
        holds = _test(runs, condition, text)
        kept = tuple(source for source in kept if holds(source.record) != condition.negated)
    return runs.with_sources(kept)


def on_outcome(conditions: Sequence[str]) -> tuple[str, ...]:
    """Return the conditions that select runs by outcome; a success rate over this selection is meaningless."""
    return tuple(text for text in conditions if parse_condition(text, words=True).name == "outcome")


_WINDOW = "time_s"


def window_of(conditions: Sequence[str]) -> tuple[tuple[str, ...], Interval | None]:
    """Return the conditions on runs, and a timeline's interval (``time_s=2..4``), or None if there is no interval.

    Raises:
        InvalidRequest: the interval cannot be parsed or is given twice.
    """
    rest: list[str] = []
    spans: list[Interval] = []
    for text in conditions:
        condition = parse_condition(text, words=True)
        if condition.name != _WINDOW:
            rest.append(text)
        elif condition.value is not None or condition.negated:
            raise InvalidRequest(f"'{text}' is not a time interval", valid=[f"{_WINDOW}=2..4", f"{_WINDOW}>=2"])
        else:
            spans.append(condition.interval)
    if len(spans) > 1:
        raise InvalidRequest(f"{_WINDOW} is given {len(spans)} times", valid=[f"{_WINDOW}=2..4"])
    return tuple(rest), spans[0] if spans else None


def _test(runs: RunSet, condition: Condition, text: str) -> Callable[[RunRecord], bool]:
    name, is_bare = metric_of_label(condition.name), text.strip().lstrip("! ") == condition.name
    if name in _WORDS:
        if condition.value is None:
            raise _without_text(runs, name, text, is_bare=is_bare)
        return _word_test(runs, name, condition.value)
    if name not in _NUMBERS:
        raise _no_such_field(runs, name, text, is_bare=is_bare)
    if condition.value is not None:
        raise InvalidRequest(f"'{text}' compares {name}, a number, with text", valid=[f"{name}>=1", f"{name}=1..2"])

    def holds(record: RunRecord) -> bool:
        value = _NUMBERS[name](runs, record)
        return value is not None and condition.interval.contains(value)

    return holds


def _without_text(runs: RunSet, name: str, text: str, *, is_bare: bool) -> InvalidRequest:
    """Return the refusal of a field of text without a text to compare with; the error lists the field's values."""
    values = sorted({_WORDS[name](record)[0] for record in runs.records})
    valid = [f"{name}={value}" for value in values]
    return InvalidRequest(
        f"'{text}' gives no value for {name}" if is_bare else f"'{text}' compares {name} with a number; {name} is text",
        valid=valid,
        next_step="choose a value",
        remedies=[instead(text, value) for value in valid[:1]],
        complete=True,
    )


def _no_such_field(runs: RunSet, name: str, text: str, *, is_bare: bool) -> UnknownName:
    """Return the refusal of an unknown field; a bare word that is a value of a field becomes a condition on it."""
    fields = [*_WORDS, *sorted(_NUMBERS)]
    words = {field: {word for record in runs.records for word in of(record)} for field, of in _WORDS.items()}
    meant = [f"{field}={name}" for field, known in words.items() if is_bare and name in known]
    if meant:
        return UnknownName(
            f"'{text}' is a value, not a condition",
            valid=meant,
            next_step="write it as FIELD=VALUE",
            remedies=[instead(text, one) for one in meant],
            complete=True,
        )
    near = misspelt_names(name, fields)
    return UnknownName(
        f"runs have no field '{name}'",
        valid=dict.fromkeys([*near, *fields]),
        next_step="write a condition such as outcome=goal_reached, with one of these fields",
        complete=True,
    )


def _word_test(runs: RunSet, name: str, value: str) -> Callable[[RunRecord], bool]:
    wanted = {part.strip().casefold() for part in value.split("|")}
    words = {word for record in runs.records for word in _WORDS[name](record)}
    if wanted.isdisjoint(word.casefold() for word in words):
        raise UnknownName(
            f"no run here has {name} '{value}'", valid=closest(value, sorted(words)), remedies=[with_values(where=None)]
        )
    return lambda record: not wanted.isdisjoint(word.casefold() for word in _WORDS[name](record))
