"""Runs Scenario Factory 2.0 in its own environment: ``python -P factory_driver.py``, started only by ``factory.py``.

Each input line is a JSON object with a map, and each output line holds the result (``factory.py`` defines the fields).
Output of its libraries goes to standard error, which is kept as the log. This file imports nothing of the project.

The pipeline is the one in its documentation, starting from the map file instead of a download. Everything happens in
this process. The times exclude start-up, its table of places and the pauses of its executor.
"""

import json
import os
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any


def _work(asked: dict[str, Any]) -> dict[str, Any]:
    """Carry a map through the whole pipeline."""
    from scenario_factory.pipeline import Pipeline, PipelineContext
    from scenario_factory.pipeline_steps import (
        pipeline_add_metadata_to_scenario,
        pipeline_assign_tags_to_scenario,
        pipeline_convert_osm_map_to_commonroad_scenario,
        pipeline_extract_intersections,
        pipeline_simulate_scenario_with_sumo,
        pipeline_verify_and_repair_commonroad_scenario,
        pipeline_write_scenario_to_file,
    )
    from scenario_factory.pipelines import create_scenario_generation_pipeline
    from scenario_factory.scenario_config import ScenarioFactoryConfig
    from scenario_factory.simulation import SimulationConfig, SimulationMode

    config = ScenarioFactoryConfig(seed=asked["seed"], cr_scenario_time_steps=asked["steps"])
    traffic = SimulationConfig(
        mode=SimulationMode.RANDOM_TRAFFIC_GENERATION, simulation_steps=asked["simulated_steps"], seed=asked["seed"]
    )
    simulate = pipeline_simulate_scenario_with_sumo(traffic)
    sites = (
        Pipeline()
        .map(pipeline_convert_osm_map_to_commonroad_scenario)
        .map(pipeline_verify_and_repair_commonroad_scenario)
        .map(pipeline_extract_intersections)
        .map(pipeline_add_metadata_to_scenario)
        .map(simulate)
    )
    pipeline = (
        sites.chain(create_scenario_generation_pipeline(config.criterions, config.filters))
        .map(pipeline_assign_tags_to_scenario)
        .map(pipeline_write_scenario_to_file(Path(asked["folder"])))
    )
    spent, began = _processor_s(), time.perf_counter()
    with tempfile.TemporaryDirectory() as scratch:
        context = PipelineContext(Path(scratch), config)
        done = pipeline.execute([Path(asked["map"])], context, num_threads=None, num_processes=None)
    on_clock_s, spent = time.perf_counter() - began, _processor_s() - spent
    steps_s: Counter[str] = Counter()
    for result in done.results:
        steps_s[result.step.name] += result.exec_time / 1e9
    return {
        "processor_s": spent,
        "wall_s": sum(steps_s.values()),
        "with_pauses_s": on_clock_s,
        "steps_s": steps_s,
        "sites": sum(result.step.name == simulate.name for result in done.results),
        "faults": Counter(f"{result.step.name}: {_reason(result.error)}" for result in done.errors),
    }


def _processor_s() -> float:
    """Return the processor time of this process and the programs that it ran."""
    spent = os.times()
    return spent.user + spent.system + spent.children_user + spent.children_system


def _reason(trace: str) -> str:
    """Return the last line of a traceback, and its function."""
    lines = trace.strip().splitlines()
    where = next((line.rpartition(" in ")[2] for line in reversed(lines) if line.startswith("  File ")), "")
    return f"{lines[-1][:160]} (in {where})"


def _main() -> None:
    """Answer line by line."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # native libraries print past sys.stdout
    sys.stdout = sys.stderr
    from scenario_factory.globetrotter import Coordinates, RegionMetadata

    RegionMetadata.from_coordinates(Coordinates(0.0, 0.0))  # loads its table of places
    for line in sys.stdin:
        answers.write(json.dumps(_work(json.loads(line))) + "\n")
        answers.flush()


if __name__ == "__main__":
    _main()
