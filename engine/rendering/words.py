"""What the words of a report mean, for readers who did not make the runs; rules in full are in ``docs/runs.md``."""

import re
from collections.abc import Iterable, Sequence

from ...schemas.measures import MEASURES, Measure
from ...schemas.rendering import ReportSection
from ...schemas.reviews import ContactKind
from ...schemas.runs import Outcome, Prediction, Traffic

_OUTCOMES: dict[Outcome, str] = {
    "goal_reached": "the ego was in the goal's place, in its time, with its speed and heading where the goal has them",
    "goal_refused": "the ego reached the goal, but by a motion that CommonRoad's benchmark refuses",
    "goal_early": "the ego was in the goal's place, but only before its time",
    "goal_late": "the ego was in the goal's place, but only after its time",
    "goal_missed": "the ego passed the goal or ended elsewhere, or was there without the goal's speed or heading",
    "timeout": "the ego had not come to the goal when 1.7 times the time until the goal's end was over",
    "infeasible": "the planner found no trajectory that the vehicle can drive",
    "off_road": "the ego left the road",
    "collision": "the ego's body touched another's; the run ends there",
    "invalid": "the problem has no solution, which is known before the run; such runs count in no rate",
}
_KINDS: dict[ContactKind, str] = {
    "rear_end_by_other": "another drove into the ego from behind",
    "rear_end_by_ego": "the ego drove into the back of another",
    "cut_in": "another came into the ego's way within the last 3 s, and the ego ran into it",
    "cut_in_by_ego": "the ego came into another's way within the last 3 s, and was hit by it",
    "oncoming": "both came from opposite directions",
    "crossing": "both came from directions that cross",
    "side": "both drove side by side in one direction and touched",
    "into_standing": "the ego drove into another that stood",
    "onto_standing_ego": "another drove into an ego that stood",
    "road_boundary": "the ego left the road",
    "unclear": "who was hit is not recorded",
}
_PREDICTIONS: dict[Prediction, str] = {
    "constant_velocity": "the planner expects that others keep course and speed",
    "growing_covariance": "the planner expects that others keep course and speed, ever less surely",
    "lane": "the planner expects that others follow their lanes",
    "ground_truth": "the planner knows what others will do",
}
_TRAFFIC: dict[Traffic, str] = {
    "recorded": "the others repeat their recording whatever the ego does: they cannot brake for it",
    "reactive": "the others are simulated and react to the ego",
}
_TERMS: dict[str, str] = {
    "ego": "the vehicle that the planner drives",
    "scenario": "a piece of road with recorded or simulated traffic, and the task to bring the ego to a goal",
    "configuration": "a planner with the weights and settings that it runs with",
    "weight": "how much one term of the cost counts for the planner",
    "cost": "what the planner minimises when it chooses a trajectory: the sum of its terms, each times its weight",
    "lanelet": "a piece of a lane, driven in one direction",
    "reference driver": "a driver with stated reactions, put in the ego's place after the fact: full braking, the "
    "careful and the fuzzy driver of UN Regulation 157, and one that keeps the safe distances of RSS",
    "laid to": "what decides a collision: the ego, which stood or braked without a reason or made it otherwise; "
    "another that follows a recording and cannot brake; a prediction that had the other elsewhere; a plan that had "
    "it there; or neither, if it is not attributable",
    "traffic rule": "a rule of the road as a formula over the run; by how much it is broken is in its own unit "
    "(docs/traffic_rules.md)",
    "beyond the vehicle": "the driven motion exceeds a limit of the ego's vehicle, such as how fast its wheels turn",
    "preventable": "at least one reference driver in the ego's place prevents the collision",
    "RSS": "Responsibility-Sensitive Safety (Shalev-Shwartz et al. 2017): a rule for safe distances",
    "95 % interval": "the values that the runs leave open: of intervals made so, 95 in 100 hold the true value; the "
    "scenario is the unit",
    "median": "half of the values are below it, half above",
    "baseline": "the configuration that the others are compared with",
    "paired": "compared on the same problem under the same conditions",
    "shift": "by how much the pairs moved from before to after (Hodges and Lehmann)",
    "Holm": "an adjustment of p for several tests at once, so that none is found by chance alone",
    "Wilcoxon": "a test whether paired values moved, by the ranks of their differences",
    "p": "how often chance alone would show such a difference; below 0.05 it is called shown",
    "finding": "a statement computed from the runs, with the runs behind it",
}


def _spoken(name: str) -> str:
    return name.replace("_", " ")


def _defined(measure: Measure) -> str:
    return f"{measure.meaning} ({measure.abbreviation})" if measure.abbreviation else measure.meaning


DEFINITIONS: dict[str, str] = (
    _TERMS
    | {_spoken(name): text for name, text in _KINDS.items()}
    | {_spoken(name): text for name, text in _OUTCOMES.items()}
    | {one.words.partition(" (")[0]: _defined(one) for one in MEASURES}
    | {f"{_spoken(name)} prediction": text for name, text in _PREDICTIONS.items()}
    | {f"{name} traffic": text for name, text in _TRAFFIC.items()}
)
"""Word → what it means; the words as reports write them."""
DEFINED = frozenset((*_OUTCOMES, *_KINDS, *(one.name for one in MEASURES), *_PREDICTIONS, *_TRAFFIC))
"""The names of outcomes, kinds of contact, measures, predictions and traffic modes that are defined."""
_AS_WRITTEN = ("p", "RSS", "Holm", "Wilcoxon")
"""Words that are found in this spelling alone."""


def words_used(sections: Sequence[ReportSection]) -> list[tuple[str, str]]:
    """The defined words that stand in the text, tables and captions of a report, in alphabetical order."""
    text = _spoken("\n".join(part for section in sections for part in _parts(section)))
    used = [(word, meaning) for word, meaning in DEFINITIONS.items() if _stands_in(word, text)]
    return sorted(used, key=lambda item: item[0].lower())


def _stands_in(word: str, text: str) -> bool:
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
