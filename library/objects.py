"""Objects that the Python library returns: scenarios, runs and pictures, all of which notebooks can display."""

import base64
import html
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, overload

from ..engine.workspace import Workspace
from ..schemas.base import Result
from ..schemas.measures import RunMetrics
from ..schemas.planning import RunPlannerResult, RunResponse
from ..schemas.runs import RunRecord, RunSeries, RunSteps, configuration_id

if TYPE_CHECKING:
    import pandas


class Home(Protocol):
    """The workspace that objects come from."""

    @property
    def stored(self) -> Workspace:
        """The workspace with the stored artifacts."""

    def render(self, *things: Any, **arguments: Any) -> tuple["Picture", ...]:
        """Draw artifacts."""

    def resume(self, run_id: str, time_s: float, planner: Any) -> RunResponse:
        """Continue a run from a time with another planner."""


@dataclass(frozen=True)
class Picture:
    """A picture file with its alternative text."""

    path: Path
    media_type: str
    words: str

    def _repr_html_(self) -> str:
        data = base64.b64encode(self.path.read_bytes()).decode()
        return f'<img src="data:{self.media_type};base64,{data}" alt="{html.escape(self.words, quote=True)}">'


@dataclass(frozen=True)
class Scenario:
    """A stored scenario; ``ID#problem`` selects a planning problem other than the first."""

    workspace: Home = field(repr=False, compare=False)
    scenario_id: str

    def __str__(self) -> str:
        return self.scenario_id

    @property
    def path(self) -> Path:
        """The CommonRoad file."""
        return self.workspace.stored.file("scenario", self.scenario_id.partition("#")[0], "scenario.xml")

    def plot(self, **arguments: Any) -> Picture:
        """Draw the scenario; takes the arguments of ``render``."""
        return self.workspace.render(self, **arguments)[0]

    def _repr_html_(self) -> str:
        return f"<p><code>{html.escape(self.scenario_id)}</code></p>{self.plot()._repr_html_()}"


@dataclass(frozen=True)
class Scenarios(Sequence[Scenario]):
    """An ordered collection of scenarios; ``result`` is the answer that returned them."""

    result: Result
    scenarios: Sequence[Scenario]

    def __len__(self) -> int:
        return len(self.scenarios)

    @overload
    def __getitem__(self, index: int) -> Scenario: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[Scenario]: ...

    def __getitem__(self, index: int | slice) -> Scenario | Sequence[Scenario]:
        return self.scenarios[index]

    def __str__(self) -> str:
        return self.result.to_text()

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(str(self))}</pre>"


@dataclass(frozen=True)
class Run:
    """A stored run."""

    workspace: Home = field(repr=False, compare=False)
    run_id: str

    def __str__(self) -> str:
        return self.run_id

    @property
    def record(self) -> RunRecord:
        """The run's record: its outcome and its metrics."""
        return self.workspace.stored.get(self.run_id, "run").read(RunRecord)

    @property
    def outcome(self) -> str:
        """The outcome of the run, such as ``goal_reached`` or ``collision``."""
        return self.record.outcome

    @property
    def steps(self) -> RunSteps:
        """The driven states and the cost terms of the plans."""
        return RunSteps.model_validate_json(self._file("steps.json").read_bytes())

    @property
    def series(self) -> RunSeries:
        """Further time series, including the planner's debug values; empty if the ego drove no step."""
        path = self._file("series.json")
        return RunSeries.model_validate_json(path.read_bytes()) if path.is_file() else RunSeries()

    def at(self, time_s: float) -> "Moment":
        """Return the moment ``time_s`` seconds after the start of the run, from which another planner can continue."""
        return Moment(self, time_s)

    def to_pandas(self) -> "pandas.DataFrame":
        """Return a table with one row per driven state: position, motion and offset from the reference path."""
        return _states(self.steps, self.series)

    def plot(self, **arguments: Any) -> Picture:
        """Draw the run; takes the arguments of ``render``."""
        return self.workspace.render(self, **arguments)[0]

    def _file(self, name: str) -> Path:
        return self.workspace.stored.folder("run", self.run_id) / name

    def _repr_html_(self) -> str:
        record = self.record
        caption = html.escape(f"{self.run_id}: {record.outcome}, {record.reason}")
        return f"<p>{caption}</p>{self.plot()._repr_html_()}"


@dataclass(frozen=True)
class Moment:
    """A moment of a run, ``time_s`` seconds after its start."""

    run: Run
    time_s: float

    def resume(self, planner: Any = "current") -> "Drive":
        """Continue the run from here with a planner (a name or an object); other vehicles follow their recordings.

        Raises:
            InvalidRequest: The run has no state at this time.
            NotPossible: The run was driven in reactive traffic.
        """
        return Drive(self.run.workspace.resume(self.run.run_id, self.time_s, planner))


@dataclass(frozen=True)
class Drive:
    """A continuation of a run from one of its moments; it is not stored."""

    response: RunResponse

    @property
    def record(self) -> RunRecord:
        """The record of the continuation: its outcome and its metrics."""
        return self.response.record

    def to_pandas(self) -> "pandas.DataFrame":
        """Return a table with one row per driven state, like :meth:`Run.to_pandas`."""
        return _states(self.response.steps, self.response.series or RunSeries())


def _states(steps: RunSteps, series: RunSeries) -> "pandas.DataFrame":
    import pandas

    columns: dict[str, Sequence[float]] = {
        name: getattr(steps, name) for name in ("x_m", "y_m", "heading_rad", "speed_mps", "acceleration_mps2")
    }
    columns |= {
        name: values
        for name in ("lateral_offset_m", "heading_error_rad", "steering_rad")
        if len(values := getattr(series, name)) == len(steps.x_m)
    }
    index = pandas.RangeIndex(steps.first_step, steps.first_step + len(steps.x_m), name="step")
    return pandas.DataFrame({name: list(values) for name, values in columns.items()}, index=index)


_RUN_FIELDS = [
    "run_id",
    "scenario_id",
    "problem_id",
    "config_id",
    "config_name",
    "planner_version",
    "outcome",
    "reason",
]
"""Fields of a run's record that precede the metrics in its row."""


@dataclass(frozen=True)
class Runs(Sequence[Run]):
    """An ordered collection of runs; ``result`` is the answer that returned them."""

    workspace: Home = field(repr=False, compare=False)
    result: RunPlannerResult
    runs: Sequence[Run]

    def __len__(self) -> int:
        return len(self.runs)

    @overload
    def __getitem__(self, index: int) -> Run: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[Run]: ...

    def __getitem__(self, index: int | slice) -> Run | Sequence[Run]:
        return self.runs[index]

    def __str__(self) -> str:
        return self.result.to_text()

    @property
    def result_ids(self) -> list[str]:
        """The ids that analyses and comparisons take for these runs: their batch, or each single run."""
        return [self.result.batch_id] if self.result.batch_id else [run.run_id for run in self.runs]

    def to_pandas(self) -> "pandas.DataFrame":
        """Return a table with one row per run: its outcome and its metrics."""
        import pandas

        rows: list[dict[str, Any]] = []
        for run in self.runs:
            record = run.record
            metrics = {} if record.metrics is None else record.metrics.model_dump(mode="json")
            rows.append(
                {name: getattr(record, name) for name in _RUN_FIELDS}
                | {"config_id": configuration_id(record.config_id)}
                | metrics
            )
        return pandas.DataFrame(rows, columns=[*_RUN_FIELDS, *RunMetrics.model_fields])

    def to_parquet(self, path: str | Path) -> Path:
        """Write the table of :meth:`to_pandas` to a Parquet file and return its path."""
        target = Path(path)
        self.to_pandas().to_parquet(target, index=False)
        return target

    def plot(self, kind: str = "outcomes", **arguments: Any) -> Picture:
        """Draw a chart of the runs, by default of their outcomes; takes the arguments of ``render``."""
        return self.workspace.render(self, kind=kind, **arguments)[0]

    def _repr_html_(self) -> str:
        return str(self.to_pandas().to_html(index=False, max_rows=20))
