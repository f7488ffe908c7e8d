"""Search spaces of a scenario: the road users that can come near the ego, and what they could plausibly do.

Each stratum is a logical scenario with one counterpart and one manoeuvre. A recorded road user brakes, changes its
speed, arrives earlier or later, changes into the ego's lane, swerves or drifts into the oncoming lane. An added road
user is a pedestrian or cyclist who crosses, a cyclist or standing car ahead, a car ahead that brakes, or a car that
cuts in, drifts into the ego's lane, crosses or merges. Its motion is timed by the planner's own drive through the
unchanged base (the nominal motion), because an actor timed by the ego's initial speed misses an ego that slows down.
Ranges are limited to what road users do (constants below). An added road user is present when the ego starts, at least
``LEAST_TTC_S`` before a contact. A stratum is kept if at least one of a few sampled points can be applied to the base.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ...schemas.errors import InvalidRequest
from ...schemas.exploration import Curve, LogicalScenario, Parameter
from ..commonroad import Track
from ..edits import road_across
from ..geometry import Points, Values, arc_length, interpolate, length_m, point_at, project, wrap_angle
from ..scene import Scene, lanelets_of_pose
from .concrete import concrete_edits
from .evaluation import Evaluator

LEAST_TTC_S = 2.0
"""Nothing added begins nearer to a contact with the ego: the time to collision at which UN R157's driver sees danger in
a cut-in."""
_HARDEST_MPS2, _GENTLEST_MPS2 = 8.0, 2.0
"""Braking of other road users: emergency braking on a dry road, and a usual stop (ISO 15622 allows an ACC 3.5)."""
_SPEEDING_UP_MPS2 = 2.0
"""Acceleration of other road users: comfortable (the vehicle parameters' comfortable_mps2)."""
_WALKS_MPS = (0.8, 2.5)
"""Speeds of crossing pedestrians: slow walkers to runners (5th and 95th percentiles at crossings are 0.9 and 2.1)."""
_CYCLES_MPS = (2.0, 5.5)
"""Speeds of cyclists, up to the largest of SUMO's bicycle, 5.6 m/s."""
_LATERAL_S = (1.5, 4.0)
"""Durations of a lane change of others: UN R157's tests of cut-ins go down to 3.5 m at 3 m/s, drivers take 3 to 5 s."""
_COMES_WITHIN_M = 40.0
"""A recorded road user counts if it comes as near as this to the nominal motion (chosen)."""
_MOST_RECORDED = 5
"""Recorded road users that get strata, those that come nearest (chosen)."""
_MOST_CONFLICTS = 2
"""Lanes that cross or merge into the ego's way and get strata, the first ones on its way (chosen)."""
_MOVING_MPS = 1.0
"""A road user that is never faster stands (chosen)."""
_SAME_LANE_M, _NEXT_LANE_M = 1.8, 6.0
"""Lateral distances from the ego's way: in its lane, and in the next one (half and one and a half wide lanes)."""
_ALONG_RAD, _AGAINST_RAD = math.radians(45.0), math.radians(135.0)
_CROSSING_RAD = math.radians(30.0)
"""A lane crosses the ego's way at a larger angle (chosen)."""
_SPACING_M = 2.0
"""Distance of the places along the ego's way that are looked at."""
_BEYOND_M = 5.0
"""How far the way goes on, straight, beyond the nominal motion: more than the ego's front and a spacing."""
_EGO_HALF_M, _EGO_FRONT_M = 0.9, 2.3
"""Half of the ego's width and length, rounded up."""
_CAR_M = 4.6
"""The length of an added car plus the front and rear overhangs that offsets between centres need: two half cars."""
_TRIES = ((0.5, 0.5), (0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75), (0.1, 0.5), (0.9, 0.5))
"""Points of a stratum that are tried for feasibility: shares of the first parameter and of all others."""
_CYCLIST_MPS2 = 1.0
"""The acceleration with which an added cyclist sets off (``engine/edits/population.py``)."""
_SAMPLED_S = 0.2
_KERB_S = 0.3
"""One who crosses stands at the kerb for at least this long, and meets the ego this long before the horizon."""
_REACH = "time to reach it at the start"


@dataclass(frozen=True)
class NominalMotion:
    """The planner's drive through the unchanged base: positions (n, 2) and headings (n,) at every step, speeds (n,).

    ``first_step``: the step of the first state.
    """

    positions: Points
    headings_rad: Values
    speeds_mps: Values
    first_step: int
    step_s: float

    def until(self, horizon_s: float, onward: Points | None) -> "NominalMotion":
        """Return the motion up to a time, continued at its last speed along its lane if it ended earlier."""
        count = round(horizon_s / self.step_s) + 1
        if count <= len(self.positions):
            part = slice(0, count)
            return NominalMotion(
                self.positions[part], self.headings_rad[part], self.speeds_mps[part], self.first_step, self.step_s
            )
        line = _onward(self.positions[-1], float(self.headings_rad[-1]), onward)
        speed = float(self.speeds_mps[-1])
        stations = np.arange(1, count - len(self.positions) + 1) * self.step_s * speed
        poses = [point_at(line, float(station)) for station in stations]
        return NominalMotion(
            np.concatenate([self.positions, np.array([point for point, _ in poses])]),
            np.concatenate([self.headings_rad, np.array([heading for _, heading in poses])]),
            np.concatenate([self.speeds_mps, np.full(len(poses), speed)]),
            self.first_step,
            self.step_s,
        )


def _onward(position: Points, heading_rad: float, lane: Points | None) -> Points:
    """Return the line from a position along a lane, or straight ahead without a lane."""
    straight = np.array([position, position + 200.0 * np.array([math.cos(heading_rad), math.sin(heading_rad)])])
    if lane is None:
        return straight
    here, aside = project(lane, position)
    rest = interpolate(lane, arc_length(lane), np.arange(here + 1.0, length_m(lane), 1.0))
    return np.concatenate([position[None], rest]) if len(rest) and abs(aside) < _NEXT_LANE_M else straight


@dataclass(frozen=True)
class _Way:
    """Positions along the nominal motion: distances since the start, lanelets, and stations on these lanelets."""

    along: Values
    points: Points
    headings_rad: Values
    lanelets: tuple[int, ...]
    stations: Values

    @classmethod
    def of(cls, scene: Scene, nominal: NominalMotion) -> "_Way":
        line = nominal.positions
        apart = np.concatenate([[True], np.linalg.norm(np.diff(line, axis=0), axis=1) > 0.02])
        line = line[apart]
        if len(line) < 2:
            heading = float(nominal.headings_rad[0])
            line = np.array([line[0], line[0] + np.array([math.cos(heading), math.sin(heading)])])
        # The ego's front is ahead of its centre, and so is one who meets it at the end of the way.
        ending = float(nominal.headings_rad[-1])
        line = np.concatenate([line, line[-1:] + _BEYOND_M * np.array([[math.cos(ending), math.sin(ending)]])])
        lanes = scene.layout.table.lanes
        found = []
        for station in np.arange(0.0, length_m(line), _SPACING_M):
            point, heading = point_at(line, float(station))
            key = next((one for one in lanelets_of_pose(scene.network, point, heading) if one in lanes), None)
            if key is not None:
                found.append((float(station), point, heading, key, project(lanes[key].center, point)[0]))
        return cls(
            np.array([one[0] for one in found]),
            np.array([one[1] for one in found]).reshape(-1, 2),
            np.array([one[2] for one in found]),
            tuple(one[3] for one in found),
            np.array([one[4] for one in found]),
        )

    def curves(self, of: str) -> dict[str, Curve]:
        """Return the lanelet at a distance ``of``, and the difference of its station from the distance."""
        starts = [0, *(i for i in range(1, len(self.lanelets)) if self.lanelets[i] != self.lanelets[i - 1])]
        # A lanelet begins where its station is 0, which is up to a spacing before the first place on it.
        into = np.clip(self.stations, 0.0, np.diff(self.along, prepend=self.along[:1]))
        at = tuple(round(float(self.along[index] - into[index]), 2) for index in starts)
        origins = tuple(round(float(self.stations[index] - self.along[index]), 2) for index in starts)
        return {
            "lanelet": Curve(of=of, at=at, values=tuple(str(self.lanelets[index]) for index in starts), steps=True),
            "origin_m": Curve(of=of, at=at, values=origins, steps=True),
        }


@dataclass(frozen=True)
class SpaceBuilder:
    """Builds the strata of a scenario: logical scenarios with one counterpart and one manoeuvre each.

    ``base``: the scenario's id; ``nominal``: the planner's motion up to the horizon.
    """

    scene: Scene
    nominal: NominalMotion
    base: str
    horizon_s: float

    def strata(self) -> tuple[LogicalScenario, ...]:
        """Return all strata, including those with no point that can be applied."""
        return (*self._recorded(), *self._added())

    @cached_property
    def _way(self) -> _Way:
        return _Way.of(self.scene, self.nominal)

    @cached_property
    def _begins_s(self) -> float:
        """The time of the ego's start, in the scenario's time."""
        return round(self.nominal.first_step * self.nominal.step_s, 6)

    @property
    def _speed_mps(self) -> float:
        return float(self.nominal.speeds_mps[0])

    @cached_property
    def _distances(self) -> Values:
        """The distance driven in the nominal motion, at every step."""
        steps = np.linalg.norm(np.diff(self.nominal.positions, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    def _driven(self, of: str) -> Curve:
        """Return the distance driven in the nominal motion, as a curve over the variable ``of``: the time since the
        start.
        """
        every = max(round(_SAMPLED_S / self.nominal.step_s), 1)
        times = np.arange(0, len(self._distances), every) * self.nominal.step_s
        values = self._distances[::every]
        return Curve(
            of=of, at=tuple(round(float(one), 3) for one in times), values=tuple(round(float(one), 3) for one in values)
        )

    def _made(
        self,
        name: str,
        summary: str,
        parameters: Sequence[Parameter],
        derived: dict[str, str | Curve],
        *edits: dict[str, Any],
    ) -> LogicalScenario:
        return LogicalScenario(
            name=name,
            summary=summary,
            base=self.base,
            parameters=tuple(parameters),
            derived=derived,
            edits=edits,
            horizon_s=self.horizon_s,
            source="derived from the scenario",
        )

    @property
    def _begin(self) -> Parameter:
        """The parameter for the start of a manoeuvre, early enough to matter before the horizon."""
        return _range("begin_s", 0.3, max(self.horizon_s - 2.5, 1.0), "s", summary="when it begins")

    @property
    def _time(self) -> dict[str, str | Curve]:
        return {"time_s": f"begin_s + {self._begins_s:g}"}

    def _recorded(self) -> Iterator[LogicalScenario]:
        """Yield the strata with a recorded road user that comes near."""
        first = self.nominal.first_step
        steps = np.arange(first, first + len(self.nominal.positions))
        near = []
        for track in self.scene.tracks.values():
            index = steps - track.first_step
            there = (index >= 0) & (index < len(track.positions))
            if not there.any() or track.obstacle_id not in self.scene.matches:
                continue
            away = np.linalg.norm(track.positions[index[there]] - self.nominal.positions[there], axis=1)
            if float(away.min()) <= _COMES_WITHIN_M and track.index_at(first) is not None:
                near.append((float(away.min()), track.obstacle_id, track))
        for _, _, track in sorted(near, key=lambda item: item[:2])[:_MOST_RECORDED]:
            yield from self._of_recorded(track)

    def _of_recorded(self, track: Track) -> Iterator[LogicalScenario]:
        key, kind = track.obstacle_id, track.kind
        who, vehicle = f"{kind} {key}", [str(key)]
        index = track.index_at(self.nominal.first_step) or 0
        moves = float(track.speeds_mps[index:].max()) > _MOVING_MPS
        if not moves:
            return
        ahead_m, aside_m, turned = self._seen_from_ego(track)
        brakes = self._made(
            f"{who} brakes",
            f"{who} brakes",
            [
                self._begin,
                _range("rate_mps2", _GENTLEST_MPS2, _HARDEST_MPS2, "m/s²", base=_GENTLEST_MPS2, summary="braking"),
                _range("percent", 0.0, 80.0, "%", base=80.0, summary="of its speed that is left"),
            ],
            self._time,
            {
                "op": "set_speed",
                "vehicles": vehicle,
                "speed": "${percent}%",
                "time_s": "$time_s",
                "rate_mps2": "$rate_mps2",
            },
        )
        if abs(turned) < _ALONG_RAD and abs(aside_m) < _SAME_LANE_M:
            if ahead_m > 0.0:
                yield brakes
            return
        if abs(turned) < _ALONG_RAD and abs(aside_m) < _NEXT_LANE_M:
            yield self._changes_lane(who, vehicle, "right" if aside_m > 0.0 else "left")
            yield self._swerves(who, vehicle, "right" if aside_m > 0.0 else "left")
            return
        if abs(turned) > _AGAINST_RAD:
            # An oncoming vehicle to the left of the ego moves to its own left to come near.
            yield self._swerves(who, vehicle, "left" if aside_m > 0.0 else "right")
        yield self._made(
            f"{who} changes its speed",
            f"{who} drives faster or more slowly",
            [
                _range("begin_s", 0.0, 2.0, "s", summary="when it begins"),
                _range("percent", 40.0, 160.0, "%", base=100.0, summary="of its speed"),
                _range("rate_mps2", 1.0, _SPEEDING_UP_MPS2, "m/s²", base=1.0),
            ],
            self._time,
            {
                "op": "set_speed",
                "vehicles": vehicle,
                "speed": "${percent}%",
                "time_s": "$time_s",
                "rate_mps2": "$rate_mps2",
            },
        )
        yield self._made(
            f"{who} comes at another time",
            f"{who} comes at another time",
            [_range("later_s", -2.0, 2.0, "s", base=0.0, summary="how much later it comes")],
            {},
            {"op": "shift_time", "vehicles": vehicle, "time_s": "$later_s"},
        )

    def _seen_from_ego(self, track: Track) -> tuple[float, float, float]:
        """Return where a road user starts: along and to the left of the ego's way, and its heading relative to it."""
        index = track.index_at(self.nominal.first_step) or 0
        line = self.nominal.positions
        if len(self._way.points) > 1:
            line = self._way.points
        station, aside = project(line, track.positions[index])
        heading = point_at(line, station)[1]
        ego, own = self.nominal.positions[0], float(self.nominal.headings_rad[0])
        away = track.positions[index] - ego
        ahead = float(away[0]) * math.cos(own) + float(away[1]) * math.sin(own)
        return ahead, aside, wrap_angle(float(track.headings_rad[index]) - heading)

    def _changes_lane(self, who: str, vehicle: list[str], lane: str) -> LogicalScenario:
        return self._made(
            f"{who} changes lane",
            f"{who} changes to the {lane} into the ego's lane",
            [
                self._begin,
                _range("lateral_s", *_LATERAL_S, "s", base=_LATERAL_S[1], summary="duration of the lane change"),
                _range("percent", 50.0, 120.0, "%", base=100.0, summary="of its speed"),
            ],
            self._time | {"change_s": "time_s + 0.5"},
            {"op": "set_speed", "vehicles": vehicle, "speed": "${percent}%", "time_s": "$time_s", "rate_mps2": 2.0},
            {"op": "change_lane", "vehicles": vehicle, "lane": lane, "time_s": "$change_s", "lateral_s": "$lateral_s"},
        )

    def _swerves(self, who: str, vehicle: list[str], side: str) -> LogicalScenario:
        return self._made(
            f"{who} swerves",
            f"{who} swerves to the {side}, towards the ego's lane",
            [
                self._begin,
                _range("aside_m", 0.5, 3.0, "m", base=0.5, summary="how far"),
                _range("lateral_s", 1.0, 3.0, "s", base=3.0, summary="duration of the move"),
            ],
            self._time,
            {
                "op": "swerve",
                "vehicles": vehicle,
                "side": side,
                "offset_m": "$aside_m",
                "lateral_s": "$lateral_s",
                "time_s": "$time_s",
            },
        )

    def _added(self) -> Iterator[LogicalScenario]:
        """Yield the strata with an added road user."""
        if not len(self._way.along):
            return
        for side in ("right", "left"):
            yield from self._crosses(side)
        yield from self._ahead()
        for side in ("left", "right"):
            yield self._cuts_in(side)
        yield self._comes_over()
        yield from self._conflicts()

    def _crosses(self, side: str) -> Iterator[LogicalScenario]:
        """Yield a pedestrian and a cyclist who cross from one side; they stand at the kerb from the ego's start on."""
        way = self._way
        rooms = []
        for point, heading, lanelet in zip(way.points, way.headings_rad, way.lanelets, strict=True):
            right, left = road_across(self.scene, lanelet, point, float(heading))
            rooms.append((-right if side == "right" else left) - _EGO_HALF_M)
        room_m = max(float(np.median(rooms)), 0.3)
        early = _range("early_s", -0.8, 2.0, "s", base=-0.8, summary="how much earlier it is in the ego's way")
        common: dict[str, str | Curve] = {"along_m": self._driven("meet_s"), "place_m": f"along_m + {_EGO_FRONT_M:g}"}
        common |= way.curves("place_m") | {"station_m": "place_m + origin_m"}
        edit = {
            "op": "add_vehicle",
            "at": "$lanelet",
            "position": "${station_m}m",
            "side": side,
            "speed": "${speed_mps}m/s",
            "duration_s": "$waits_s",
        }
        slowest_mps = max(_WALKS_MPS[0], room_m / (self.horizon_s - 2 * _KERB_S))
        if slowest_mps < _WALKS_MPS[1]:
            speed = _range(
                "speed_mps", slowest_mps, _WALKS_MPS[1], "m/s", base=max(slowest_mps, 1.4), summary="walking"
            )
            yield self._made(
                f"pedestrian crosses from the {side}",
                f"a pedestrian crosses from the {side}",
                [self._waits(2.0 * room_m / (slowest_mps + _WALKS_MPS[1])), early, speed],
                {"meet_s": f"waits_s + early_s + {room_m:.2f} / speed_mps", **common},
                edit | {"vehicle_class": "pedestrian"},
            )
        gains_s = math.sqrt(2.0 * room_m / _CYCLIST_MPS2)
        if gains_s < self.horizon_s - 2 * _KERB_S:
            yield self._made(
                f"cyclist crosses from the {side}",
                f"a cyclist crosses from the {side}",
                [
                    self._waits(gains_s),
                    early,
                    _range("speed_mps", *_CYCLES_MPS, "m/s", base=3.0, summary="largest speed"),
                ],
                {"meet_s": f"waits_s + early_s + {gains_s:.2f}", **common},
                edit | {"vehicle_class": "bicycle"},
            )

    def _waits(self, crosses_s: float) -> Parameter:
        """Return the parameter for the wait at the kerb, short enough to meet the ego before the horizon."""
        longest_s = max(self.horizon_s - crosses_s - _KERB_S, 2 * _KERB_S)
        return _range("waits_s", _KERB_S, longest_s, "s", summary="how long it stands at the kerb")

    @cached_property
    def _room_m(self) -> float:
        """The initial distance between the ego's centre and the nearest road user ahead in its lane."""
        first, ahead = self.nominal.first_step, [math.inf]
        for track in (*self.scene.tracks.values(), *self.scene.standing.values()):
            if track.index_at(first) is not None:
                along, aside, _ = self._seen_from_ego(track)
                if along > 0.0 and abs(aside) < _SAME_LANE_M:
                    ahead.append(along - track.length_m / 2)
        return min(ahead)

    def _ahead(self) -> Iterator[LogicalScenario]:
        """Yield road users in the ego's lane: a car that brakes, a slow cyclist, a standing car."""
        speed, room_m = self._speed_mps, self._room_m - 2 * _CAR_M
        at_ego = {"op": "add_vehicle", "at": "ego", "lane": "same", "offset_m": "$offset_m"}
        least_m, most_m = max(6.0, 0.8 * speed), min(max(25.0, 2.5 * speed), room_m)
        if most_m > least_m:
            yield self._made(
                "car ahead brakes",
                "a car ahead of the ego brakes",
                [
                    _range("gap_m", least_m, most_m, "m", base=most_m, summary="bumper to bumper at the start"),
                    self._begin,
                    _range("rate_mps2", _GENTLEST_MPS2, _HARDEST_MPS2, "m/s²", base=_GENTLEST_MPS2, summary="braking"),
                    _range("ratio", 0.7, 1.1, "", base=1.0, summary="its speed over the ego's at the start"),
                ],
                self._time | {"offset_m": f"gap_m + {_CAR_M:g}", "speed_mps": f"ratio * {speed:.3f}"},
                at_ego | {"vehicle_class": "car", "speed": "${speed_mps}m/s"},
                {
                    "op": "set_speed",
                    "vehicles": ["new:0"],
                    "speed": "0m/s",
                    "time_s": "$time_s",
                    "rate_mps2": "$rate_mps2",
                },
            )
        if speed > _CYCLES_MPS[1] and room_m > LEAST_TTC_S * (speed - _CYCLES_MPS[1]) + 10.0:
            fastest_s = min(self.horizon_s, room_m / (speed - _CYCLES_MPS[0]))
            yield self._made(
                "cyclist ahead",
                "a slow cyclist rides ahead of the ego",
                [
                    _range("reach_s", LEAST_TTC_S + 0.2, max(fastest_s, LEAST_TTC_S + 1.0), "s", summary=_REACH),
                    _range("speed_mps", *_CYCLES_MPS, "m/s", base=_CYCLES_MPS[1]),
                ],
                {"time_s": f"{self._begins_s:g}", "offset_m": f"reach_s * ({speed:.3f} - speed_mps) + 3.2"},
                at_ego | {"vehicle_class": "bicycle", "speed": "${speed_mps}m/s"},
                {
                    "op": "set_speed",
                    "vehicles": ["new:0"],
                    "speed": "${speed_mps}m/s",
                    "time_s": "$time_s",
                    "rate_mps2": 1.0,
                },
            )
        if speed > 3.0 and room_m > (LEAST_TTC_S + 0.5) * speed:
            yield self._made(
                "car stands ahead",
                "a car stands in the ego's lane",
                [_range("reach_s", LEAST_TTC_S + 0.2, min(self.horizon_s, room_m / speed), "s", summary=_REACH)],
                {"offset_m": f"reach_s * {speed:.3f} + {_CAR_M:g}"},
                at_ego | {"vehicle_class": "car", "speed": "0m/s"},
            )

    def _cuts_in(self, side: str) -> LogicalScenario:
        """Return a car that cuts in from the next lane, with a gap to the nominal ego at the start of the change."""
        back = "right" if side == "left" else "left"
        speed = self._speed_mps
        return self._made(
            f"car cuts in from the {side}",
            f"a car cuts in from the {side}",
            [
                self._begin,
                _range("gap_m", 2.0, 30.0, "m", base=30.0, summary="bumper to bumper when it begins"),
                _range("ratio", 0.4, 1.1, "", base=1.0, summary="its speed over the ego's at the start"),
                _range("lateral_s", *_LATERAL_S, "s", base=_LATERAL_S[1], summary="duration of the lane change"),
            ],
            self._time
            | {
                "along_m": self._driven("begin_s"),
                "speed_mps": f"ratio * {speed:.3f}",
                "offset_m": f"along_m + gap_m + {_CAR_M:g} - speed_mps * begin_s",
            },
            {
                "op": "add_vehicle",
                "vehicle_class": "car",
                "at": "ego",
                "lane": side,
                "offset_m": "$offset_m",
                "speed": "${speed_mps}m/s",
            },
            {"op": "change_lane", "vehicles": ["new:0"], "lane": back, "time_s": "$time_s", "lateral_s": "$lateral_s"},
        )

    def _comes_over(self) -> LogicalScenario:
        """Return an oncoming car that leaves its lane towards the ego and returns."""
        return self._made(
            "oncoming car comes over",
            "an oncoming car crosses the centre line",
            [
                _range("meet_s", 2.5, max(self.horizon_s - 0.5, 3.0), "s", summary="when the ego meets it"),
                _range("speed_mps", 5.0, 14.0, "m/s", base=8.0),
                _range("aside_m", 0.5, 3.5, "m", base=0.5, summary="how far it comes over"),
                _range("lead_s", 0.5, 2.5, "s", base=0.5, summary="how long before the meeting it begins"),
            ],
            {
                "along_m": self._driven("meet_s"),
                "offset_m": f"along_m + speed_mps * meet_s + {_CAR_M:g}",
                "time_s": f"meet_s - lead_s + {self._begins_s:g}",
            },
            {
                "op": "add_vehicle",
                "vehicle_class": "car",
                "at": "ego",
                "lane": "oncoming",
                "offset_m": "$offset_m",
                "speed": "${speed_mps}m/s",
            },
            {
                "op": "swerve",
                "vehicles": ["new:0"],
                "side": "left",
                "offset_m": "$aside_m",
                "lateral_s": 1.5,
                "time_s": "$time_s",
            },
        )

    def _conflicts(self) -> Iterator[LogicalScenario]:
        """Yield cars on lanes that cross the ego's way or merge into it, timed to arrive with the ego."""
        own = set(self._way.lanelets)
        found = sorted([*self._crossings(own), *self._merges(own)])
        for along, word, lanelet, station in found[:_MOST_CONFLICTS]:
            times = np.arange(len(self._distances)) * self.nominal.step_s
            meet_s = float(np.interp(along, self._distances, times))
            if meet_s < LEAST_TTC_S or along > self._distances[-1]:
                continue
            chain, lanelets, stations = self._upstream(lanelet, station)
            yield self._made(
                f"car {word} from lanelet {lanelet}",
                f"a car {word} from lanelet {lanelet} without yielding",
                [
                    _range("speed_mps", 4.0, 14.0, "m/s", base=8.0),
                    _range("early_s", -1.5, 1.5, "s", base=-1.5, summary="how much earlier than the ego it is there"),
                ],
                {
                    "back_m": f"speed_mps * ({meet_s:.3f} - early_s)",
                    "lanelet": Curve(of="back_m", at=chain, values=lanelets, steps=True),
                    "origin_m": Curve(of="back_m", at=chain, values=stations, steps=True),
                    "station_m": "origin_m - back_m",
                    "time_s": f"{self._begins_s:g}",
                },
                {
                    "op": "add_vehicle",
                    "vehicle_class": "car",
                    "at": "$lanelet",
                    "position": "${station_m}m",
                    "speed": "${speed_mps}m/s",
                    "to": [str(lanelet)],
                },
                {
                    "op": "set_speed",
                    "vehicles": ["new:0"],
                    "speed": "${speed_mps}m/s",
                    "time_s": "$time_s",
                    "rate_mps2": 2.0,
                },
            )

    def _crossings(self, own: set[int]) -> Iterator[tuple[float, str, int, float]]:
        """Yield, for each lane that crosses the ego's way: the distance along the way, ``crosses``, the lanelet, the
        station.
        """
        import shapely

        if len(self._way.points) < 2:
            return
        way = shapely.LineString(self._way.points)
        for key, lane in self.scene.layout.table.lanes.items():
            if key in own:
                continue
            meeting = shapely.intersection(way, shapely.LineString(lane.center))
            if meeting.is_empty:
                continue
            place = np.array(shapely.get_coordinates(meeting)[0])
            station = project(lane.center, place)[0]
            on_way, _ = project(self._way.points, place)
            turned = abs(wrap_angle(point_at(lane.center, station)[1] - point_at(self._way.points, on_way)[1]))
            if _CROSSING_RAD < turned < math.pi - _CROSSING_RAD:
                yield on_way, "crosses", key, station

    def _merges(self, own: set[int]) -> Iterator[tuple[float, str, int, float]]:
        """Yield the same as ``_crossings`` for lanes that merge into a lanelet of the ego's way."""
        table = self.scene.layout.table
        way = self._way
        for index, key in enumerate(way.lanelets):
            if index == 0 or way.lanelets[index - 1] == key:
                continue
            for before in table.predecessors[key]:
                if before not in own:
                    yield float(way.along[index]), "merges", before, table.lanes[before].length_m

    def _upstream(self, lanelet: int, station: float) -> tuple[tuple[float, ...], tuple[str, ...], tuple[float, ...]]:
        """Return the lanelets that lead to a place: how far before it each begins, the lanelets, and the origins of
        their stations.
        """
        table, back, origin = self.scene.layout.table, 0.0, station
        at, lanelets, origins, key = [0.0], [str(lanelet)], [round(station, 2)], lanelet
        while back < 150.0:
            before = [one for one in table.predecessors[key] if str(one) not in lanelets]
            if not before:
                break
            back += origin if len(at) == 1 else table.lanes[key].length_m
            key = before[0]
            at.append(round(back, 2))
            lanelets.append(str(key))
            origins.append(round(back + table.lanes[key].length_m, 2))
        return tuple(at), tuple(lanelets), tuple(origins)


def _range(name: str, low: float, high: float, unit: str, *, base: float | None = None, summary: str = "") -> Parameter:
    return Parameter(name=name, low=round(low, 3), high=round(high, 3), unit=unit, base=base, summary=summary)


def values_at(stratum: LogicalScenario, shares: Sequence[float]) -> dict[str, float]:
    """Return the values of a stratum's parameters at given fractions of their ranges."""
    return {
        parameter.name: parameter.at_share(share) for parameter, share in zip(stratum.parameters, shares, strict=True)
    }


def is_feasible(stratum: LogicalScenario, evaluator: Evaluator) -> bool:
    """Return True if at least one of a few sampled points of a stratum can be applied to the evaluator's base."""
    for first, others in _TRIES:
        shares = [first, *([others] * (len(stratum.parameters) - 1))]
        with suppress(InvalidRequest):
            if evaluator.edited(concrete_edits(stratum, values_at(stratum, shares))) is not None:
                return True
    return False
