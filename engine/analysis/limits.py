"""Limits on figures of runs: ``success >= 0.9``, ``preventable_collisions == 0``, ``not worse than baseline.json``.

    limit      [mean|median|lowest|highest] NAME OPERATOR NUMBER[%] [in SHARE of runs] [with confidence] [for CONFIG]
    baseline   not worse than BASELINE [by MARGIN] [for CONFIG] · nothing lost against BASELINE [for CONFIG]

A limit is judged for every configuration separately. Shares are those of the valid runs; ``with confidence`` compares
the limit with the less favourable end of the 95% interval. A limit on a metric without a statistic must hold in every
run that has the metric, or in the given share of these runs.
"""

import operator
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import fmean, median
from typing import Literal, get_args

from ...schemas.analysis.comparison import SuccessTest
from ...schemas.analysis.suite import LimitVerdict
from ...schemas.errors import InvalidRequest, UnknownName, closest
from ...schemas.results import SIGNIFICANCE_LEVEL
from ...schemas.runs import Outcome, RunRecord
from ...schemas.text import figure, p_figure, quoted
from .run_set import METRICS
from .statistics import rate_by_scenario

_OPERATORS: Mapping[str, Callable[[float, float], bool]] = {
    ">=": operator.ge,
    "<=": operator.le,
    "==": operator.eq,
    "!=": operator.ne,
    ">": operator.gt,
    "<": operator.lt,
}
_STATISTICS: Mapping[str, Callable[[Sequence[float]], float]] = {
    "mean": fmean,
    "median": median,
    "lowest": min,
    "highest": max,
}
_FAILURES = tuple(word for word in get_args(Outcome) if word not in ("goal_reached", "invalid"))
RATES = ("success", "success_without_unpreventable", *_FAILURES)
"""Shares of the valid runs: of goals, of goals without the collisions that no reference driver prevents, and of each
other outcome.
"""
COUNTS = ("collisions", "preventable_collisions", "failures", "invalid", "lost")
"""Numbers of runs."""
_METRICS = {spec.name: spec for spec in METRICS}
_NUMBER = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)"
_FOR = r"(?:\s+for\s+(?P<only>\S.*?))?"
_FIGURE = re.compile(
    rf"(?:(?P<statistic>{'|'.join(_STATISTICS)})\s+)?(?P<name>[A-Za-z_][A-Za-z0-9_]*)\s*(?P<operator>[<>=!]=|[<>])\s*"
    rf"(?P<number>{_NUMBER})\s*(?P<percent>%?)(?:\s+in\s+(?P<share>{_NUMBER})\s*(?P<share_percent>%?)\s+of\s+runs)?"
    rf"(?P<sure>\s+with\s+confidence)?{_FOR}"
)
_BASELINE = re.compile(
    rf"(?P<kind>not\s+worse\s+than|nothing\s+lost\s+against)\s+(?P<baseline>\S+)"
    rf"(?:\s+by\s+(?P<margin>{_NUMBER})\s*(?P<percent>%?))?{_FOR}"
)
_EXAMPLES = ("success >= 0.9", "preventable_collisions == 0", "minimum_distance_m >= 0.5 in 95% of runs")
_SHOWN = 5
"""Number of runs against a limit that a verdict lists (chosen)."""


_CheckResult = tuple[bool, str, list[str]]
"""Whether a limit holds, the observation, and the runs (or scenarios) against it."""


@dataclass(frozen=True)
class Judged:
    """The runs of a configuration to which limits are applied, its cells without a run, and related facts.

    ``unpreventable``: runs with a collision that no reference driver prevents; ``against``: by baseline, the paired
    test of its runs (before) and these (after), and the scenarios that only the baseline solved; ``roots``: the root
    scenario of each edited scenario.
    """

    configuration: str
    records: Sequence[RunRecord]
    lost: int
    unpreventable: frozenset[str]
    against: Mapping[str, tuple[SuccessTest, tuple[str, ...]]]
    roots: Mapping[str, str] = field(default_factory=dict)

    @property
    def valid(self) -> list[RunRecord]:
        """The runs that could be attempted."""
        return [record for record in self.records if record.outcome != "invalid"]


@dataclass(frozen=True)
class Limit(ABC):
    """One limit as written, and its parsed content.

    ``only``: the configuration that it applies to, empty for all; ``baseline``: the file or batch that runs are
    compared with, empty if the limit is a number.
    """

    text: str
    only: str
    baseline: str

    def judge(self, runs: Judged) -> LimitVerdict:
        """Return the verdict on the runs of a configuration: whether the limit holds, and the observed value."""
        holds, observed, against = self._check(runs)
        more = [f"+{len(against) - _SHOWN}"] if len(against) > _SHOWN else []
        shown = f"{observed}: {', '.join([*against[:_SHOWN], *more])}" if against and not holds else observed
        return LimitVerdict(
            limit=self.text,
            configuration=runs.configuration,
            holds=holds,
            observed=shown,
            run_ids=() if holds else tuple(against),
        )

    @abstractmethod
    def _check(self, runs: Judged) -> _CheckResult: ...


@dataclass(frozen=True)
class _FigureLimit(Limit):
    """A bound on a share, a count or a metric; ``share``: the share of runs that must be within it."""

    name: str
    compare: str
    number: float
    statistic: str
    share: float
    sure: bool

    def _check(self, runs: Judged) -> _CheckResult:
        if self.name in RATES:
            return self._check_share(runs)
        return self._check_count(runs) if self.name in COUNTS else self._check_metric(runs)

    def _check_share(self, runs: Judged) -> _CheckResult:
        valid = runs.valid
        if self.name == "success_without_unpreventable":
            valid = [record for record in valid if record.run_id not in runs.unpreventable]
        wanted = "goal_reached" if self.name.startswith("success") else self.name
        counted = [record for record in valid if record.outcome == wanted]
        seen = rate_by_scenario(
            (runs.roots.get(one.scenario_id, one.scenario_id), one.outcome == wanted) for one in valid
        )
        if seen.share is None or seen.low is None or seen.high is None:
            return False, "no valid run", []
        ends = {">": seen.low, "<": seen.high}
        value = ends.get(self.compare[0], seen.share) if self.sure else seen.share
        text = f"{seen.count} of {seen.of} = {seen.share:.1%} (95%: {seen.low:.1%} to {seen.high:.1%})"
        wrong = counted if self.compare[0] == "<" else [record for record in valid if record not in counted]
        return _OPERATORS[self.compare](value, self.number), text, [record.run_id for record in wrong]

    def _check_count(self, runs: Judged) -> _CheckResult:
        hits = [record for record in runs.valid if record.outcome == "collision"]
        counted = {
            "collisions": hits,
            "preventable_collisions": [record for record in hits if record.run_id not in runs.unpreventable],
            "failures": [record for record in runs.valid if record.outcome != "goal_reached"],
            "invalid": [record for record in runs.records if record.outcome == "invalid"],
        }
        found = [record.run_id for record in counted.get(self.name, [])]
        number = runs.lost if self.name == "lost" else len(found)
        return _OPERATORS[self.compare](number, self.number), f"{number}", found

    def _check_metric(self, runs: Judged) -> _CheckResult:
        spec = _METRICS[self.name]
        seen = [(record.run_id, value) for record in runs.valid if (value := spec.value(record)) is not None]
        if not seen:
            return bool(runs.valid), "no run has it" if runs.valid else "no valid run", []
        values = [value for _, value in seen]
        within = _OPERATORS[self.compare]
        unit = "" if spec.unit == "1" else f" {spec.unit}"
        wrong = [run_id for run_id, value in seen if not within(value, self.number)]
        if self.statistic:
            value = _STATISTICS[self.statistic](values)
            return within(value, self.number), f"{self.statistic} {figure(value)}{unit} over {len(seen)} runs", wrong
        kept = 1 - len(wrong) / len(seen)
        span = f"{figure(min(values))} to {figure(max(values))}{unit}"
        return kept >= self.share, f"within in {len(seen) - len(wrong)} of {len(seen)} runs ({span})", wrong


@dataclass(frozen=True)
class _BaselineLimit(Limit):
    """A comparison with the runs of a baseline: overall, by at most a margin, or scenario by scenario."""

    kind: Literal["not_worse", "nothing_lost"]
    margin: float | None

    def _check(self, runs: Judged) -> _CheckResult:
        test, lost = runs.against[self.baseline]
        if not test.pairs or test.difference is None:
            return False, f"no scenario of {self.baseline} was run with {runs.configuration}", []
        changed = f"{test.only_after} gained, {test.only_before} lost of {test.pairs} pairs"
        if self.kind == "nothing_lost":
            return not lost, changed, list(lost)
        if test.low is None or test.high is None or test.p is None:
            return False, f"{changed}, not testable", list(lost)
        text = (
            f"{changed}, success {test.difference:+.1%} (95%: {test.low:+.1%} to {test.high:+.1%}), "
            f"p {p_figure(test.p)}"
        )
        if self.margin is not None:
            return test.low >= -self.margin, text, list(lost)
        return not (test.difference < 0 and test.p < SIGNIFICANCE_LEVEL), text, list(lost)


def parse_limit(text: str) -> Limit:
    """Parse a limit.

    Raises:
        InvalidRequest: the text is not a limit, or a share is not between 0 and 1.
        UnknownName: the limit refers to something that runs do not have.
    """
    plain = " ".join(text.split())
    found = _BASELINE.fullmatch(plain)
    if found is not None:
        only = found["only"] or ""
        is_single = found["kind"].startswith("nothing")
        if is_single and found["margin"] is not None:
            raise InvalidRequest(f"{quoted(text)}: a margin is only valid with 'not worse than'")
        margin = None if found["margin"] is None else _share(found["margin"], found["percent"], text)
        kind: Literal["not_worse", "nothing_lost"] = "nothing_lost" if is_single else "not_worse"
        return _BaselineLimit(plain, only, found["baseline"], kind, margin)
    found = _FIGURE.fullmatch(plain)
    if found is None:
        raise InvalidRequest(f"{quoted(text)} is not a limit", valid=[*_EXAMPLES, "not worse than FILE"])
    name = found["name"]
    if name not in (*RATES, *COUNTS, *_METRICS):
        known = [*RATES, *COUNTS, *_METRICS]
        raise UnknownName(f"{quoted(text)} bounds '{name}', which runs do not have", valid=closest(name, known))
    number = float(found["number"])
    if name in RATES:
        number = _share(found["number"], found["percent"], text)
    elif found["percent"]:
        raise InvalidRequest(f"{quoted(text)}: {name} is not a share", valid=[f"{name} {found['operator']} {number:g}"])
    if (found["statistic"] or found["share"]) and name not in _METRICS:
        raise InvalidRequest(f"{quoted(text)}: {name} is a single figure and takes no statistic", valid=[*_METRICS])
    if found["statistic"] and found["share"]:
        raise InvalidRequest(
            f"{quoted(text)}: a {found['statistic']} cannot have a share of runs", valid=list(_EXAMPLES)
        )
    if found["sure"] and name not in RATES:
        raise InvalidRequest(f"{quoted(text)}: only shares have a confidence interval", valid=list(RATES))
    share = 1.0 if found["share"] is None else _share(found["share"], found["share_percent"], text)
    only, statistic, sure = found["only"] or "", found["statistic"] or "", bool(found["sure"])
    return _FigureLimit(plain, only, "", name, found["operator"], number, statistic, share, sure)


def _share(number: str, percent: str, text: str) -> float:
    share = float(number) / (100 if percent else 1)
    if not 0 <= share <= 1:
        raise InvalidRequest(f"{quoted(text)}: a share must be between 0 and 1", valid=["0.9", "90%"])
    return share
