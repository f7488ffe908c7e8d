"""The path of a driver, and how the driver perceives recorded road users along it.

Stations are arc lengths in m along the path. Other road users are projected with continuity, so that a road user next
to a curve, or a path that crosses itself, causes no jump. The extent of a road user's body along and across the path is
that of its rectangle, turned relative to the path.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...commonroad import MadeOnce, Track
from ...geometry import (
    PathFollower,
    Points,
    Values,
    arc_length,
    interpolate,
    project_along,
    without_repeats,
    wrap_angles,
)
from .models import Seen

AHEAD_M = 200.0
"""Length of a path's straight extension after its end, more than a car on a motorway needs to stop."""
_MOST_KEPT = 256
"""Values that a path keeps (chosen): two for each road user, some kB each."""
_NARROW = ("pedestrian", "bicycle", "motorcycle")
"""Types that hide no other road user; all other types are as broad as a car."""


@dataclass(frozen=True)
class DriverPath:
    """A line of points (n, 2) with the driver's headings (n,) at these points; it continues straight after its end."""

    points: Points
    headings_rad: Values

    @cached_property
    def kept(self) -> MadeOnce:
        """Road users on the path, for several drives along it."""
        return MadeOnce(_MOST_KEPT)

    @classmethod
    def driven(cls, track: Track) -> "DriverPath":
        """Return the path that a track drove, with the track's headings."""
        return cls(track.positions, np.unwrap(track.headings_rad))

    @classmethod
    def along(cls, line: Points) -> "DriverPath":
        """Return the path along a line, with the line's headings."""
        step = np.gradient(line, axis=0)
        return cls(line, np.unwrap(np.arctan2(step[:, 1], step[:, 0])))

    @cached_property
    def stations_m(self) -> Values:
        """The arc length at each point, shape (n,)."""
        return arc_length(self.points)

    @property
    def length_m(self) -> float:
        """The length of the line without its extension."""
        return float(self.stations_m[-1])

    def poses(self, stations_m: Values) -> tuple[Points, Values]:
        """Return the points (m, 2) and headings (m,) at stations."""
        beyond = np.maximum(stations_m - self.length_m, 0.0)
        headings = np.interp(stations_m, self.stations_m, self.headings_rad)
        end = float(self.headings_rad[-1])
        ahead = np.array([math.cos(end), math.sin(end)])
        return interpolate(self.points, self.stations_m, stations_m) + beyond[:, None] * ahead, headings

    @cached_property
    def _line(self) -> Points:
        """The line for projections: without repeated points, and with the extension beyond its end."""
        end = float(self.headings_rad[-1])
        after = self.points[-1] + AHEAD_M * np.array([math.cos(end), math.sin(end)])
        return np.vstack([without_repeats(self.points), after])

    @cached_property
    def _projected(self) -> tuple[PathFollower, Values, Points]:
        """The line for projections, prepared: a follower, the station of each point, and the step to the next one."""
        return PathFollower(self._line), arc_length(self._line), np.diff(self._line, axis=0)

    def follow(self, positions: Points, near_m: float | None = None) -> tuple[Values, Values, Values]:
        """Return stations (m,), offsets (m,) left positive and the path's headings (m,) for a track of points (m, 2).

        ``near_m``: a station near which the track starts, for paths that return to themselves.
        """
        line, begins, steps = self._projected
        stations, offsets = project_along(line, positions, near_m)
        segments = np.clip(np.searchsorted(begins, stations, side="right") - 1, 0, len(begins) - 2)
        step = steps[segments]
        return stations, offsets, np.arctan2(step[:, 1], step[:, 0])


@dataclass(frozen=True)
class OnPath:
    """A road user along a path, one entry per step from ``first_step``.

    ``middle_m``: stations; ``offset_m``: offset of its centre, left positive; ``half_along_m``, ``half_across_m``:
    extents of its body; ``along_mps``: its speed along the path; ``slowing_mps2``: its deceleration.
    """

    key: int
    hides: bool
    first_step: int
    middle_m: Values
    offset_m: Values
    half_along_m: Values
    half_across_m: Values
    along_mps: Values
    slowing_mps2: Values

    @classmethod
    def of(cls, path: DriverPath, track: Track, step_s: float, near_m: float | None = None) -> "OnPath":
        """Return a track along a path; ``near_m``: the driver's station when the track starts."""
        middle, offset, bearings = path.follow(track.positions, near_m)
        turned = wrap_angles(track.headings_rad - bearings)
        cosine, sine = np.cos(turned), np.sin(turned)
        length, width = track.size_m
        slower = -np.diff(track.speeds_mps, prepend=track.speeds_mps[:1]) / step_s
        return cls(
            key=track.obstacle_id,
            hides=track.kind not in _NARROW,
            first_step=track.first_step,
            middle_m=middle,
            offset_m=offset,
            half_along_m=(length * np.abs(cosine) + width * np.abs(sine)) / 2,
            half_across_m=(length * np.abs(sine) + width * np.abs(cosine)) / 2,
            along_mps=track.speeds_mps * cosine,
            slowing_mps2=slower,
        )

    @cached_property
    def aside_m(self) -> Values:
        """The gap between its body and the line of the path, shape (n,)."""
        gaps: Values = np.abs(self.offset_m) - self.half_across_m
        return gaps

    def seen(self, step: int, station_m: float, body: tuple[float, float], step_s: float) -> Seen | None:
        """Return the road user as a driver with its centre at a station perceives it; None if it is absent at the step.

        ``body``: length and width of the driver's vehicle.
        """
        at = step - self.first_step
        if not 0 <= at < len(self._rows):
            return None
        middle, reach, aside, along, slowing = self._rows[at]
        ahead, reach = middle - station_m, reach + body[0] / 2
        return Seen(
            key=self.key,
            gap_m=ahead - reach,
            past_m=ahead + reach,
            aside_m=aside - body[1] / 2,
            nearing_mps=0.0 if at == 0 else (self._rows[at - 1][2] - aside) / step_s,
            along_mps=along,
            slowing_mps2=slowing,
        )

    def offset_at(self, step: int) -> float:
        """Return the offset of its centre from the path at a step at which it is present."""
        return float(self.offset_m[step - self.first_step])

    @cached_property
    def _rows(self) -> list[tuple[float, float, float, float, float]]:
        """For each state: station, extent along the path, gap to its line, speed along it, and deceleration."""
        columns = self.middle_m, self.half_along_m, self.aside_m, self.along_mps, self.slowing_mps2
        return list(zip(*(column.tolist() for column in columns), strict=True))


def with_hidden(seen: Sequence[tuple[Seen, float, bool]], wandering_m: float) -> tuple[Seen, ...]:
    """Return the road users ahead of a driver, with the hidden ones marked (UN R157, Annex 4, Appendix 3, 3.4.2).

    Each entry has the offset of its centre from the path, and whether it hides others. A road user that is ahead in the
    path hides everything beyond it in the path, until its centre is farther from the path than the wandering distance.
    """
    hiding = [one.gap_m for one, offset, hides in seen if hides and one.is_in_way and abs(offset) <= wandering_m]
    nearest = min((gap for gap in hiding if gap >= 0), default=math.inf)
    return tuple(
        replace(one, hider_gap_m=nearest) if one.is_in_way and one.gap_m > nearest else one for one, _, _ in seen
    )


def rectangles(centers: Points, headings_rad: Values, body: tuple[float, float]) -> NDArray[Any]:
    """Return the polygons (n,) of a body of a length and width at centres (n, 2) with headings (n,)."""
    import shapely

    cosine, sine = np.cos(headings_rad), np.sin(headings_rad)
    ahead = np.column_stack([cosine, sine]) * (body[0] / 2)
    left = np.column_stack([-sine, cosine]) * (body[1] / 2)
    corners = np.stack([centers + ahead + left, centers - ahead + left, centers - ahead - left, centers + ahead - left])
    polygons: NDArray[Any] = shapely.polygons(np.moveaxis(corners, 0, 1))
    return polygons
