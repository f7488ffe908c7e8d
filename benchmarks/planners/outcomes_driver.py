"""Runs planners over scenario files with the checkout in ``PYTHONPATH``, and prints one JSON row per run.

``outcomes.py`` starts this file as a separate program, so that it can measure an older checkout. It therefore imports
the package by its name and uses only what every version has: ``run_planner`` and its request. Each line of standard
input gives a cell (``file``, ``configuration``, ``prediction``, ``traffic``), and each output line is its row.
"""

import json
import sys
from pathlib import Path
from typing import Any

from plannerforge.engine.execution import silent
from plannerforge.engine.planners import run_planner
from plannerforge.engine.tuning import named_configuration
from plannerforge.schemas.planning import RunRequest


def _row(cell: dict[str, Any]) -> dict[str, Any]:
    """Run one cell; if the run fails, the row has the error instead of an outcome."""
    path = Path(cell["file"])
    key = {"scenario": path.stem, **{name: cell[name] for name in ("configuration", "prediction", "traffic")}}
    request = RunRequest(
        run_id="run_000000000000",
        scenario_path=str(path),
        scenario_id=path.stem,
        configuration=named_configuration(cell["configuration"]),
        prediction=cell["prediction"],
        traffic=cell["traffic"],
    )
    try:
        answer = run_planner(request, silent)
    except Exception as error:  # noqa: BLE001 - the row says what was raised, and the others are still measured
        return {**key, "outcome": None, "error": f"{type(error).__name__}: {error}"}
    record = answer.record
    return {
        **key,
        "outcome": record.outcome,
        "reason": record.reason,
        "invalid_reason": record.invalid_reason,
        "duration_s": record.metrics.duration_s if record.metrics else 0.0,
        "distance_m": record.metrics.distance_m if record.metrics else 0.0,
        "beyond_vehicle": sorted({excess.name for excess in record.beyond_vehicle or ()}),
        "on_recording": list(record.on_recording),
        "wall_s": round(answer.timing.wall_s, 3),
    }


def _main() -> None:
    output = sys.stdout
    sys.stdout = sys.stderr  # whatever a library prints is no row
    for line in sys.stdin:
        output.write(json.dumps(_row(json.loads(line))) + "\n")
        output.flush()


if __name__ == "__main__":
    _main()
