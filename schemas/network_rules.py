"""What the rules find in road networks."""

from typing import Literal

from pydantic import Field

from .base import Model

Severity = Literal["error", "warning"]


class RuleFinding(Model):
    """One defect: the rule that found it, the ids of the elements concerned, where it is, and what is wrong."""

    rule: str
    severity: Severity
    elements: tuple[int, ...]
    where: tuple[float, float] | None = Field(description="x, y in m; None where the defect has no place")
    message: str


class CheckedFile(Model):
    """A file with what the rules found; ``unreadable`` says why none could be run."""

    file: str
    findings: tuple[RuleFinding, ...] = ()
    unreadable: str = ""

    def count(self, severity: Severity) -> int:
        """How many findings are of this severity."""
        return sum(finding.severity == severity for finding in self.findings)

    @property
    def passed(self) -> bool:
        """Whether the file could be read and no rule found an error."""
        return not self.unreadable and self.count("error") == 0
