"""Conditions on runs: ``outcome=collision``, ``country=DEU``, ``minimum_distance_m<0.5``."""

from collections.abc import Callable, Sequence

from ...schemas.errors import InvalidRequest, UnknownName, closest
from ...schemas.grammar import Condition, parse_condition
from ...schemas.runs import RunRecord
from .evidence import Evidence, country_of, place_of
from .outcomes import METRICS, metric_value

_WORDS: dict[str, Callable[[RunRecord], Sequence[str]]] = {
    "outcome": lambda record: [record.outcome],
    "planner": lambda record: [record.planner],
    "config": lambda record: [record.config_id, record.config_name],
    "scenario": lambda record: [record.scenario_id],
    "run": lambda record: [record.run_id],
    "country": lambda record: [country_of(record.scenario_id)],
    "city": lambda record: [place_of(record.scenario_id)],
    "prediction": lambda record: [record.prediction],
    "traffic": lambda record: [record.traffic],
}
_METRIC_NAMES = {spec.name for spec in METRICS}
_NUMBERS = sorted({"seed", "problem", "obstacles", *_METRIC_NAMES})


def matching(evidence: Evidence, conditions: Sequence[str]) -> Evidence:
    """The runs that meet all conditions.

    Raises:
        UnknownName: a field or a value that no run has; the nearest are named.
        InvalidRequest: a condition that cannot be read.
    """
    kept = evidence.sources
    for text in conditions:
        condition = parse_condition(text)
        wanted = _test(evidence, condition, text)
        kept = tuple(source for source in kept if wanted(source.record) != condition.negated)
    return Evidence(kept, evidence.configs, evidence.scenarios)


def _test(evidence: Evidence, condition: Condition, text: str) -> Callable[[RunRecord], bool]:
    name = condition.name
    if name in _WORDS:
        if condition.value is None:
            raise InvalidRequest(f"'{text}' compares {name}, which is a word", valid=[f"{name}=…"])
        return _word_test(evidence, name, condition.value)
    if name not in _NUMBERS:
        valid = closest(name, [*_WORDS, *_NUMBERS])
        raise UnknownName(f"'{text}' names '{name}', which runs do not have", valid=valid)
    if condition.value is not None:
        raise InvalidRequest(f"'{text}' compares {name} with a word", valid=[f"{name}>=1", f"{name}=1..2"])

    def holds(record: RunRecord) -> bool:
        value = _number(evidence, record, name)
        return value is not None and condition.interval.contains(value)

    return holds


def _word_test(evidence: Evidence, name: str, value: str) -> Callable[[RunRecord], bool]:
    wanted = value.casefold()
    there = {word for record in evidence.runs for word in _WORDS[name](record)}
    if wanted not in {word.casefold() for word in there}:
        raise UnknownName(f"no run here has {name} '{value}'", valid=closest(value, sorted(there)))
    return lambda record: wanted in {word.casefold() for word in _WORDS[name](record)}


def _number(evidence: Evidence, record: RunRecord, name: str) -> float | None:
    if name == "seed":
        return float(record.seed)
    if name == "problem":
        return float(record.problem_id)
    if name == "obstacles":
        found = evidence.obstacles.get(record.scenario_id)
        return None if found is None else float(sum(found.values()))
    return next(metric_value(record, metric.name) for metric in METRICS if metric.name == name)
