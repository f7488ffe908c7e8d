"""The runs of a batch as a table: CSV for people, Parquet for notebooks.

One row a cell: what is stored of a run, its measures, weights and settings. A cell without a run has the outcome
``lost`` and the error as its reason, so that nothing is missing from the table without being said.
"""

import csv
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from ...schemas.artifacts import FileWritten, RunTableRequest
from ...schemas.measures import MEASURES
from ...schemas.planning import PlannerConfiguration, PlannerSettings
from ...schemas.results import ConfigWeights
from ...schemas.runs import CollisionRecord, LostCell, RunMetrics, RunRecord, RunSource
from ..execution import ProgressReporter
from .measures import measures_of
from .run_set import RunSet

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


def _measured(request: RunTableRequest) -> Iterator[dict[str, Value]]:
    """What was not stored with each run, in their order, and is computed from its steps; None where there is none."""
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
    """The rows, in the order of the runs, then of the lost cells; a figure that is not defined is None."""
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
    return json.dumps(value, sort_keys=True) if isinstance(value, dict | list) else value


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
    """Column → type of its values, from the models, so that an empty column has its type too."""
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
