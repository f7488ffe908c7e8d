"""Runs all rules on a network: module by module and, within a module, in order of definition.

To add a rule, write its function under ``@rule`` in the module of its subject, its defect in the tests, and its line in
``docs/rules.md``.
"""

from collections.abc import Iterable
from pathlib import Path

from ....schemas.errors import UnsafeInput
from ....schemas.scenarios import CheckedFile, RuleFinding, Severity
from ...commonroad import RoadDocument, read_road_document
from . import geometry, intersections, signs_and_lights, topology, vocabulary
from .rule import Rule

_MODULES = (geometry, topology, signs_and_lights, intersections, vocabulary)


def all_rules() -> tuple[Rule, ...]:
    """Return the rules in the order in which they run and report."""
    return tuple(value for module in _MODULES for value in vars(module).values() if isinstance(value, Rule))


def check_file(path: Path) -> CheckedFile:
    """Run all rules on a CommonRoad file; an unreadable file is reported, not raised."""
    try:
        document = read_road_document(path)
    except UnsafeInput as error:
        return CheckedFile(file=str(path), unreadable=error.message)
    return CheckedFile(file=str(path), findings=check_network(document))


def check_network(document: RoadDocument) -> tuple[RuleFinding, ...]:
    """Return the rules' findings on a network: errors before warnings, and each in the order of the rules."""
    findings = [finding for rule in all_rules() for finding in rule.check(document)]
    return tuple(sorted(findings, key=lambda finding: finding.severity))


def summarise_findings(findings: Iterable[RuleFinding], severity: Severity) -> tuple[str, ...]:
    """Return text on the findings of one severity: each rule once, with its number of positions and the first one."""
    by_rule: dict[str, list[RuleFinding]] = {}
    for finding in findings:
        if finding.severity == severity:
            by_rule.setdefault(finding.rule, []).append(finding)
    return tuple(
        f"{rule} ({len(places)}): {places[0].elements[0]} {places[0].message}" for rule, places in by_rule.items()
    )
