"""Test suites for planners: what is run, what must hold of it, and what came out.

A suite is a YAML file that people write and keep beside their code (``docs/gate.md``).
"""

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import Field

from ..base import Model
from ..catalog import FindScenariosArguments
from ..generation import GenerateScenariosArguments
from ..planning import ConfigurePlannerArguments
from ..runs import LostCell, Outcome, Prediction, RunRecord, Traffic


class SuiteFile(Model):
    """A suite as it is written; what an entry in the form of a mapping means is read apart."""

    name: str = "suite"
    scenarios: tuple[str | dict[str, Any], ...] = Field(min_length=1)
    configurations: tuple[str | dict[str, Any], ...] = Field(("frenetix:Default",), min_length=1)
    prediction: Prediction = "constant_velocity"
    traffic: Traffic = "recorded"
    seed: int = 0
    limits: tuple[str, ...] = Field(min_length=1)


class SuiteFiles(Model):
    """A CommonRoad file, or a folder of them, beside the suite."""

    path: str


class SuiteConfiguration(Model):
    """A configuration of a planner that is made for the suite; ``name``: for limits and reports."""

    name: str
    arguments: ConfigurePlannerArguments


class Suite(Model):
    """A test suite: scenarios × configurations, and limits on what comes out.

    A scenario is a word that ``run_planner`` takes, files, what a search finds, or what is generated.
    """

    name: str
    scenarios: tuple[str | SuiteFiles | FindScenariosArguments | GenerateScenariosArguments, ...]
    configurations: tuple[str | SuiteConfiguration, ...]
    prediction: Prediction
    traffic: Traffic
    seed: int
    limits: tuple[str, ...]


class SuiteBaseline(Model):
    """Runs of a suite that later ones are held against, kept as a file beside it."""

    suite: str
    configurations: Mapping[str, tuple[RunRecord, ...]] = Field(description="by name in the suite")


class SuiteCase(Model):
    """One run of a suite, or why there is none; ``ended``: how it ended in words."""

    configuration: str
    scenario_id: str
    problem_id: int | None
    run_id: str | None
    outcome: Outcome | Literal["lost"]
    ended: str
    duration_s: float | None = None


class LimitVerdict(Model):
    """Whether a limit holds for a configuration; ``observed``: what was seen, ``run_ids``: the runs against it."""

    limit: str
    configuration: str
    holds: bool
    observed: str
    run_ids: tuple[str, ...] = ()


class SuiteReport(Model):
    """What came out of a suite."""

    suite: str
    batch_id: str
    cases: tuple[SuiteCase, ...]
    verdicts: tuple[LimitVerdict, ...]
    reused: int = Field(description="runs that were stored before")
    lost: tuple[LostCell, ...] = ()
    notes: tuple[str, ...] = ()
    runs: SuiteBaseline = Field(description="to be kept as a baseline")

    @property
    def passed(self) -> bool:
        """Return whether all limits hold."""
        return all(verdict.holds for verdict in self.verdicts)
