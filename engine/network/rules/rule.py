"""Defines rules and their findings.

A rule is a function under ``@rule``; the function's name is the rule's id."""

import inspect
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from ....schemas.scenarios import RuleFinding, Severity
from ...commonroad import RoadDocument
from ...geometry import Points


@dataclass(frozen=True)
class Defect:
    """A place where a rule is violated: the message, the ids concerned (the lanelet first), a point (2,) in m."""

    message: str
    elements: tuple[int, ...]
    where: Points | None = None


Find = Callable[[RoadDocument], Iterator[Defect]]


@dataclass(frozen=True)
class Rule:
    """A rule with its description.

    ``severity``: an *error* makes the network unusable or ambiguous for a reader or a planner; a *warning* is unusual
    and may be intended. ``meaning`` describes a defect, ``why`` its effect.
    """

    rule_id: str
    severity: Severity
    meaning: str
    why: str
    find: Find

    def check(self, document: RoadDocument) -> list[RuleFinding]:
        """Return all defects of one network."""
        return [
            RuleFinding(
                rule=self.rule_id,
                severity=self.severity,
                elements=defect.elements,
                where=None
                if defect.where is None
                else (round(float(defect.where[0]), 2), round(float(defect.where[1]), 2)),
                message=defect.message,
            )
            for defect in self.find(document)
        ]


def rule(severity: Severity, *, why: str) -> Callable[[Find], Rule]:
    """Make a rule from the function that finds its defects, with the function's name and docstring.

    Args:
        severity: see :class:`Rule`.
        why: the effect of a defect on a reader or a planner.
    """

    def make(find: Find) -> Rule:
        return Rule(find.__name__, severity, inspect.cleandoc(find.__doc__ or ""), why, find)

    return make
