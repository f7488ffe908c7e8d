"""What tests compute in this process and in one with another hash seed; the other imports these functions."""

import hashlib
from pathlib import Path

from plannerforge.engine.commonroad import read_scenario
from plannerforge.engine.execution import silent
from plannerforge.engine.generation.generator import generate_scenario
from plannerforge.engine.network import NetLayout, straight_speeds, sumo_net
from plannerforge.engine.planners import run_planner
from plannerforge.schemas.generation import GenerationRequest
from plannerforge.schemas.planning import RunRequest


def digest_of_run(request: RunRequest) -> str:
    """Run a planner and return the digest of record and steps."""
    response = run_planner(request, silent)
    content = response.record.model_dump_json() + response.steps.model_dump_json()
    return hashlib.sha256(content.encode()).hexdigest()


def net_of(path: Path) -> str:
    """Return the SUMO network of a scenario."""
    layout = NetLayout.of(read_scenario(path).scenario.lanelet_network)
    return sumo_net(layout, straight_speeds(layout, {}))


def generated(request: GenerationRequest, folder: Path) -> bytes:
    """Generate a scenario and return its files."""
    generate_scenario(request, silent)
    return (folder / "scenario.xml").read_bytes() + (folder / "scenario.net.xml").read_bytes()
