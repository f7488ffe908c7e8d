"""What run_planner answers about the runs that are finished."""

from collections import Counter
from collections.abc import Sequence

from plannerforge.schemas.planning import LISTED_RUNS, ConfigurationSummary, RunLine, RunPlannerResult
from plannerforge.schemas.runs import RunRecord
from plannerforge.tools.run_grid import Cell, CellResult


def answer(
    cells: Sequence[Cell],
    results: Sequence[CellResult],
    *,
    batch_id: str | None = None,
    job_id: str | None = None,
    state: str = "done",
    notes: Sequence[str] = (),
) -> RunPlannerResult:
    """The answer for a grid of which ``results`` are finished."""
    records = [result.record for result in results if result.record is not None]
    lost = [result.lost for result in results if result.lost is not None]
    return RunPlannerResult.model_validate(
        {
            "state": state,
            "total": len(cells),
            "finished": len(records),
            "reused": sum(result.reused for result in results),
            "prediction": cells[0].prediction,
            "traffic": cells[0].traffic,
            "batch_id": batch_id,
            "job_id": job_id,
            "summary": _summary(records),
            "runs": tuple(_line(record) for record in records[:LISTED_RUNS]),
            "lost": tuple(lost[:10]),
            "notes": (*notes, *_prediction_notes(records), *_traffic_notes(records), *_path_notes(records)),
            "next_step": _next_step(records, batch_id, job_id, state),
        }
    )


def _prediction_notes(records: Sequence[RunRecord]) -> list[str]:
    """What the prediction could not do as asked."""
    counts = [len(record.off_the_lanes) for record in records if record.off_the_lanes]
    if not counts:
        return []
    return [
        f"lane prediction: {sum(counts)} obstacles in {len(counts)} runs were off the lanes: constant velocity there"
    ]


def _traffic_notes(records: Sequence[RunRecord]) -> list[str]:
    """Who did not react although the traffic is reactive."""
    counts = [len(record.on_recording) for record in records if record.on_recording]
    if not counts:
        return []
    told = f"{sum(counts)} (in {len(counts)} of {len(records)} runs)"
    return [f"reactive traffic: moving obstacles that followed their recording all the same: {told}"]


def _path_notes(records: Sequence[RunRecord]) -> list[str]:
    """Whose start is too askew or too fast for the lane's centre line."""
    lengths_m = sorted(record.eased_over_m for record in records if record.eased_over_m is not None)
    if not lengths_m:
        return []
    told = f"{lengths_m[0]:g} m" if lengths_m[0] == lengths_m[-1] else f"{lengths_m[0]:g} to {lengths_m[-1]:g} m"
    return [f"the ego's start allows no way along the lane's centre in {len(lengths_m)} runs: joined within {told}"]


def _summary(records: Sequence[RunRecord]) -> tuple[ConfigurationSummary, ...]:
    names = {record.config_id: record.config_name for record in records}
    counts = {key: Counter(record.outcome for record in records if record.config_id == key) for key in names}
    return tuple(
        ConfigurationSummary(config_id=key, config_name=name, outcomes=dict(counts[key].most_common()))
        for key, name in names.items()
    )


def _line(record: RunRecord) -> RunLine:
    return RunLine(
        run_id=record.run_id,
        scenario_id=record.scenario_id,
        problem_id=record.problem_id,
        config_id=record.config_id,
        outcome=record.outcome,
        reason=record.reason,
        duration_s=None if record.metrics is None else record.metrics.duration_s,
        minimum_distance_m=None if record.metrics is None else record.metrics.minimum_distance_m,
    )


def _next_step(records: Sequence[RunRecord], batch_id: str | None, job_id: str | None, state: str) -> str:
    if state == "running":
        return f"get_job with job_id '{job_id}'"
    if state != "done":
        return "call run_planner again: finished runs are reused"
    if batch_id:
        return f"analyze_results or compare_results with results ['{batch_id}']"
    return f"analyze_results with results ['{records[0].run_id}'], or render it" if records else "see what was lost"
