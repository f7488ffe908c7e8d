"""What the figures of a sentence are of: rules from the words of answers and reports to what recomputes their figures.

A rule is a pattern, whose groups that are numbers are the figures, and a function from its match to what these should
be. ``Judge.rules`` are those for the runs of a batch.
"""

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from statistics import median
from typing import Any

import numpy as np
from scipy.stats import fisher_exact

from plannerforge.schemas.runs import LimitExcess, RunRecord
from plannerforge.schemas.vocabulary import ROAD_KINDS

from .public_runs import RawRuns
from .recomputed import METRICS, Costs, Pairs, correlation, goal, goals, holm, late_because, metric, rate
from .trivial import problem_of, truth

N = r"([-+]?\d[\d,]*(?:\.\d+)?(?:e[-+]?\d+)?)"
RATE = rf"{N}/{N}(?: = <?{N} % \(95 %: {N}–{N} %(?:, {N} original scenarios?)?\))?"
_NUMBER = re.compile(rf"(?<![\w.]){N}(?![\w])")
_NAMES = re.compile(
    r"\b(?:run|cfg|batch|job)_[\w-]+|\b[A-Z]{3}_[\w-]+|'[^']*'|ISO [\d:]+|UN R\d+|\(0 a [^)]*\)|of 5\b|95 %|Next: .*"
)
"""What holds digits and is no figure: ids, names in quotes, norms, the ends of a scale, the next call."""
Row = tuple[str, Callable[[re.Match[str]], Sequence[float | None]]]
Rule = tuple[re.Pattern[str], Callable[[re.Match[str]], Sequence[float | None]]]


def agrees(shown: str, value: float | None) -> bool:
    """Whether a figure rounds to the digits shown, either way where it lies between."""
    if value is None:
        return False
    mantissa, _, exponent = shown.replace(",", "").lstrip("+").partition("e")
    decimals = len(mantissa.partition(".")[2])
    unit = 10.0 ** (int(exponent or 0) - decimals)
    return abs(float(mantissa + (f"e{exponent}" if exponent else "")) - value) <= 0.5 * unit * (1 + 1e-6)


def is_close(record: RunRecord) -> bool:
    """Whether a run came closer than half a metre or a second and a half to a collision."""
    gap, time = metric(record, "minimum distance"), metric(record, "time to collision")
    return (gap is not None and gap < 0.5) or (time is not None and time < 1.5)


@dataclass
class Tally:
    """Figures that agree, that do not, and that no rule knows; each of the latter two with its line."""

    agreeing: int = 0
    wrong: list[str] = field(default_factory=list)
    unknown: list[str] = field(default_factory=list)

    @property
    def figures(self) -> int:
        """All of them."""
        return self.agreeing + len(self.wrong) + len(self.unknown)

    def read(self, line: str, rules: Sequence[Rule]) -> None:
        """Take the figures of a line by the rules that know them."""
        rest = line
        for pattern, expected in rules:
            for match in list(pattern.finditer(rest)):
                shown = [place for place in range(1, pattern.groups + 1) if re.fullmatch(N, match[place] or "")]
                self._compare(line, [match[place] for place in shown], expected(match))
                for place in shown:  # only the figures are taken out: other rules look at the names
                    rest = f"{rest[: match.start(place)]}{'~' * len(match[place])}{rest[match.end(place) :]}"
        self.unknown += [f"{number} in: {line}" for number in _NUMBER.findall(_NAMES.sub("", rest))]

    def _compare(self, line: str, shown: Sequence[str], values: Sequence[float | None]) -> None:
        for number, value in zip(shown, [*values, *[None] * len(shown)], strict=False):
            if agrees(number, value):
                self.agreeing += 1
            else:
                self.wrong.append(f"{number}, recomputed {value}, in: {line}")


_COUNTED = (
    "main_failure",
    "unforeseen",
    "goal_out_of_reach",
    "held_up",
    "waited_late",
    "stood_late",
    "stood_without_cause",
    "braked_without_cause",
    "held_back",
    "weak_obstacle_cost",
    "near_misses",
    "uncomfortable_turns",
)
"""Findings whose first figure is the number of their runs."""
_FROM_BEHIND = ("rear_end_by_other", "onto_standing_ego")
_LATE_WORDS = {
    "held_up": "were behind a slower vehicle",
    "waited_late": "stood at lights or stop signs, or while others crossed their way",
    "stood_late": "stood at a green light or with nothing to wait for",
}
_OWN_WORDS = {
    "stood with nothing to wait for": ("stood_at_green", "stood_without_cause"),
    "braked without a reason on the road": ("braked_without_cause", "braked_too_hard"),
}
_LAID = {
    "the ego itself": "ego",
    "recorded traffic": "recording",
    "the prediction": "prediction",
    "the plan": "planning",
    "neither side": "neither",
}
LATE = ("timeout", "goal_late")
"""Outcomes of runs that came too late, or not at all in time."""


class Judge:
    """What the sentences on the runs of a batch are of.

    ``findings``: how many are stated of them; ``broken``: verdicts on traffic rules, by run and rule.
    """

    def __init__(
        self,
        raw: RawRuns,
        weights: Mapping[str, Mapping[str, float]],
        reviews: Mapping[str, Any],
        findings: int,
        broken: Mapping[str, Mapping[str, Any]],
    ) -> None:
        self.raw, self.weights, self.reviews, self.findings = raw, weights, reviews, findings
        self.broken = broken
        self.costs, self.features = Costs(raw), correlation(raw)
        self.names = {record.config_name: record.config_id for record in raw.records}
        self.pairs = Pairs(raw, raw.batch.configs) if len(raw.batch.configs) == 2 else None

    # ---- runs

    def of(self, config: str, *outcomes: str) -> list[RunRecord]:
        """The valid runs of a configuration, of some outcomes."""
        return [
            one for one in self.raw.valid if one.config_name == config and (not outcomes or one.outcome in outcomes)
        ]

    @cached_property
    def contacts(self) -> dict[str, Any]:
        """Who hit whom, of the runs that ended in a collision."""
        hits = [one for one in self.raw.valid if one.outcome == "collision"]
        found = {one.run_id: self.reviews[one.run_id]["contact"] for one in hits}
        return {run_id: contact for run_id, contact in found.items() if contact is not None}

    @cached_property
    def unprevented(self) -> set[str]:
        """Collisions that no reference driver prevents."""
        judged = {run_id: contact["prevention"] for run_id, contact in self.contacts.items()}
        keys = ("by_careful_driver", "by_rss", "by_fuzzy_driver")
        return {
            run_id
            for run_id, by in judged.items()
            if self.contacts[run_id].get("laid_to") != "ego"
            if by is not None and by["by_braking_until_s"] is None and not any(by[key] for key in keys)
            if not any(one["prevents"] and one["driver"] != "evading" for one in by.get("drivers", ()))
        }

    @cached_property
    def judged_own(self) -> int:
        """Collisions that the ego made, of those whose course is known."""
        return sum(one.get("laid_to") == "ego" and one["prevention"] is not None for one in self.contacts.values())

    @cached_property
    def not_attributable(self) -> set[str]:
        """Collisions that neither the careful nor the fuzzy driver prevents from both starts."""
        found = set()
        for run_id, contact in self.contacts.items():
            by = contact["prevention"]
            if by is None:
                continue
            prevented = {(one["driver"], one["start"]) for one in by.get("drivers", ()) if one["prevents"]}
            starts = ("before_contact", "start")
            by_both = any(all((name, start) in prevented for start in starts) for name in ("r157_careful", "fsm"))
            earlier = not by.get("drivers") and (by["by_careful_driver"] or by["by_fuzzy_driver"])
            if not by_both and not earlier:
                found.add(run_id)
        return found

    @cached_property
    def the_others(self) -> set[str]:
        """Collisions by others: from behind, or that nobody in the ego's place prevents."""
        behind = {key for key, contact in self.contacts.items() if contact["kind"] in _FROM_BEHIND}
        return self.unprevented | {key for key in behind if self.contacts[key].get("laid_to") != "ego"}

    @cached_property
    def hard(self) -> tuple[int, dict[str, list[RunRecord]], int]:
        """How many scenarios several configurations tried, which all failed, and how many more others made fail."""
        runs_of: dict[str, list[RunRecord]] = {}
        for one in self.raw.valid:
            runs_of.setdefault(one.scenario_id, []).append(one)
        tried = {key: runs for key, runs in runs_of.items() if len({one.config_id for one in runs}) > 1}
        failed = {key: runs for key, runs in tried.items() if not any(map(goal, runs))}
        fair = {key: runs for key, runs in failed.items() if any(one.run_id not in self.the_others for one in runs)}
        return len(tried), fair, len(failed) - len(fair)

    @cached_property
    def trivial(self) -> dict[str, str]:
        """Goals that asked for no driving, by the judge of ``trivial``."""
        reached = [one for one in self.raw.valid if goal(one)]
        kinds = {
            one.run_id: truth(problem_of(self.raw.files[one.scenario_id], one), self.raw.steps[one.run_id])
            for one in reached
        }
        return {run_id: kind for run_id, kind in kinds.items() if kind is not None}

    @cached_property
    def late(self) -> dict[str, str]:
        """Why runs came late, by run id."""
        return {
            one.run_id: late_because(self.raw, one, self.pace(one.run_id))
            for one in self.raw.valid
            if one.outcome in LATE
        }

    def pace(self, run_id: str) -> list[dict[str, Any]]:
        """The stretches of a run, as the answer on it alone has them."""
        review = self.reviews.get(run_id)
        return [] if review is None else list(review.get("pace", ()))

    def _did(self, codes: Sequence[str], config: str) -> list[float]:
        """How many of the failed runs of a configuration have such a stretch, of how many."""
        failed = [
            one
            for one in self.raw.valid
            if one.config_name == config
            and (one.outcome in (*LATE, "goal_missed", "infeasible") or one.outcome == "collision")
        ]
        having = [one for one in failed if any(moment["code"] in codes for moment in self.pace(one.run_id))]
        return [len(having), len(failed)]

    def _stretch(self, match: re.Match[str]) -> list[float | None]:
        """The figures of a stretch that is told of a run: the one that begins as told."""
        begins = float(match["since"])
        found = [one for one in self.pace(match["run"]) if abs(one["since_s"] - begins) < 0.051]
        if not found:
            return [None] * 3
        one = found[0]
        hardest = [one["largest_mps2"]] if match["hardest"] else []
        before = [one["distance_m"]] if match["before"] else []
        whom = [one["obstacle_id"]] if match["whom"] else []
        return [*hardest, one["since_s"], one["until_s"], *before, *whom]

    def goals_without(self, left_out: Sequence[str] | set[str] | dict[str, str]) -> list[float]:
        """The rate without some runs."""
        return goals(one for one in self.raw.valid if one.run_id not in left_out)

    @cached_property
    def laid_to(self) -> Counter[str]:
        """What the collisions are laid to: the first of the rules of ``docs/runs.md`` that holds."""
        found: Counter[str] = Counter()
        for one in self.raw.valid:
            contact = self.contacts.get(one.run_id)
            if contact is None:
                continue
            gap = contact["predicted_gap_m"]
            if contact.get("laid_to") == "ego":
                found["ego"] += contact["fault"] is not None
            elif contact["kind"] in _FROM_BEHIND and one.traffic == "recorded":
                found["recording"] += 1
            elif contact["prevention"] is None:
                continue
            elif one.run_id in self.not_attributable:
                found["neither"] += 1
            elif one.prediction == "ground_truth" or gap == 0:
                found["planning"] += 1
            elif gap is not None:
                found["prediction"] += 1
        return found

    # ---- rules

    def rules(self) -> list[Rule]:
        """The rules in the order in which they are tried."""
        made = [
            self._evidence(),
            (rf"(run_[\w-]+) \({N} s\)", self._moment),
            *self._of_rates(),
            *self._of_metrics(),
            *self._of_findings(),
        ]
        made += [*self._of_rules(), *self._of_rows()]
        apart = self._by_configuration()
        if apart:
            rules = {name: one.rules() for name, one in apart.items()}
            made = [
                (pattern, self._of_its_configuration(expected, {name: own[place][1] for name, own in rules.items()}))
                for place, (pattern, expected) in enumerate(made)
            ]
        if self.pairs is not None:
            made += self._of_comparison(self.pairs)
        return [(re.compile(pattern), expected) for pattern, expected in made]

    def _by_configuration(self) -> dict[str, "Judge"]:
        """A judge of the runs of each configuration, by its name, where there are several."""
        if len(self.names) < 2:
            return {}
        found = {}
        for name, config_id in self.names.items():
            batch = self.raw.batch.model_copy(update={"configs": (config_id,)})
            own = tuple(one for one in self.raw.records if one.config_id == config_id)
            raw = replace(self.raw, batch=batch, records=own)
            found[name] = Judge(raw, self.weights, self.reviews, self.findings, self.broken)
        return found

    def _of_its_configuration(
        self, pooled: Callable[[re.Match[str]], Sequence[float | None]], apart: dict[str, Any]
    ) -> Callable[[re.Match[str]], Sequence[float | None]]:
        """What is expected of a sentence: of the one configuration that it names, or of all runs."""

        def expected(match: re.Match[str]) -> Sequence[float | None]:
            named = [name for name, key in self.names.items() if name in match.string or key in match.string]
            named = [name for name in named if not any(name != other and name in other for other in named)]
            return (apart[named[0]] if len(named) == 1 else pooled)(match)

        return expected

    def _evidence(self) -> Row:
        """How many runs are behind a finding, beside the two that are named."""

        def behind(match: re.Match[str]) -> list[float | None]:
            text = match.string
            found = re.match(r"- \[(\w+)\]", text)
            name = found[1] if found else ""
            if name in ("dominating_cost", "idle_weights"):
                config = next(config for config in self.names if config in text)
                return [sum(one.run_id in self.raw.steps for one in self.of(config)) - 2]
            if name in _COUNTED:
                stated = re.search(r"(\d+) of", text)
                return [float(stated[1]) - 2 if stated else None]
            if name == "hard_scenarios":
                return [sum(map(len, self.hard[1].values())) - 2]
            if text.startswith("- runs: ") and self.pairs is not None:
                return [2 * len(self.pairs.pairs) - len(re.findall(r"run_\w+", text))]
            if name == "rejecting_constraint":
                return [sum(one.outcome == "infeasible" for one in self.raw.valid) - 2]
            return [None]

        return (rf"(?<=[\w)] )\+{N}$", behind)

    def _moment(self, match: re.Match[str]) -> list[float | None]:
        """The moment of a run that is named: of its moments the one that is meant, none if there is none so near."""
        records = {one.run_id: one for one in self.raw.records}
        one, review = records.get(match[1]), self.reviews.get(match[1]) or {}
        if one is None:
            return [None]
        known = [0.0, one.metrics.duration_s if one.metrics else 0.0]
        known += [one.collision.time_s] if one.collision else []
        known += [moment["since_s"] for moment in review.get("pace", ())]
        known += [moment["time_s"] for name in ("closest", "most_urgent") if (moment := review.get(name))]
        known += [moment["time_s"] for moment in review.get("largest", ())]
        steps = self.raw.steps.get(one.run_id)
        if steps is not None and len(steps.x_m) > 1:
            speeds, turns = np.array(steps.speed_mps[1:]), np.diff(np.unwrap(steps.heading_rad))
            known.append((int(np.abs(speeds * turns).argmax()) + 1) * one.step_s)
        said = float(match[2])
        return [min(known, key=lambda time_s: abs(time_s - said))]

    def _of_rates(self) -> list[Row]:
        records, valid = self.raw.records, self.raw.valid
        outcomes, contacts = Counter(str(one.outcome) for one in valid), self.contacts
        kinds = Counter(contact["kind"].replace("_", " ") for contact in contacts.values())
        trivial = ("at the start", "standing", "by time alone")
        hits = sum(one.outcome == "collision" for one in valid)
        known = [one.beyond_vehicle is not None for one in valid]
        beyond = [{excess.name for excess in one.beyond_vehicle} for one in valid if one.beyond_vehicle]

        def group(name: str) -> list[float]:
            return goals(one for one in valid if f"{one.config_name} ({one.config_id})" == name)

        def failed(match: re.Match[str]) -> list[float]:
            count = outcomes[match[1]]
            return [count, count - len(match[3].split())]

        return [
            (
                rf"^{N} runs \({N} valid, {N} invalid\): goal {RATE}",
                lambda _: [len(records), len(valid), len(records) - len(valid), *goals(valid)],
            ),
            (
                rf"^{N} runs \({N} valid, {N} invalid\): by configuration",
                lambda _: [len(records), len(valid), len(records) - len(valid)],
            ),
            (
                rf"(?:See|;) (?:ego|recording|prediction|planning|neither) (run_[\w-]+) at {N} s",
                lambda match: [contacts[match[1]]["time_s"]],
            ),
            (rf"\b([a-z]+(?:_[a-z]+)*) {N} \(((?:run_[\w-]+ ?)+?)(?: \+{N})?\)", failed),
            (
                rf"without them goal {RATE}(?=\.(?:$| See))",
                lambda match: self.goals_without(self.trivial if "no driving" in match.string else self.unprevented),
            ),
            (
                rf"no reference driver prevents {N} of {N}(?: that could be judged, of {N})?",
                lambda _: [len(self.unprevented), sum(c["prevention"] is not None for c in contacts.values()), hits],
            ),
            (
                rf"(?<=[:,] )({'|'.join([*kinds, *trivial])}) {N}(?=[,;.])",
                lambda match: [
                    list(self.trivial.values()).count(match[1].replace(" ", "_"))
                    if "no driving" in match.string
                    else kinds[match[1]]
                ],
            ),
            (rf"^- (\S+ \(cfg_\w+\)): goal {RATE}", lambda match: group(match[1])),
            (rf"\b({'|'.join(outcomes)}) {N}(?=[,;]|$)", lambda match: [self._in_line(match)]),
            (rf"; {N} more: where outcome=invalid", lambda _: [len(records) - len(valid) - 2]),
            (rf"invalid {N}$", lambda match: [self._in_line(match, "invalid")]),
            (
                r"laid to (\w+) (\d+)(?:, (\w+) (\d+))?(?:, (\w+) (\d+))?(?:, (\w+) (\d+))?",
                lambda match: [self.laid_to[name] for name in match.groups()[::2] if name],
            ),
            (
                rf"{N} to (the ego itself|recorded traffic|the prediction|the plan|neither side)",
                lambda match: [self.laid_to[_LAID[match[2]]]],
            ),
            (
                rf"By the paper's rule, a goal by any motion: {RATE}",
                lambda _: rate(
                    [(one.scenario_id, float(one.outcome in ("goal_reached", "goal_refused"))) for one in valid]
                ),
            ),
            (rf"can drive: {N} of {N} driven motions", lambda _: [len(beyond), sum(known)]),
            (
                rf"(?:\(|, )(speed|acceleration|friction|steering angle|steering rate|rolling) {N}(?=[,)])",
                lambda match: [sum(match[1] in names for names in beyond)],
            ),
            *self._of_overview(),
        ]

    def _of_overview(self) -> list[Row]:
        """The rows "In short" of a report, and its table of configurations."""
        records, valid, contacts = self.raw.records, self.raw.valid, self.contacts
        judged = sum(contact["prevention"] is not None for contact in contacts.values())
        hits = sum(one.outcome == "collision" for one in valid)
        behind = [key for key in self.unprevented if contacts[key]["kind"] in _FROM_BEHIND]
        outcomes = Counter(one.outcome.replace("_", " ") for one in valid if not goal(one))
        kinds = Counter(contact["kind"].replace("_", " ") for contact in contacts.values())
        tested = [len(self.raw.batch.configs), len(self.raw.batch.scenarios), len(records)]

        def reached(match: re.Match[str]) -> list[float]:
            if match["config"]:
                return goals(one for one in valid if one.config_id == match["config"])
            return self.goals_without(self.unprevented) if "Without these" in match.string else goals(valid)

        def configuration(match: re.Match[str]) -> list[float]:
            own = [one for one in records if one.config_id == match[1]]
            found = goals(one for one in own if one.outcome != "invalid")
            return [found[1], found[0], *found[2:5], sum(one.outcome == "invalid" for one in own)]

        return [
            (rf"\| {N} configurations? \(.*\) on {N} scenarios?, {N} runs;", lambda _: tested),
            (
                rf"(?:\((?P<config>cfg_\w+)\): )?{N} of {N} valid runs \({N} %, 95 % interval {N} to {N} %\) reached",
                reached,
            ),
            (rf"(?:ended as|,) {N} ({'|'.join(outcomes) or '-'})(?=[,;.])", lambda match: [outcomes[match[2]]]),
            (rf"(?<!of )(?<!\d){N} collisions[ ,]", lambda _: [hits]),
            (rf"{N} could not be attempted and count nowhere", lambda _: [len(records) - len(valid)]),
            (rf"(?:\(|, ){N} ({'|'.join(kinds) or '-'})(?=[,)])", lambda match: [kinds[match[2]]]),
            (
                rf"prevents {N} of the {N} that could",
                lambda _: [judged - len(self.unprevented) - self.judged_own, judged],
            ),
            (rf"The ego caused {N} by itself", lambda _: [self.laid_to["ego"]]),
            (rf"prevents the other {N}", lambda _: [len(self.unprevented)]),
            (rf"in {N} of these another drove", lambda _: [len(behind)]),
            (rf"^\S+ \((cfg_\w+)\) \| {N} \| {N} \({N} %\) \| {N} to {N} % \|.*\| {N}$", configuration),
            (
                rf"\b({'|'.join(outcomes) or '-'}) {N}(?=,| \|)",
                lambda match: [self._in_line(match, match[1].replace(" ", "_"))],
            ),
        ]

    def _in_line(self, match: re.Match[str], outcome: str | None = None) -> float:
        """Runs of an outcome in the group that a line is of."""
        config = re.search(r"cfg_\w+", match.string)
        wanted = outcome or match[1]
        return sum(one.outcome == wanted and (config is None or one.config_id == config[0]) for one in self.raw.records)

    def _of_metrics(self) -> list[Row]:
        words, features = "|".join(METRICS), self.features

        def spread(match: re.Match[str]) -> list[float | None]:
            found = [value for one in self.raw.valid if (value := metric(one, match[1])) is not None]
            shown = [group for group in match.groups()[1:4] if group is not None]
            values = [median(found), min(found), max(found)] if len(shown) != 2 else [min(found), max(found)]
            return [*values[: len(shown)], len(found)]

        def cost(match: re.Match[str]) -> list[float | None]:
            own = self.of(match[1])
            terms = self.costs.means(own)
            counted = sum(one.run_id in self.raw.steps for one in own)
            share = 100 * terms[match[2]] / sum(terms.values())
            return [1 if "<1 %" in match[0] and share < 0.5 else share, terms[match[2]], counted]

        scenarios = len({one.scenario_id for one in self.raw.valid})
        failing = {one.config_id for one in self.raw.valid if _failed(one)}  # each has a main failure
        return [
            (rf"valid runs of {N} scenarios, at least {N} are", lambda _: [scenarios, 12]),
            (
                rf"runs {N} to {N} of {N}, failures first",
                lambda match: [
                    (first := float(match[1])),
                    min(first + 29, len(self.raw.records)),
                    len(self.raw.records),
                ],
            ),
            (rf"^… {N} more: offset={N}$", lambda match: [len(self.raw.records) - (at := float(match[2])), at]),
            (rf"^… {N} more: detail=findings", lambda _: [min(self.findings - len(failing), 5 - bool(failing)) - 2]),
            (rf"more findings \({N}\)", lambda _: [self.findings - len(failing) - 5 + bool(failing)]),
            (rf"over {N} valid runs", lambda _: [len(self.raw.valid)]),
            (rf"({words})(?: \(0 [^)]*\))? {N}(?: \({N}–{N}\))?[^;.]*?(?: in {N} runs)?(?=;|\.$)", spread),
            (rf"^- (\S+) (\w+): <?{N} % of the cost, {N} a planning step \(n={N}\)", cost),
            (
                rf"success × (\w+): ρ={N}, p={N}, Holm {N} \(n={N} scenarios\)(?:; with [\w, ]+ fixed ρ={N}, p={N})?",
                lambda match: features[match[1]],
            ),
        ]

    def _of_findings(self) -> list[Row]:
        valid, contacts = self.raw.valid, self.contacts
        failures = [one for one in valid if not goal(one)]
        common = Counter(one.outcome for one in failures)

        def harsh(match: re.Match[str]) -> list[float | None]:
            values = [metric(one, "largest lateral acceleration") or 0.0 for one in self.of(match[3], "goal_reached")]
            return [sum(value > 3.0 for value in values), len(values), 3.0, max(values)]

        def late_cost(match: re.Match[str]) -> list[float | None]:
            own = [one for one in self.of(match[2], *LATE) if not self.late[one.run_id]]
            return [len(own), self.costs.median_shares(own)[match[3]]]

        def dominating(match: re.Match[str]) -> list[float | None]:
            return [self.costs.median_shares(self.of(match[3]))[match[1]]]

        def idle(match: re.Match[str]) -> list[float | None]:
            own = [one for one in self.of(match[1]) if one.run_id in self.raw.steps]
            return [len(own)]

        def weak(match: re.Match[str]) -> list[float | None]:
            hits = [one for one in self.of(match[3], "collision") if one.run_id not in self.the_others]
            shares = [share for one in hits if (share := self._obstacle_share(one)) is not None]
            low = [share for share in shares if share < 10]
            return [len(low), len(shares), 10, median(low) if low else None]

        def foreseen(_: re.Match[str]) -> list[float | None]:
            own = [contact for key, contact in contacts.items() if key not in self.the_others]
            known = [gap for contact in own if (gap := contact.get("predicted_gap_m")) is not None]
            apart = [gap for gap in known if gap > 0]
            return [len(apart), len(known), median(apart) if apart else None]

        def weight(match: re.Match[str]) -> list[float | None]:
            own = self.of(match[3])
            words = [word.replace(" ", "_") for word in match[7].split(" or ")]
            failed = [one for one in own if one.outcome in words and one.run_id not in self.the_others]
            values = [self.weights[self.names[match[3]]][match[1]], self.weights["default"].get(match[1])]
            return [*values, len(failed), len(own)]

        def hard(match: re.Match[str]) -> list[float | None]:
            tried, fair, theirs = self.hard
            return [len(fair), tried, *([theirs] if match[3] else []), len(fair) - 4]

        return [
            (
                rf"([a-z ]+): {N} of {N} failures, {N} of {N} valid runs",
                lambda match: [(n := common[match[1].strip().replace(" ", "_")]), len(failures), n, len(valid)],  # type: ignore[index]
            ),
            (
                rf"{N} of {N} late runs could not be on time",
                lambda _: [list(self.late.values()).count("goal_out_of_reach"), len(self.late)],
            ),
            *(
                (
                    rf"{N} of {N} late runs {words} for {N} %",
                    lambda _, name=name: [list(self.late.values()).count(name), len(self.late), 40],
                )
                for name, words in _LATE_WORDS.items()
            ),
            *(
                (
                    rf"In {N} of {N} late or collided runs of (\S+) the ego {words}",
                    lambda match, codes=codes: self._did(codes, match[3]),
                )
                for words, codes in _OWN_WORDS.items()
            ),
            (
                (
                    rf"in (?P<run>run_[\w-]+) it [a-z ]+?(?P<hardest> by up to {N} m/s²)? from (?P<since>[\d.]+) s"
                    rf" to {N} s(?P<before>, {N} m before)?(?:, much harder than [a-z_A-Z]+ (?P<whom>\d+) asked)?"
                ),
                self._stretch,
            ),
            (rf"{N} of {N} successes of (\S+) exceeded {N} m/s² of lateral acceleration \(largest {N}\)", harsh),
            (
                rf"{N} of the runs of (\S+) ran out of [a-z ]+; (\w+) was {N} % of \w+ cost(?: in the median)?",
                late_cost,
            ),
            (rf"(\w+) is {N} % of the cost in the median run under (\S+)\.", dominating),
            (rf"of (\S+) cost nothing in any of {N} runs", idle),
            (
                rf"In {N} of {N} collisions of (\S+?)(?: that [a-z ]+)?, obstacles [a-z ]+ {N} % .*? \([a-z]+ {N} %\)",
                weak,
            ),
            (
                rf"In {N} of {N} collisions that an ego could prevent the other moved .* {N} m apart \(median\)",
                foreseen,
            ),
            (
                (
                    rf"(\w+) is {N} under (\S+), {N} by default,"
                    rf" and {N} of {N} runs fail in a way that it works against \(([a-z ]+)\)"
                ),
                weight,
            ),
            (
                rf"Scenarios (\w+ [\w ]+) are harder: goal in {N} of {N}, [a-z ]+ {N} of {N} \(.*?Holm p {N}\)",
                lambda match: self._harder(match[1]),
            ),
            (
                rf"{N} of {N} scenarios failed under [a-z ]+(?: \({N} more [a-z ]+\))?:[^.]*?(?: and {N} more)?(?=\.)",
                hard,
            ),
            (
                rf"In {N} of {N} successes of (\S+) the ego came within {N} m or {N} s of [a-z ]+(?:; in {N} more)?",
                lambda match: self._near(match[3]),
            ),
            (
                (
                    rf"In {N} of {N} infeasible runs the constraint (\w+) rejected most candidates, "
                    rf"{N} % of the rejected ones"
                ),
                lambda match: self._rejecting(match[3]),
            ),
            (
                rf"(?:raise|lower) (\w+) of (\S+?)(?: \(|: )it is {N} now",
                lambda match: [self.weights[self.names.get(match[2], match[2])].get(match[1])],
            ),
        ]

    def _obstacle_share(self, record: RunRecord) -> float | None:
        if record.collision is None or record.run_id not in self.raw.steps:
            return None
        terms = self.costs.terms(record, record.collision.step - round(1.0 / record.step_s))
        against = ("prediction", "distance_to_obstacles", "responsibility")
        total = sum(terms.values())
        return 100 * sum(terms.get(name, 0.0) for name in against) / total if total > 0 else None

    def _near(self, config: str) -> list[float | None]:
        own = self.of(config, "goal_reached")
        close = [one for one in own if is_close(one)]
        near = sum(self._by_ego(self.reviews[one.run_id]) for one in close)
        return [near, len(own), 0.5, 1.5, len(close) - near]

    @staticmethod
    def _by_ego(review: Mapping[str, Any]) -> bool:
        """Whether the ego came near to another ahead or crossing, faster than 2 m/s."""
        moments = [(review["closest"], "gap_m", 0.5), (review["most_urgent"], "time_to_collision_s", 1.5)]
        return any(
            one is not None
            and one[key] is not None
            and one[key] < below
            and one["side"] == "front"
            and one["direction"] != "oncoming"
            and one["ego_speed_mps"] > 2.0
            for one, key, below in moments
        )

    def _rejecting(self, name: str) -> list[float | None]:
        stuck = [one for one in self.raw.valid if one.outcome == "infeasible" and one.rejected_candidates]
        most = [max(sorted(one.rejected_candidates), key=lambda key: one.rejected_candidates[key]) for one in stuck]
        shares = [100 * one.rejected_candidates.get(name, 0) / sum(one.rejected_candidates.values()) for one in stuck]
        return [most.count(name), len(stuck), median(shares)]

    def _harder(self, name: str) -> list[float | None]:
        goals_of: dict[str, list[bool]] = {}
        for one in self.raw.valid:
            if one.run_id not in self.the_others:
                goals_of.setdefault(one.scenario_id, []).append(goal(one))
        reached = {key for key, values in goals_of.items() if 2 * sum(values) > len(values)}
        groups: dict[str, set[str]] = {}
        for key in {one.scenario_id for one in self.raw.valid}:
            facts = self.raw.facts[key]
            for kind in facts.participants.counts:
                groups.setdefault(f"with a {kind}", set()).add(key)
            for kind in [kind for kind in ROAD_KINDS if kind in facts.tags][:1]:
                groups.setdefault(f"tagged {kind}", set()).add(key)
        tables, p_values = dict[str, list[float]](), dict[str, float]()
        for group, members in groups.items():
            inside, outside = members & goals_of.keys(), goals_of.keys() - members
            if min(len(inside), len(outside)) >= 4:
                counts = [len(inside & reached), len(inside), len(outside & reached), len(outside)]
                tables[group] = [float(count) for count in counts]
                a, b, c, d = counts
                p_values[group] = float(fisher_exact(np.array([[a, b - a], [c, d - c]]))[1])
        return [*tables[name], holm(p_values)[name]]

    def _of_rows(self) -> list[Row]:
        names = {"braking since": "braked_since_s", "standing since": "ego_stood_since_s"}

        def since(match: re.Match[str]) -> list[float | None]:
            return [self._contact(match.string)[names.get(match[1], "came_in_s")]]

        def until(match: re.Match[str]) -> list[float | None]:
            return [self._contact(match.string)["prevention"]["by_braking_until_s"]]

        def end(match: re.Match[str]) -> list[float | None]:
            one = self._run(match.string)
            return [one.metrics.duration_s if one.metrics else None, metric(one, "minimum distance")]

        def in_report(match: re.Match[str]) -> list[float | None]:
            names = ("minimum distance", "time to collision", "largest jerk")
            values = [
                metric(next(one for one in self.raw.records if one.run_id in match.string), name) for name in names
            ]
            return [value for value in values if value is not None]

        def speeds(match: re.Match[str]) -> list[float | None]:
            one, seen = self._run(match.string), self._contact(match.string)
            hit = None if one.collision is None else one.collision.time_s
            return [hit, self.raw.steps[one.run_id].speed_mps[-1], seen["obstacle_id"], seen["other_speed_mps"]]

        def closest(match: re.Match[str]) -> list[float | None]:
            one = self._run(match.string)
            seen = self.reviews[one.run_id]["closest"]
            told = [seen[key] for key in ("obstacle_id", "time_s", "ego_speed_mps", "other_speed_mps")]
            return [metric(one, "minimum distance"), *told, metric(one, "time to collision")]

        return [
            (rf"at {N} s \(ego {N} m/s(?:, (?:not braking|[a-z]+ since [\d.]+ s))?; \w+ {N} {N} m/s", speeds),
            (
                rf"Closest: {N} m to \w+ {N} .*? at {N} s \(ego {N}, it {N} m/s\); least time to collision {N} s",
                closest,
            ),
            (rf"(acceleration|braking|jerk) {N} m/s[²³] at {N} s", self._motion),
            (rf"(braking since|standing since|in the way since) {N} s", since),
            (rf"full braking until {N} s", until),
            (
                (
                    rf"laid to the ego, which (?P<did>stood|braked)[a-z ]*?(?: by up to {N} m/s²)? from {N} s to {N} s"
                    rf"(?:, {N} m before its line)?(?:, much harder than \w+ {N} asked)?"
                ),
                self._own_stretch,
            ),
            (
                rf"laid to the ego, which (?:cut in|slowed|was|passed|did)[a-z ]* at {N} s",
                lambda match: [self._contact(match.string)["fault"]["time_s"]],
            ),
            (
                rf"steering aside until {N} s",
                lambda match: [self._contact(match.string)["prevention"]["by_steering_until_s"]],
            ),
            (rf"unforeseen: {N} m apart", lambda match: [self._contact(match.string)["predicted_gap_m"]]),
            (
                (
                    rf"(?:by|of|into|with|oncoming|crossing|standing|touched) [a-z]+ {N}"
                    rf"(?= at \S|, ego's| that cut|, in the way|, and was| alongside| from)"
                ),
                self._obstacle,
            ),
            (rf"^run_\w+ \|(?:.*)\| (?:{N}|–) \| (?:{N}|–) \| (?:{N}|–)$", in_report),
            (rf"; (?:{N}|–) s, gap (?:{N}|–) m$", end),
        ]

    def _of_rules(self) -> list[Row]:
        """Traffic rules of a run and of configurations, and limits of the vehicle."""

        def of_run(match: re.Match[str]) -> list[float | None]:
            verdict = self.broken[self._run(match.string).run_id][match[1]]
            since = [verdict["first_s"]] if match[4] is not None else []
            other = [verdict["obstacle_id"]] if match[5] is not None else []
            return [-verdict["robustness"], verdict["time_s"], *since, *other]

        def asked(match: re.Match[str]) -> list[RunRecord]:
            named = [name for name in self.names if name in match.string]
            config = max(named, key=len, default=None)
            own = [one for one in self.raw.valid if config is None or one.config_name == config]
            return [one for one in own if self.broken[one.run_id][match[1]]["robustness"] is not None]

        def of_config(match: re.Match[str]) -> list[float | None]:
            found = [self.broken[one.run_id][match[1]] for one in asked(match)]
            worst = [-verdict["robustness"] for verdict in found if verdict["first_s"] is not None]
            trials = [
                (one.scenario_id, float(verdict["first_s"] is not None))
                for one, verdict in zip(asked(match), found, strict=True)
            ]
            values = rate(trials)
            told = values if " % |" not in match[0] else [*values[:2], *values[3:5]]
            return [*told, *([max(worst)] if worst else [])]

        def excesses(match: re.Match[str]) -> dict[str, LimitExcess]:
            return {excess.name: excess for excess in self._run(match.string).beyond_vehicle or ()}

        def beyond(match: re.Match[str]) -> list[float | None]:
            one = excesses(match).get(match[1])
            return [] if one is None else [one.value, one.time_s, one.limit]

        def slides(match: re.Match[str]) -> list[float | None]:
            one = excesses(match).get("rolling")
            return [] if one is None else [100 * one.value, one.time_s]

        return [
            (rf"(R_\w+) [a-z ]+ by {N} \S+ at {N} s(?: \((?:from {N} s on)?(?:, )?(?:obstacle {N})?\))?", of_run),
            (rf"(R_\w+) [a-z ]+: (?:kept in all, )?broken in {RATE}(?:, by {N})?", of_config),
            (rf"^(R_\w+) [a-z ]+ \|.* {N} of {N} \| {N} to {N} % \| (?:{N}|–)", of_config),
            (rf"(speed|acceleration|friction|steering angle|steering rate) {N} \S+ at {N} s \(limit {N}\)", beyond),
            (rf"wheels that slide in {N} % of the steps, from {N} s on", slides),
        ]

    def _motion(self, match: re.Match[str]) -> list[float | None]:
        """The largest motion of a kind and its time, from the driven states."""
        one = self._run(match.string)
        steps = self.raw.steps[one.run_id]
        along = np.array(steps.acceleration_mps2)
        turned = np.diff(np.unwrap(steps.heading_rad))
        values = {
            "acceleration": along,
            "braking": -along,
            "lateral acceleration": np.array([0.0, *np.abs(np.array(steps.speed_mps[1:]) * turned / one.step_s)]),
            "jerk": np.array([0.0, *np.abs(np.diff(along)) / one.step_s]),
        }["lateral acceleration" if match.string[: match.start()].endswith("lateral ") else match[1]]
        values = values[1:]
        return [float(values.max()), (1 + int(values.argmax())) * one.step_s]

    def _run(self, line: str) -> RunRecord:
        """The failed run that a line is on: the only one that it names, or of a flip the one that failed."""
        named = [one for one in self.raw.records if one.run_id in line]
        return next((one for one in named if not goal(one)), named[0])

    def _own_stretch(self, match: re.Match[str]) -> list[float | None]:
        """The stretch that a collision is laid to; how hard it was, from the driven states."""
        one = self._run(match.string)
        moment = self._contact(match.string)["fault"]["moment"]
        since, until = (round(moment[key] / one.step_s) for key in ("since_s", "until_s"))
        felt = [-value for value in self.raw.steps[one.run_id].acceleration_mps2[since : until + 1]]
        hardest = [max(felt)] if match["did"] == "braked" else []
        before = [moment["distance_m"]] if "before its line" in match[0] else []
        harder = [moment["obstacle_id"]] if "much harder than" in match[0] else []
        return [*hardest, moment["since_s"], moment["until_s"], *before, *harder]

    def _contact(self, line: str) -> Mapping[str, Any]:
        contact: Mapping[str, Any] = self.reviews[self._run(line).run_id]["contact"]
        return contact

    def _obstacle(self, match: re.Match[str]) -> list[float | None]:
        hit = self._run(match.string).collision
        return [None if hit is None else hit.obstacle_id]

    def _uncompared(self, pairs: Pairs) -> list[float | None]:
        """The median cost of each side over the valid runs of all pairs."""
        sides = zip(*pairs.pairs, strict=True)
        costs = [[cost for one in side if (cost := metric(one, "mean total cost")) is not None] for side in sides]
        return [median(side) if side else None for side in costs]

    def _of_comparison(self, pairs: Pairs) -> list[Row]:
        success = pairs.success()
        words = "|".join(sorted(METRICS, key=len, reverse=True))
        fields = {field: name for name, (field, *_) in METRICS.items()}  # of verdicts, which name fields
        compared = [name for name in METRICS if name != "mean total cost"]
        adjusted = pairs.adjusted(compared)
        before, after = (self.weights[config] for config in self.raw.batch.configs)
        flips = (pairs.count(before=False, after=True), pairs.count(before=True, after=False))
        cells = {
            "both reach the goal": pairs.count(before=True, after=True),
            "only before": flips[1],
            "only after": flips[0],
            "neither": pairs.count(before=False, after=False),
        }

        def tested(match: re.Match[str]) -> list[float | None]:
            test = pairs.tested(match[1])
            if test is None:
                return []
            own = [test[key] for key in ("before", "after", "shift", "low", "high", "effect", "p")]
            medians = own[:1] if match[3] is None else own[:2]
            scenarios = [] if test["scenarios"] == test["pairs"] else [test["scenarios"]]
            holm_p = [] if match[9] is None else [adjusted.get(match[1])]
            return [*medians, *own[2:], *holm_p, test["pairs"], *scenarios]

        def medians(match: re.Match[str]) -> list[float | None]:
            test = pairs.tested(match[1])
            return [] if test is None else [test["before"], test["after"]]

        def shift(match: re.Match[str]) -> list[float | None]:
            test = pairs.tested(fields[match[1]])
            return [None if test is None else abs(test["shift"])]

        def report_row(match: re.Match[str]) -> list[float | None]:
            test = pairs.tested(match[1])
            if test is None:
                return [0]
            p = [test["p"]] if test["scenarios"] > 5 and match[8] is not None else []
            holm_p = [adjusted.get(match[1])] if match[9] is not None else []
            return [test["pairs"], *(test[key] for key in ("before", "after", "shift", "low", "high")), *p, *holm_p]

        return [
            (
                rf"{N} of {N} pairs flipped to success(?:, {N} to failure)?",
                lambda match: [flips[0], len(pairs.pairs), *(flips[1:] if match[3] is not None else [])],
            ),
            (rf"{N} of {N} pairs flipped to failure", lambda _: [flips[1], len(pairs.pairs)]),
            (rf"None of {N} pairs flipped", lambda _: [len(pairs.pairs)]),
            (rf"needs ({6}) scenarios that differ", lambda _: [6]),
            (rf"chance alone often gives such a difference \(p={N}\)", lambda _: [success["p"]]),
            (rf"about {N} scenarios are needed to show a difference of (10) points", lambda _: [success["needed"], 10]),
            (r"less than (10) points", lambda _: [10]),
            (rf"p={N} alone, {N} adjusted", lambda _: [success["p"], adjusted.get("success")]),
            (rf"(\w+) (?:rises|falls) by {N}", shift),
            (rf"^- {N} pairs:", lambda _: [len(pairs.pairs)]),
            (rf"({'|'.join(cells)}) {N}(?=[,;]|$)", lambda match: [cells[match[1]]]),
            (
                rf"{N} points \(95 %: {N} to {N}\), (?:McNemar|{N} scenarios) exact p={N}(?: \(Holm {N}\))?",
                lambda match: [
                    *(success[key] for key in ("difference", "low", "high")),
                    *([success["scenarios"]] if match[4] else []),
                    success["p"],
                    *([adjusted.get("success")] if match[6] is not None else []),
                ],
            ),
            (rf"mean total cost {N} → {N}, not compared", lambda _: self._uncompared(pairs)),
            (rf"flipped to success \({N}\)", lambda _: flips[:1]),
            (rf"flipped to failure \({N}\)", lambda _: flips[1:]),
            (rf"; {N} more: limit={N}", lambda match: [float(match[2]) - 3, *flips[_failing(match) :][:1]]),
            (
                (
                    rf"^- ({words})[^:]*: median {N}(?: → {N})? .*?shift {N} \(95 %: {N} to {N}\), effect {N}, p={N}"
                    rf"(?: \(Holm {N}\))?.*\(n={N} [a-z ]*?(?: of {N} scenarios)?\)"
                ),
                tested,
            ),
            (rf"({words})(?: \(0 [^)]*\))? {N}(?: → {N})?(?= |,|$)", medians),
            (rf"(?<=[:,] )(\w+) {N} → {N}", lambda match: [before.get(match[1]), after.get(match[1])]),
            (rf"left out: {N} runs .* {N} pairs", lambda _: [pairs.unpaired, pairs.invalid]),
            (
                (
                    rf"^({words})(?: \([^|]*\))? \| {N} \| {N} \| {N} \| {N} \[{N}, {N}\]"
                    rf" \| (?:{N}|–|<0.001) \| (?:{N}|–|<0.001)"
                ),
                report_row,
            ),
            (rf"^(\w+) \| {N} \| {N}$", lambda match: [before.get(match[1]), after.get(match[1])]),
        ]


def _failed(record: RunRecord) -> bool:
    return not goal(record)


def _failing(match: re.Match[str]) -> int:
    """1 in a line on flips to failure, else 0."""
    return int("to failure" in match.string)
