"""Tables of a batch: a row a cell, a type a column, nothing left out."""

import csv
from pathlib import Path
from typing import Literal

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from support.planning import configuration
from support.runs import driven, record, source

from plannerforge.engine.analysis.run_table import write_run_table, write_step_table
from plannerforge.engine.execution.executor import silent
from plannerforge.schemas.artifacts import RunTableRequest, StepTableRequest
from plannerforge.schemas.runs import LostCell, RunSeries

CONFIG = configuration()


def request(form: Literal["csv", "parquet"], target: Path, *, with_runs: bool = True) -> RunTableRequest:
    runs = (record(), record("ZAM_Town-2_1_T-1", "collision", obstacle_id=7, rejected={"yaw_rate": 3}))
    own = tuple(run.model_copy(update={"config_id": CONFIG.config_id}) for run in runs)
    return RunTableRequest(
        records=own if with_runs else (),
        lost=(LostCell(scenario_id="ZAM_Town-3_1_T-1", config_id=CONFIG.config_id, error="[worker_failure] died"),),
        configurations=(CONFIG,),
        form=form,
        target_path=str(target),
    )


@pytest.mark.parametrize("with_runs", [True, False])
def test_empty_columns_keep_their_types(tmp_path: Path, with_runs: bool) -> None:
    target = tmp_path / "runs.parquet"
    write_run_table(request("parquet", target, with_runs=with_runs), silent)
    schema = pq.read_table(target).schema
    assert schema.field("seed").type == pa.int64()
    assert schema.field("collision_obstacle_id").type == pa.int64()
    assert schema.field("metrics_minimum_distance_m").type == pa.float64()
    assert schema.field("weight_prediction").type == pa.float64()
    assert schema.field("reason").type == pa.string()
    assert schema.field("setting_vehicle").type == pa.int64()
    assert schema.field("setting_length_m").type == pa.float64()


def test_runs_collisions_and_lost_cells_are_rows(tmp_path: Path) -> None:
    target = tmp_path / "runs.csv"
    write_run_table(request("csv", target), silent)
    with target.open(newline="") as stream:
        reached, hit, lost = csv.DictReader(stream)
    assert (reached["outcome"], reached["collision_obstacle_id"], reached["metrics_duration_s"]) == (
        "goal_reached",
        "",
        "5.0",
    )
    assert (hit["collision_obstacle_id"], hit["rejected_candidates"]) == ("7", '{"yaw_rate": 3}')
    assert (lost["run_id"], lost["outcome"], lost["reason"]) == ("", "lost", "[worker_failure] died")
    assert float(lost["weight_prediction"]) == CONFIG.weights["prediction"]


def test_measures_of_runs_with_steps_are_columns(tmp_path: Path) -> None:
    run = record().model_copy(update={"config_id": CONFIG.config_id})
    leader = driven(70.0, 0.0, 8.0)
    steps_path = source(run, tmp_path, others=(leader,)).steps_path
    target = tmp_path / "runs.csv"
    asked = request("csv", target, with_runs=False)
    write_run_table(asked.model_copy(update={"records": (run,), "steps_paths": {run.run_id: str(steps_path)}}), silent)
    with target.open(newline="") as stream:
        told, lost = csv.DictReader(stream)
    gap = 30.0 - (4.5 + run.ego_length_m) / 2 - 2.0 * 4.0
    assert float(told["measure_leader_time_to_collision_s"]) == pytest.approx(gap / 2.0)
    assert told["measure_post_encroachment_time_s"] == ""
    assert lost["measure_time_to_brake_s"] == ""
    assert "measure_minimum_distance_m" not in told  # stored: a column of the metrics


def step_table(folder: Path, form: Literal["csv", "parquet"], series: RunSeries | None) -> Path:
    run = source(record(), folder, jerk=0.5)
    assert run.steps_path is not None
    if series is not None:
        Path(run.steps_path).with_name("series.json").write_text(series.model_dump_json(), encoding="utf-8")
    target = folder / f"steps.{form}"
    wanted = StepTableRequest(record=run.record, steps_path=run.steps_path, form=form, target_path=str(target))
    write_step_table(wanted, silent)
    return target


PLANNED = len(range(0, 41, 3))
SERIES = RunSeries(
    lateral_offset_m=(0.25,) * 41,
    desired_speed_mps=(9.0,) * PLANNED,
    desired_speed_reasons=("the goal",) * PLANNED,
    numbers={"gap_m": (None, *(5.0,) * (PLANNED - 1))},
    texts={"why": ("free",) * PLANNED},
)


def test_steps_of_a_run_come_with_series_and_debug_values(tmp_path: Path) -> None:
    with step_table(tmp_path, "csv", SERIES).open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 41
    assert (rows[4]["step"], rows[4]["time_s"], rows[4]["x_m"], rows[4]["lateral_offset_m"]) == (
        "4",
        "0.4",
        "44.0",
        "0.25",
    )
    planned, between, first = rows[3], rows[4], rows[0]
    named = ("desired_speed_mps", "desired_speed_reason", "cost jerk", "debug gap_m", "debug text why")
    assert [planned[name] for name in named] == ["9.0", "the goal", "0.5", "5.0", "free"]
    assert [between[name] for name in named] == [""] * 5
    assert first["debug gap_m"] == ""


def test_parquet_of_the_steps_has_numbers_and_texts(tmp_path: Path) -> None:
    table = pq.read_table(step_table(tmp_path, "parquet", SERIES))
    assert table.schema.field("debug gap_m").type == pa.float64()
    assert table.schema.field("debug text why").type == pa.string()
    assert table.schema.field("step").type == pa.int64()
    assert table.column("debug gap_m").to_pylist()[:7] == [None, None, None, 5.0, None, None, 5.0]


def test_steps_of_a_run_that_was_stored_without_series_have_empty_columns(tmp_path: Path) -> None:
    table = pq.read_table(step_table(tmp_path, "parquet", None))
    assert set(table.column("lateral_offset_m").to_pylist()) == {None}
    assert table.column("speed_mps").to_pylist() == [10.0] * 41
