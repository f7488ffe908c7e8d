"""Planner packages of other authors, written into a folder as an installation leaves them."""

from pathlib import Path

STRAIGHT = """
import numpy as np
from plannerforge.engine.planners import OwnPlanner, Plan, PlannedTrajectory
from plannerforge.schemas.planning import DeclaredPreset, DeclaredWeight, PlannerDeclaration


class Straight:
    def reset(self, task):
        self.task = task

    def plan(self, observation):
        ego, slower = observation.ego, self.task.configuration.weights["slower_mps2"]
        times = self.task.step_s * np.arange(21)
        speeds = np.maximum(ego.speed_mps - slower * times, 0.0)
        gone = np.concatenate([[0.0], np.cumsum((speeds[1:] + speeds[:-1]) / 2 * self.task.step_s)])
        ahead = np.array([np.cos(ego.heading_rad), np.sin(ego.heading_rad)])
        headings = np.full(21, ego.heading_rad)
        trajectory = PlannedTrajectory(ego.position + gone[:, None] * ahead, headings, speeds, np.full(21, -slower))
        return Plan(trajectory, {"slower": slower}, candidates=1)


PLANNER = OwnPlanner(
    Straight,
    PlannerDeclaration(
        summary="drives straight on",
        weights={"slower_mps2": DeclaredWeight(meaning="how much slower it gets", default=0.0, highest=4.0)},
        presets={"Lazy": DeclaredPreset(intent="gets slower", weights={"slower_mps2": 1.0})},
    ),
)
"""
"""A whole planner; other behaviours replace a part of its text."""


def install(folder: Path, name: str, source: str = STRAIGHT, *, package: str = "") -> Path:
    """Write a package with a planner of this name and its metadata, and return the module's path."""
    module = package or f"own_{name}"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{module}.py").write_text(source, encoding="utf-8")
    metadata = folder / f"{module}-1.0.dist-info"
    metadata.mkdir(exist_ok=True)
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.0\n", encoding="utf-8")
    (metadata / "entry_points.txt").write_text(
        f"[plannerforge.planners]\n{name} = {module}:PLANNER\n", encoding="utf-8"
    )
    return folder / f"{module}.py"
