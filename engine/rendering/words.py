"""The terms of a report, explained for readers who did not run the tests; full rules are in ``docs/runs.md``."""

import re
from collections.abc import Iterable, Sequence

from ...schemas.measures import MEASURES, Measure
from ...schemas.rendering import ReportSection
from ...schemas.reviews import ContactKind
from ...schemas.runs import Outcome, Prediction, Traffic

_OUTCOMES: dict[Outcome, str] = {
    "goal_reached": "the ego was in the goal area within its time, with the required speed and heading, if any",
    "goal_refused": "the ego reached the goal, but CommonRoad's benchmark refuses the motion",
    "goal_early": "the ego was in the goal area, but only before its time",
    "goal_late": "the ego was in the goal area, but only after its time",
    "goal_missed": "the ego passed the goal, ended elsewhere, or was there with a wrong speed or heading",
    "timeout": "the ego had not reached the goal after 1.7 times the time until the goal's end",
    "infeasible": "the planner found no trajectory that the vehicle can drive",
    "off_road": "the ego left the road",
    "collision": "the ego's body touched another body; the run ends there",
    "invalid": "the problem has no solution, as known before the run; these runs count in no rate",
}
_KINDS: dict[ContactKind, str] = {
    "rear_end_by_other": "another road user drove into the ego from behind",
    "rear_end_by_ego": "the ego drove into the rear of another road user",
    "cut_in": "another road user entered the ego's path within the last 3 s, and the ego hit it",
    "cut_in_by_ego": "the ego entered another road user's path within the last 3 s, and was hit by it",
    "oncoming": "both drove in opposite directions",
    "crossing": "both drove in crossing directions",
    "side": "both drove side by side in the same direction",
    "into_standing": "the ego drove into a standing road user",
    "onto_standing_ego": "another road user drove into the standing ego",
    "road_boundary": "the ego left the road",
    "unclear": "the other road user is not recorded",
}
_PREDICTIONS: dict[Prediction, str] = {
    "constant_velocity": "the planner expects others to keep course and speed",
    "growing_covariance": "the planner expects others to keep course and speed, with growing uncertainty",
    "lane": "the planner expects others to follow their lanes",
    "ground_truth": "the planner knows the others' future motion",
}
_TRAFFIC: dict[Traffic, str] = {
    "recorded": "the others repeat their recording regardless of the ego, and cannot brake for it",
    "reactive": "the others are simulated and react to the ego",
}
_TERMS: dict[str, str] = {
    "ego": "the vehicle that the planner drives",
    "scenario": "a piece of road with recorded or simulated traffic, and the task of driving the ego to a goal",
    "configuration": "a planner with its weights and settings",
    "weight": "the factor of one cost term",
    "cost": "the quantity that the planner minimises when it chooses a trajectory: the weighted sum of its terms",
    "lanelet": "a piece of a lane, driven in one direction",
    "reference driver": "a driver model with defined reactions, put in the ego's place afterwards: full braking, the "
    "careful and the fuzzy driver of UN Regulation 157, and one with the safe distances of RSS",
    "attributed to": "the cause of a collision: the ego, which stood or braked without a reason or caused it "
    "otherwise; a recorded road user that cannot brake; a prediction that placed the other elsewhere; a plan that "
    "accepted it there; or neither, if no cause can be attributed",
    "traffic rule": "a rule of the road as a formula over the run; each violation is measured in the rule's unit "
    "(docs/traffic_rules.md)",
    "beyond the vehicle": "the driven motion exceeds a limit of the ego's vehicle, such as its steering rate",
    "preventable": "at least one reference driver in the ego's place prevents the collision",
    "RSS": "Responsibility-Sensitive Safety (Shalev-Shwartz et al. 2017): a rule for safe distances",
    "95% interval": "the values that fit the runs: 95 of 100 intervals of this kind contain the true value; the "
    "scenario is the unit",
    "median": "half of the values are below it, half above it",
    "baseline": "the configuration that the others are compared with",
    "paired": "compared on the same problem under the same conditions",
    "shift": "the typical change of the pairs from before to after (Hodges and Lehmann)",
    "Holm": "an adjustment of p for several simultaneous tests, to avoid findings by chance",
    "Wilcoxon": "a test of whether paired values changed, by the ranks of their differences",
    "p": "how often chance alone would show this difference; below 0.05 the difference counts as shown",
    "finding": "a statement computed from the runs, with the runs behind it",
}


def _without_underscores(name: str) -> str:
    return name.replace("_", " ")


def _defined(measure: Measure) -> str:
    return f"{measure.meaning} ({measure.abbreviation})" if measure.abbreviation else measure.meaning


DEFINITIONS: dict[str, str] = (
    _TERMS
    | {_without_underscores(name): text for name, text in _KINDS.items()}
    | {_without_underscores(name): text for name, text in _OUTCOMES.items()}
    | {one.words.partition(" (")[0]: _defined(one) for one in MEASURES}
    | {f"{_without_underscores(name)} prediction": text for name, text in _PREDICTIONS.items()}
    | {f"{name} traffic": text for name, text in _TRAFFIC.items()}
)
"""Maps terms to their meaning, in the spelling of reports."""
DEFINED = frozenset((*_OUTCOMES, *_KINDS, *(one.name for one in MEASURES), *_PREDICTIONS, *_TRAFFIC))
"""The names of outcomes, kinds of contact, measures, predictions and traffic modes that have a definition."""
_AS_WRITTEN = ("p", "RSS", "Holm", "Wilcoxon")
"""Terms that match only in this spelling."""


def words_used(sections: Sequence[ReportSection]) -> list[tuple[str, str]]:
    """Return the defined terms that occur in the text, tables and captions of a report, in alphabetical order."""
    text = _without_underscores("\n".join(part for section in sections for part in _parts(section)))
    used = [(word, meaning) for word, meaning in DEFINITIONS.items() if _occurs_in(word, text)]
    return sorted(used, key=lambda item: item[0].lower())


def _occurs_in(word: str, text: str) -> bool:
    flags = 0 if word in _AS_WRITTEN else re.IGNORECASE
    return re.search(rf"(?<![\w-]){re.escape(word)}s?(?![\w-])", text, flags) is not None


def _parts(section: ReportSection) -> Iterable[str]:
    yield from (section.title, section.asked, *section.text, *section.findings)
    for table in section.tables:
        yield from (table.caption, *table.columns)
        for row in table.rows:
            yield from row
    for image in section.images:
        yield image.caption
