"""Test suites for planners: what to run, which limits must hold, and the result.

A suite is a YAML file that people write and keep next to their code (``docs/gate.md``).
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final, Literal

from pydantic import Field

from ..base import Model
from ..catalog import FindScenariosArguments
from ..generation import GenerateScenariosArguments
from ..planning import ConfigurePlannerArguments
from ..runs import LostCell, Outcome, Prediction, RunRecord, Traffic
from ..worlds import PERFECT, World


class SuiteFile(Model):
    """A suite file as written; entries in the form of a mapping are parsed separately."""

    name: str = "suite"
    scenarios: tuple[str | dict[str, Any], ...] = Field(min_length=1)
    configurations: tuple[str | dict[str, Any], ...] = Field(("frenetix:Default",), min_length=1)
    prediction: Prediction = "constant_velocity"
    traffic: Traffic = "recorded"
    world: tuple[str, ...] | str = ()
    seed: int = 0
    limits: tuple[str, ...] = Field(min_length=1)


class SuiteFiles(Model):
    """A CommonRoad file, or a folder of them, next to the suite.

    ``problem``: one of the planning problems of a file; None means the first.
    """

    path: str
    problem: int | None = None


class SuiteConfiguration(Model):
    """A planner configuration created for the suite; ``name`` identifies it in limits and reports."""

    name: str
    arguments: ConfigurePlannerArguments


class SuiteWeightFile(Model):
    """A file with cost weights and settings next to the suite; ``name`` identifies it in limits and reports."""

    name: str = Field("", description="empty: the name that follows from its content")
    file: str


class Suite(Model):
    """A test suite: scenarios × configurations, and limits on the results.

    Scenarios are arguments of ``run_planner``, files, the results of a search, or generated scenarios.
    """

    name: str
    scenarios: tuple[str | SuiteFiles | FindScenariosArguments | GenerateScenariosArguments, ...]
    configurations: tuple[str | SuiteConfiguration | SuiteWeightFile, ...]
    prediction: Prediction
    traffic: Traffic
    seed: int
    world: World = PERFECT
    limits: tuple[str, ...]


class SuiteBaseline(Model):
    """Runs of a suite that later runs are compared with, stored in a file next to the suite."""

    suite: str
    configurations: Mapping[str, tuple[RunRecord, ...]] = Field(description="by name in the suite")


class SuiteCase(Model):
    """One run of a suite, or why it is missing; ``ended`` is its outcome in words."""

    configuration: str
    scenario_id: str
    problem_id: int | None
    run_id: str | None
    outcome: Outcome | Literal["lost"]
    ended: str
    duration_s: float | None = None


class SuiteProgress(Model):
    """Which failures of a baseline's runs a configuration no longer has, still has, or has anew, by scenario.

    A run fails if it ends in one of ``FAILED_OUTCOMES``. Scenarios that only one side ran are left out.
    """

    configuration: str
    baseline: str
    fixed: tuple[str, ...] = ()
    still_failing: tuple[str, ...] = ()
    newly_failing: tuple[str, ...] = ()

    def in_words(self) -> str:
        """Return the three groups; the first two scenarios of each are named."""
        groups = (("fixed", self.fixed), ("still failing", self.still_failing), ("newly failing", self.newly_failing))
        parts = [f"{len(ids)} {word}{_named(ids)}" for word, ids in groups]
        return f"{self.configuration} since {self.baseline}: {', '.join(parts)}"


FAILED_OUTCOMES: Final[tuple[Outcome, ...]] = ("collision", "off_road", "infeasible")
"""Outcomes that count as a failure of the planner when runs are compared with a baseline."""
_MOST_NAMED = 2


def _named(ids: Sequence[str]) -> str:
    more = f" and {len(ids) - _MOST_NAMED} more" if len(ids) > _MOST_NAMED else ""
    return f" ({', '.join(ids[:_MOST_NAMED])}{more})" if ids else ""


class LimitVerdict(Model):
    """The verdict on a limit for a configuration; ``observed`` is the value, ``run_ids`` the runs that break it."""

    limit: str
    configuration: str
    holds: bool
    observed: str
    run_ids: tuple[str, ...] = ()


class SuiteReport(Model):
    """The result of a suite."""

    suite: str
    batch_id: str
    cases: tuple[SuiteCase, ...]
    verdicts: tuple[LimitVerdict, ...]
    reused: int = Field(description="runs already stored")
    lost: tuple[LostCell, ...] = ()
    notes: tuple[str, ...] = ()
    progress: tuple[SuiteProgress, ...] = Field((), description="for each configuration and baseline")
    runs: SuiteBaseline = Field(description="runs to keep as a baseline")

    @property
    def passed(self) -> bool:
        """Whether all limits hold."""
        return all(verdict.holds for verdict in self.verdicts)
