"""The runs of a batch, or the steps of a run, as a table: CSV for people, Parquet for notebooks.

The table of a batch has one row per cell: the stored data of a run, its measures, weights and settings. A cell without
a run has the outcome ``lost`` and the error as its reason, so every missing run is visible.

The table of a run has one row for each driven state. What belongs to a planning step (cost terms, rejections, desired
speed, debug values) is in the row of that step and empty in the other rows.
"""

import csv
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from ...schemas.artifacts import FileWritten, RunTableRequest, StepTableRequest
from ...schemas.errors import NotPossible
from ...schemas.measures import MEASURES, RunMetrics
from ...schemas.planning import PlannerConfiguration, PlannerSettings
from ...schemas.results import ConfigWeights
from ...schemas.runs import CollisionRecord, LostCell, RunRecord, RunSeries, RunSource, RunSteps
from ...schemas.text import one_line
from ..execution import ProgressReporter
from .measures import measures_of
from .run_set import RunSet, read_series, read_steps

Value = str | int | float | None
_MEASURED = tuple(f"measure_{one.name}" for one in MEASURES if not one.stored)
_PARTS: dict[str, type[BaseModel]] = {"collision": CollisionRecord, "metrics": RunMetrics}


def write_run_table(request: RunTableRequest, report: ProgressReporter) -> FileWritten:
    """Write the table of a batch to the request's path."""
    kinds = _record_columns() | dict.fromkeys(_MEASURED, float) | _tuning_columns(request.configurations)
    rows = _run_rows(request.records, request.lost, request.configurations)
    for number, (row, measured) in enumerate(zip(rows, _measured(request), strict=False)):
        row.update(measured)
        report((number + 1) / len(rows), str(row["run_id"]))
    target = Path(request.target_path)
    if request.form == "csv":
        _write_csv(rows, list(kinds), target)
    else:
        _write_parquet(rows, kinds, target)
    report(1.0, f"{len(rows)} rows written")
    return FileWritten(path=request.target_path)


def write_step_table(request: StepTableRequest, report: ProgressReporter) -> FileWritten:
    """Write the steps of a run, with its series and debug values, to the request's path.

    Raises:
        NotPossible: the run has no driven states.
        ResourceFailure: its steps cannot be read.
    """
    source = RunSource(record=request.record, steps_path=request.steps_path)
    steps, series = read_steps(source), read_series(source) or RunSeries()
    if steps is None or not steps.x_m:
        raise NotPossible(f"{request.record.run_id} has no driven states", valid=["a run that was attempted"])
    columns = _state_columns(steps, series, request.record.step_s) | _planned_columns(steps, series)
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    target = Path(request.target_path)
    if request.form == "csv":
        _write_csv(rows, list(columns), target)
    else:
        kinds = {name: _kind_of(values) for name, values in columns.items()}
        _write_parquet(rows, kinds, target)
    report(1.0, f"{len(rows)} rows written")
    return FileWritten(path=request.target_path)


Column = Sequence[Value]


def _state_columns(steps: RunSteps, series: RunSeries, step_s: float) -> dict[str, Column]:
    """Return one value for each driven state; columns of series that were not kept are empty."""
    count = len(steps.x_m)
    named: dict[str, Column] = {
        "step": [steps.first_step + index for index in range(count)],
        "time_s": [round(index * step_s, 9) for index in range(count)],
        **{name: getattr(steps, name) for name in ("x_m", "y_m", "heading_rad", "speed_mps", "acceleration_mps2")},
        **{name: getattr(series, name) for name in ("lateral_offset_m", "heading_error_rad", "steering_rad")},
    }
    return {name: values if len(values) == count else [None] * count for name, values in named.items()}


def _planned_columns(steps: RunSteps, series: RunSeries) -> dict[str, Column]:
    """Return one value for each driven state at which a plan was made."""
    rows = [step - steps.first_step for step in steps.plan_steps]
    planned: dict[str, Column] = {
        "desired_speed_mps": series.desired_speed_mps,
        "desired_speed_reason": series.desired_speed_reasons,
        **{f"cost {name}": values for name, values in steps.costs.items()},
        **{f"rejected {name}": values for name, values in steps.rejected.items()},
        **{f"debug {name}": values for name, values in series.numbers.items()},
        **{f"debug text {name}": values for name, values in series.texts.items()},
    }

    def spread(values: Column) -> list[Value]:
        column: list[Value] = [None] * len(steps.x_m)
        for row, value in zip(rows, values, strict=False):  # the last attempt, which gave no plan, has no row
            column[row] = value
        return column

    return {one_line(name): spread(values) for name, values in planned.items()}


def _kind_of(values: Column) -> type:
    """Return the type of a column's values; float if the column is empty."""
    return next((type(value) for value in values if value is not None), float)


def _measured(request: RunTableRequest) -> Iterator[dict[str, Value]]:
    """Yield the measures of each run that are not stored but computed from its steps; None for a missing measure."""
    known = {configuration.config_id: configuration for configuration in request.configurations}
    for record in request.records:
        configuration = known.get(record.config_id)
        settings = {} if configuration is None else configuration.settings.model_dump(exclude_defaults=True)
        weights = ConfigWeights(
            config_id=record.config_id, name="", planner=record.planner, weights={}, settings=settings
        )
        source = RunSource(record=record, steps_path=request.steps_paths.get(record.run_id))
        runs = RunSet((source,), (weights,), request.scenarios)
        yield {
            f"measure_{one.name}": one.value
            for one in (measures_of(runs, record) if source.steps_path is not None else ())
            if f"measure_{one.name}" in _MEASURED
        }


def _run_rows(
    records: Sequence[RunRecord], lost: Sequence[LostCell], configurations: Sequence[PlannerConfiguration]
) -> list[dict[str, Value]]:
    """Return one row for each run, in order, then one for each lost cell; an undefined figure is None."""
    tuning = {item.config_id: _tuning(item) for item in configurations}
    rows = [_flat(record.model_dump(mode="json")) | tuning.get(record.config_id, {}) for record in records]
    for cell in lost:
        known: dict[str, Value] = {"scenario_id": cell.scenario_id, "config_id": cell.config_id}
        rows.append(known | {"outcome": "lost", "reason": cell.error} | tuning.get(cell.config_id, {}))
    return rows


def _flat(record: Mapping[str, Any]) -> dict[str, Value]:
    row: dict[str, Value] = {}
    for name, value in record.items():
        if name in _PARTS:
            row.update({f"{name}_{key}": _cell(entry) for key, entry in (value or {}).items()})
        else:
            row[name] = _cell(value)
    return row


def _cell(value: Any) -> Value:
    return json.dumps(value, sort_keys=True) if isinstance(value, dict | list | bool) else value


def _tuning(configuration: PlannerConfiguration) -> dict[str, Value]:
    settings = {f"setting_{name}": value for name, value in configuration.settings.model_dump().items()}
    values = configuration.weights | configuration.external_weights
    return settings | {f"weight_{name}": value for name, value in sorted(values.items())}


def _tuning_columns(configurations: Sequence[PlannerConfiguration]) -> dict[str, type]:
    fields = PlannerSettings.model_fields.items()
    settings = {f"setting_{name}": _type_of(field.annotation) for name, field in fields}
    weights = sorted({key for item in configurations for key in _tuning(item)} - settings.keys())
    return settings | dict.fromkeys(weights, float)


def _record_columns() -> dict[str, type]:
    """Return the type of each column's values, read from the models, so that empty columns have a type too."""
    columns: dict[str, type] = {}
    for name, field in RunRecord.model_fields.items():
        part = _PARTS.get(name)
        if part is None:
            columns[name] = _type_of(field.annotation)
        else:
            columns |= {f"{name}_{key}": _type_of(entry.annotation) for key, entry in part.model_fields.items()}
    return columns


def _type_of(annotation: Any) -> type:
    for kind in (int, float):
        if annotation in (kind, kind | None):
            return kind
    return str


def _write_csv(rows: Sequence[Mapping[str, Value]], columns: Sequence[str], target: Path) -> None:
    with target.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, columns, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def _write_parquet(rows: Sequence[Mapping[str, Value]], columns: Mapping[str, type], target: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    types = {int: pa.int64(), float: pa.float64(), str: pa.string()}
    schema = pa.schema([(name, types[kind]) for name, kind in columns.items()])
    pq.write_table(pa.Table.from_pylist([dict(row) for row in rows], schema=schema), target)
