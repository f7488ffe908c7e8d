"""A leaderboard of planners: the request, a line for each planner, boundary and world, and the standing."""

import hashlib
from collections.abc import Mapping
from typing import Final

from pydantic import Field

from .base import Model
from .boundaries import BoundaryMap
from .text import counted
from .worlds import PERFECT_NAME

BOARD_POINTS: Final = 60
"""The usual number of points of a map on a leaderboard (chosen)."""


class LeaderboardRequest(Model):
    """The planners, logical scenarios and worlds that a leaderboard compares; empty means all built-in ones."""

    planners: tuple[str, ...] = ()
    scenarios: tuple[str, ...] = ()
    worlds: tuple[str, ...] = (PERFECT_NAME,)
    points: int = Field(BOARD_POINTS, ge=30, le=1000)
    seed: int = 0


class LeaderboardLine(Model):
    """How a planner fares over one boundary in one world: shares of the mapped range with their bounds.

    ``content``: the SHA-256 of the map with all its points, which is the same in every repetition.
    """

    planner: str
    config_id: str
    scenario: str
    world: str
    points: int
    avoidable: float
    avoidable_low: float
    avoidable_high: float
    unavoidable: float
    boundary_id: str
    content: str

    @classmethod
    def of(cls, found: BoundaryMap, boundary_id: str, scenario: str, world: str) -> "LeaderboardLine":
        """Return the line of a map."""
        avoidable, unavoidable = found.area("failed_avoidably"), found.area("failed_unavoidably")
        return cls(
            planner=found.config_name,
            config_id=found.config_id,
            scenario=scenario,
            world=world,
            points=len(found.points),
            avoidable=avoidable.share if avoidable else 0.0,
            avoidable_low=avoidable.low if avoidable else 0.0,
            avoidable_high=avoidable.high if avoidable else 0.0,
            unavoidable=unavoidable.share if unavoidable else 0.0,
            boundary_id=boundary_id,
            content=digest_of(found),
        )

    def in_words(self) -> str:
        """Return the share of avoidable failures with its bounds."""
        return f"{self.avoidable:.1%} ({self.avoidable_low:.1%} to {self.avoidable_high:.1%})"


class Standing(Model):
    """A planner's place: the mean share of avoidable failures over all boundaries and worlds, smaller is better."""

    planner: str
    config_id: str
    avoidable: float
    low: float
    high: float

    def in_words(self) -> str:
        """Return the planner with its mean share and bounds."""
        return f"{self.planner}: {self.avoidable:.1%} ({self.low:.1%} to {self.high:.1%}) fails avoidably"


class Leaderboard(Model):
    """A leaderboard: the standing, its lines, what could not be run, and the versions and bases that it depends on."""

    request: LeaderboardRequest
    standing: tuple[Standing, ...]
    lines: tuple[LeaderboardLine, ...]
    left_out: tuple[str, ...] = ()
    versions: Mapping[str, str]
    bases: Mapping[str, str]
    digest: str = ""

    def sealed(self) -> "Leaderboard":
        """Return the leaderboard with the SHA-256 of everything else."""
        return self.model_copy(update={"digest": digest_of(self.model_copy(update={"digest": ""}))})

    def in_words(self) -> str:
        """Return what was compared, and the digest."""
        scenarios, worlds = ({getattr(line, name) for line in self.lines} for name in ("scenario", "world"))
        return (
            f"{counted(len(self.standing), 'planner')} over {counted(len(scenarios), 'boundary')} in "
            f"{counted(len(worlds), 'world')}; digest {self.digest}"
        )


def digest_of(model: Model) -> str:
    """Return the SHA-256 of a model's content."""
    return hashlib.sha256(model.model_dump_json().encode()).hexdigest()


def standing_of(lines: tuple[LeaderboardLine, ...]) -> tuple[Standing, ...]:
    """Return the planners, the best first, by their mean over the boundaries and worlds that they share."""
    by_planner: dict[tuple[str, str], dict[tuple[str, str], LeaderboardLine]] = {}
    for line in lines:
        by_planner.setdefault((line.planner, line.config_id), {})[line.scenario, line.world] = line
    shared = set.intersection(*(set(found) for found in by_planner.values())) if by_planner else set()
    if not shared:
        return ()
    standing = [
        Standing(
            planner=planner,
            config_id=config_id,
            avoidable=sum(found[key].avoidable for key in sorted(shared)) / len(shared),
            low=sum(found[key].avoidable_low for key in sorted(shared)) / len(shared),
            high=sum(found[key].avoidable_high for key in sorted(shared)) / len(shared),
        )
        for (planner, config_id), found in by_planner.items()
    ]
    return tuple(sorted(standing, key=lambda one: (one.avoidable, one.high, one.planner)))
