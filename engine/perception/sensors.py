"""The sensors of one run: what they report about the other road users at each planning step, and where the ego believes
it is.

A frame shows the road users as they were when it was taken. The sensors decide for each one within 80 m whether they
detect it (range, field of view, occlusion, misses), a tracker decides whether it reports it (confirmation, memory), and
an error is added to its state. All of it depends only on the seeds, the road user and the time step.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ...schemas.worlds import LARGEST_RANGE_M, REPORTED, Ghost, Perceived, SightCode, Sighting, World
from ..commonroad import Track
from ..geometry import Points, wrap_angle
from ..vehicles import vehicle_classes
from .randomness import Slow, Stretches, correlation, stream
from .visibility import LOOKED_PAST, NO_BODIES, Bodies, seen_shares

_FIRST_GHOST_ID = -2
"""Ghosts have negative ids; −1 is the ego's track in metrics."""
_SOME = 1e-9
"""A larger share is in the field of view."""
_FASTEST_MPS = 100.0
"""No road user approaches the ego faster (chosen: two vehicles at 180 km/h)."""
_CONFUSED_WITH = {
    "pedestrian": ("bicycle",),
    "bicycle": ("motorcycle", "pedestrian"),
    "motorcycle": ("bicycle",),
    "car": ("truck",),
    "taxi": ("car",),
    "truck": ("bus", "car"),
    "bus": ("truck",),
}
"""Classes that detectors confuse, because their bodies look alike (chosen)."""


class Posed(Protocol):
    """The ego at one time step."""

    @property
    def step(self) -> int:
        """Its time step."""

    @property
    def position(self) -> Points:
        """Its centre (2,) in m."""

    @property
    def heading_rad(self) -> float:
        """Its heading in rad."""


class RoadUsers(Protocol):
    """The other road users as tracks; static ones have a single state."""

    @property
    def moving(self) -> tuple[Track, ...]:
        """Dynamic obstacles."""

    @property
    def standing(self) -> tuple[Track, ...]:
        """Static obstacles."""


@dataclass(frozen=True)
class PoseError:
    """The pose that the ego believes it has, minus its true one: in m along both axes, and in rad."""

    shift: Points
    turn_rad: float

    def believed(self, points: Points, about: Points) -> Points:
        """Return where points (2,) or (n, 2) around the ego's true position appear to be."""
        return np.asarray(about + self.shift + (points - about) @ _rotation(self.turn_rad).T)

    def true(self, points: Points, about: Points) -> Points:
        """Return the true positions of points that were planned from the pose that the ego believes it has."""
        return np.asarray(about + (points - about - self.shift) @ _rotation(-self.turn_rad).T)


def _rotation(angle_rad: float) -> Points:
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[cosine, -sine], [sine, cosine]])


@dataclass(frozen=True)
class Percept:
    """The road users that the planner receives at one planning step, as tracks of one state, and the error of the ego's
    pose.
    """

    moving: tuple[Track, ...]
    standing: tuple[Track, ...]
    error: PoseError | None = None


@dataclass
class _Followed:
    """A road user in the tracker's memory: its state at its last detection, and the steps of its detections."""

    track: Track
    row: int
    is_static: bool
    ego: Posed
    since: int
    confirmed: bool

    @property
    def last(self) -> int:
        """The step of the last frame in which it was detected."""
        return self.ego.step


@dataclass(frozen=True)
class _Apparition:
    """A ghost, the step of its birth, and the last step at which it is reported."""

    track: Track
    first: int
    last: int


class Sensors:
    """The sensors of one run. The ego's states are given up to the present one, without a gap."""

    def __init__(self, world: World, seed: int, step_s: float, walls: Bodies = NO_BODIES) -> None:
        self._world, self._seeds, self._step_s, self._walls = world, (seed, world.seed), step_s, walls
        self._first: int | None = None
        self._latency = round(world.latency_s / step_s)
        self._confirmed = round(world.confirmed_s / step_s)
        self._kept = round(world.kept_s / step_s)
        self._estimates: dict[int, Slow] = {}
        self._missed: dict[int, Stretches] = {}
        self._kinds: dict[int, str] = {}
        self._memory: dict[int, _Followed] = {}
        self._ghosts: list[_Apparition] = []
        self._ghosts_until: int | None = None
        self._ghost_numbers = stream(self._seeds, "ghosts")
        self._lost = Stretches(stream(self._seeds, "frames"), world.dropped, 1.0)
        self._pose = Slow(stream(self._seeds, "localisation"), 3, correlation(world.localisation_s, step_s))
        self._newest: int | None = None
        self._taken = 0
        self._reported: list[_Followed] = []
        self._codes: dict[int, tuple[SightCode, int | None]] = {}
        self._sightings: list[Sighting] = []
        self._reported_ghosts: list[Ghost] = []
        self._poses: list[tuple[float, float, float]] = []

    def perceive(self, users: RoadUsers, states: Sequence[Posed]) -> Percept:
        """Return what the planner receives at the ego's last state."""
        first, now = states[0].step, states[-1]
        newest = max(now.step - self._latency, first)
        self._first = first
        begin = first if self._newest is None else self._newest + 1
        taken = [step for step in range(begin, newest + 1) if step == first or not self._lost.at(step - first)]
        self._newest = newest
        if taken:
            self._look(users, [states[step - first] for step in taken])
        self._conjure(states)
        moving, standing = list[Track](), list[Track]()
        for known in self._reported:
            (standing if known.is_static else moving).append(self._estimate(known, now.step))
        ghosts = [one.track for one in self._ghosts if one.first <= newest <= one.last]
        self._reported_ghosts += [_ghost(one, now.step) for one in ghosts]
        error = self._error(now.step)
        if error is not None:
            place = error.believed(now.position, now.position)
            self._poses.append((float(place[0]), float(place[1]), now.heading_rad + error.turn_rad))
        return Percept((*moving, *(replace(one, first_step=now.step) for one in ghosts)), tuple(standing), error)

    def perceived(self) -> Perceived:
        """Return what the planner received over the whole run."""
        poses = list(zip(*self._poses, strict=True)) or [(), (), ()]
        return Perceived(
            sightings=tuple(sorted(self._sightings, key=lambda one: (one.obstacle_id, one.step))),
            ghosts=tuple(self._reported_ghosts),
            ego_x_m=poses[0],
            ego_y_m=poses[1],
            ego_heading_rad=poses[2],
        )

    def _index(self, step: int) -> int:
        return step - (self._first or 0)

    def _error(self, step: int) -> PoseError | None:
        """Return the error of the ego's pose at a step, or None if the world has none."""
        if not self._world.locates_imperfectly:
            return None
        drawn = self._pose.at(self._index(step))
        turn_rad = math.radians(self._world.localisation_deg) * float(drawn[2])
        return PoseError(self._world.localisation_m * drawn[:2], turn_rad)

    def _look(self, users: RoadUsers, egos: Sequence[Posed]) -> None:
        """Take a frame at each of the given states of the ego, and decide what is reported from then on."""
        around = _Around.of(users, egos, self._step_s)
        near, codes, hidden_by = self._detected(around, egos)
        for frame, ego in enumerate(egos):
            self._taken, self._reported = ego.step, []
            arrives = ego.step if ego.step == self._first else ego.step + self._latency
            for at in np.flatnonzero(near[frame]).tolist():
                track, seen = around.tracks[at], codes[frame][at]
                if seen == "seen" and self._misses(track.obstacle_id, ego.step):
                    seen = "missed"
                row = int(around.rows[frame, at])
                code = self._tracked(track, row, seen, ego, is_static=at >= around.moving)
                by = hidden_by[frame][at] if code == "occluded" else -1
                self._note(track.obstacle_id, arrives, code, around.tracks[by].obstacle_id if by >= 0 else None)
                if code in REPORTED:
                    self._reported.append(self._memory[track.obstacle_id])

    def _detected(
        self, around: "_Around", egos: Sequence[Posed]
    ) -> tuple[NDArray[np.bool_], list[list[SightCode]], list[list[int]]]:
        """Return which road users are within 80 m in each frame, whether each is in view, and what hides it (or −1).

        Those in view have the code ``seen``; the others have the reason why they are not.
        """
        world, count = self._world, len(around.tracks)
        origins, headings = np.array([ego.position for ego in egos]), np.array([ego.heading_rad for ego in egos])
        away = around.bodies.centres - origins[:, None, :]
        away_m = np.hypot(away[..., 0], away[..., 1])
        near = around.bodies.present & (away_m <= LARGEST_RANGE_M)
        codes = [["seen"] * count for _ in egos]
        hidden_by = [[-1] * count for _ in egos]
        if count and (world.visible > 0 or world.view_deg < 360):
            bodies = around.bodies
            if world.visible > 0 and self._walls.sizes_m.size:
                bodies = bodies.and_walls(self._walls.near(origins[-1], 2 * LARGEST_RANGE_M))
            view = seen_shares(origins, headings, math.radians(world.view_deg), bodies, count=count)
            least = max(world.visible, _SOME)
            for frame, at in zip(*np.nonzero(view.visible < world.visible), strict=True):
                by = int(view.hidden_by[frame, at])
                codes[frame][at], hidden_by[frame][at] = "occluded", by if by < count else -1
            for frame, at in zip(*np.nonzero(view.within < least), strict=True):
                codes[frame][at] = "out_of_view"
        for frame, at in zip(*np.nonzero(near & (away_m > world.range_m)), strict=True):
            codes[frame][at] = "out_of_range"
        return near, codes, hidden_by  # type: ignore[return-value]

    def _misses(self, key: int, step: int) -> bool:
        """Return whether the sensors miss a road user in view in a frame."""
        if self._world.missed <= 0:
            return False
        if key not in self._missed:
            numbers = stream(self._seeds, "missed", key)
            self._missed[key] = Stretches(numbers, self._world.missed, self._world.missed_s / self._step_s)
        return self._missed[key].at(self._index(step))

    def _tracked(self, track: Track, row: int, seen: SightCode, ego: Posed, *, is_static: bool) -> SightCode:
        """Return whether the tracker reports a road user after a frame, and if not, why."""
        key, step = track.obstacle_id, ego.step
        known = self._memory.get(key)
        if seen != "seen":
            if known is None or not known.confirmed or step - known.last > self._kept:
                self._memory.pop(key, None)
                return seen
            return "kept"
        since = step if known is None else known.since
        was_confirmed = step == self._first if known is None else known.confirmed
        confirmed = was_confirmed or step - since >= self._confirmed
        self._memory[key] = _Followed(track, row, is_static, ego, since, confirmed)
        return "seen" if confirmed else "unconfirmed"

    def _estimate(self, known: _Followed, now: int) -> Track:
        """Return a road user as it is reported: a track of one state, at the present step.

        The heading of a moving road user is known from its motion too. The two independent estimates are combined with
        weights inverse to their variances. A road user that is no longer detected goes straight on at its speed.
        """
        world, track, row, ego = self._world, known.track, known.row, known.ego
        position, heading, speed = track.positions[row], float(track.headings_rad[row]), float(track.speeds_mps[row])
        if world.position_m > 0 or world.speed_mps > 0 or world.heading_deg > 0:
            drawn = self._estimates_of(track.obstacle_id).at(self._index(ego.step))
            position = position + world.position_m * drawn[:2]
            turn_rad = math.radians(world.heading_deg)
            if world.speed_mps > 0 and turn_rad > 0:
                turn_rad = 1 / math.hypot(1 / turn_rad, speed / world.speed_mps)
            heading += turn_rad * float(drawn[3])
            speed = max(speed + world.speed_mps * float(drawn[2]), 0.0)
        since_s = (self._taken - known.last) * self._step_s
        if since_s > 0:
            position = position + since_s * speed * np.array([math.cos(heading), math.sin(heading)])
        error = self._error(ego.step)
        if error is not None:
            position, heading = error.believed(position, ego.position), heading + error.turn_rad
        return _state(track, self._kind_of(track), position, heading, speed, now)

    def _kind_of(self, track: Track) -> str:
        """Return the class that is reported for a road user over the whole run."""
        if self._world.confused <= 0:
            return track.kind
        if track.obstacle_id not in self._kinds:
            drawn = stream(self._seeds, "class", track.obstacle_id).random(2)
            others = _CONFUSED_WITH.get(track.kind, ())
            wrong = bool(others) and drawn[0] < self._world.confused
            self._kinds[track.obstacle_id] = others[int(drawn[1] * len(others))] if wrong else track.kind
        return self._kinds[track.obstacle_id]

    def _estimates_of(self, key: int) -> Slow:
        if key not in self._estimates:
            kept = correlation(self._world.correlation_s, self._step_s)
            self._estimates[key] = Slow(stream(self._seeds, "estimate", key), 4, kept)
        return self._estimates[key]

    def _note(self, key: int, step: int, code: SightCode, by: int | None) -> None:
        if self._codes.get(key) != (code, by):
            self._codes[key] = (code, by)
            self._sightings.append(Sighting(obstacle_id=key, step=step, code=code, by=by))

    def _conjure(self, states: Sequence[Posed]) -> None:
        """Draw the ghosts that are born up to the ego's last state.

        Births are a Poisson process, and durations are exponential. A ghost stands at a random place in the field of
        view, uniformly over its area, and has the size of a car.
        """
        world, step_s = self._world, self._step_s
        if world.ghosts <= 0:
            return
        begin = 0 if self._ghosts_until is None else self._ghosts_until - states[0].step + 1
        lasts_s = max(world.ghosts_s, step_s)
        for ego in states[begin:]:
            at_first = self._ghosts_until is None
            self._ghosts_until = ego.step
            expected = world.ghosts * (1.0 if at_first else step_s / lasts_s)
            for _ in range(int(self._ghost_numbers.poisson(expected))):
                lasts = int(self._ghost_numbers.exponential(lasts_s) / step_s)
                self._ghosts.append(_Apparition(self._ghost_near(ego), ego.step, ego.step + lasts))

    def _ghost_near(self, ego: Posed) -> Track:
        drawn = self._ghost_numbers.random(3)
        away_m = self._world.range_m * math.sqrt(drawn[0])
        bearing = ego.heading_rad + math.radians(self._world.view_deg) * (drawn[1] - 0.5)
        position = ego.position + away_m * np.array([math.cos(bearing), math.sin(bearing)])
        car = vehicle_classes()["car"]
        return Track(
            obstacle_id=_FIRST_GHOST_ID - len(self._ghosts),
            kind=car.commonroad_type,
            length_m=car.length_m,
            width_m=car.width_m,
            first_step=ego.step,
            positions=position[None, :],
            headings_rad=np.array([wrap_angle(math.tau * drawn[2])]),
            speeds_mps=np.zeros(1),
        )


@dataclass(frozen=True)
class _Around:
    """The road users that may be within 80 m of the ego in some frames, the dynamic ones first.

    ``rows`` (f, n) are the indices of their states; ``moving`` is the number of dynamic ones.
    """

    tracks: list[Track]
    rows: NDArray[np.intp]
    bodies: Bodies
    moving: int

    @classmethod
    def of(cls, users: RoadUsers, egos: Sequence[Posed], step_s: float) -> "_Around":
        """Return the road users around the ego in frames that are taken at some of its states."""
        first, last = egos[0].step, egos[-1].step
        x, y = (float(value) for value in egos[-1].position)
        within_m = LARGEST_RANGE_M + _FASTEST_MPS * (last - first) * step_s
        tracks = list[Track]()
        for track in users.moving:
            begin, states = track.first_step, len(track.positions)
            if begin <= last and first < begin + states:
                place = track.positions[min(last - begin, states - 1)]
                if abs(place[0] - x) <= within_m and abs(place[1] - y) <= within_m:
                    tracks.append(track)
        moving = len(tracks)
        for track in users.standing:
            place = track.positions[0]
            if abs(place[0] - x) <= within_m and abs(place[1] - y) <= within_m:
                tracks.append(track)
        steps = np.array([ego.step for ego in egos])
        begins = np.array([track.first_step for track in tracks], dtype=int)
        counts = np.array([len(track.positions) for track in tracks], dtype=int)
        rows = steps[:, None] - begins[None, :]
        present = (rows >= 0) & (rows < counts)
        rows[:, moving:], present[:, moving:] = 0, True
        rows = np.clip(rows, 0, np.maximum(counts - 1, 0))
        columns = rows.T
        bodies = Bodies(
            np.array([track.positions[own] for track, own in zip(tracks, columns, strict=True)])
            .reshape(-1, len(egos), 2)
            .swapaxes(0, 1),
            np.array([track.headings_rad[own] for track, own in zip(tracks, columns, strict=True)])
            .reshape(-1, len(egos))
            .T,
            np.array([track.size_m for track in tracks]).reshape(-1, 2),
            np.array([track.kind not in LOOKED_PAST for track in tracks], dtype=bool),
            present,
        )
        return cls(tracks, rows, bodies, moving)


def _state(track: Track, kind: str, position: Points, heading_rad: float, speed_mps: float, step: int) -> Track:
    return replace(
        track,
        kind=kind,
        first_step=step,
        positions=np.asarray(position, dtype=float)[None, :],
        headings_rad=np.array([heading_rad]),
        speeds_mps=np.array([speed_mps]),
    )


def _ghost(track: Track, step: int) -> Ghost:
    return Ghost(
        step=step,
        x_m=round(float(track.positions[0, 0]), 4),
        y_m=round(float(track.positions[0, 1]), 4),
        heading_rad=round(float(track.headings_rad[0]), 4),
        length_m=track.length_m,
        width_m=track.width_m,
    )
