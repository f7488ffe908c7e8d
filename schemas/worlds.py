"""Imperfect worlds: what the planner's sensors miss, delay and distort, and how the ego moves.

``docs/worlds.md`` explains every field.

The planner receives what the sensors of a :class:`World` report. The judge, the metrics and the analysis see the truth.
The default is perfect: the planner receives the true state of every road user within its radius.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Annotated, Any, Literal, get_args

from pydantic import Field

from .base import Model
from .errors import Faults, InvalidRequest, UnknownName, closest, instead, misspelt, misspelt_names, with_values
from .grammar import parse_assignment

LARGEST_RANGE_M = 80.0
"""Planners are never given road users with centres farther away (``engine/planners/prediction.py``)."""
_MOST_S = 10.0
"""The longest time of a world's field (chosen: longer than any prediction or latency that a planner could use)."""
Share = Annotated[float, Field(ge=0, le=1)]
Duration = Annotated[float, Field(ge=0, le=_MOST_S)]


Dynamics = Literal["exact", "kinematic", "single_track", "drift", "multi_body"]
"""How the ego moves: exactly as planned, or as a vehicle model of CommonRoad under a tracking controller."""


class World(Model):
    """The effect of the sensors between the scenario and the planner, and the motion of the ego.

    All random numbers depend only on the seeds.

    Errors are normally distributed with the given standard deviation. They change slowly, with the time constant
    ``correlation_s``; 0 makes them independent at every time step.
    """

    range_m: float = Field(LARGEST_RANGE_M, ge=1, le=LARGEST_RANGE_M, description="how far the sensors reach, in m")
    view_deg: float = Field(360.0, ge=1, le=360, description="field of view, centred on the ego's heading")
    visible: Share = Field(
        0.0, description="share of a body's outline that must be in view to be detected; 0: nothing is hidden"
    )
    position_m: float = Field(0.0, ge=0, le=10, description="error of positions, along each axis")
    speed_mps: float = Field(0.0, ge=0, le=20, description="error of velocities, along each axis")
    heading_deg: float = Field(0.0, ge=0, le=90, description="error of headings")
    correlation_s: Duration = Field(0.0, description="time constant of these errors; 0: independent at every step")
    missed: Share = Field(0.0, description="share of time in which a visible road user is not detected")
    missed_s: Duration = Field(0.0, description="mean duration of a missed stretch; 0: independent at every step")
    ghosts: float = Field(0.0, ge=0, le=20, description="mean number of reported road users that do not exist")
    ghosts_s: Duration = Field(0.5, description="mean duration of a ghost")
    confused: Share = Field(0.0, description="share of road users that are reported with a wrong class")
    confirmed_s: Duration = Field(0.0, description="how long a road user must be detected before it is reported")
    kept_s: Duration = Field(0.0, description="how long a road user that is no longer detected is still reported")
    latency_s: Duration = Field(0.0, description="age of what is reported")
    dropped: Share = Field(0.0, description="share of frames that are lost; the planner gets the frame before")
    localisation_m: float = Field(0.0, ge=0, le=10, description="error of the ego's own position, along each axis")
    localisation_deg: float = Field(0.0, ge=0, le=45, description="error of the ego's own heading")
    localisation_s: Duration = Field(5.0, description="time constant of these two errors")
    ego: Dynamics = Field("exact", description="how the ego moves: exactly as planned, or by a vehicle model")
    actuator_s: float = Field(0.0, ge=0, le=1, description="delay of steering, engine and brakes")
    seed: int = Field(0, ge=0, le=2**31 - 1, description="seed of the sensors, in addition to the run's")

    @property
    def is_perfect(self) -> bool:
        """Whether the planner receives the truth and its plans are driven exactly, regardless of the seed."""
        return not self.hides_truth and not self.moves_by_model

    @property
    def hides_truth(self) -> bool:
        """Whether anything that the planner receives differs from the truth."""
        return self.senses_imperfectly or self.locates_imperfectly

    @property
    def moves_by_model(self) -> bool:
        """Whether a vehicle model drives the ego."""
        return self.ego != "exact"

    @property
    def senses_imperfectly(self) -> bool:
        """Whether the states of other road users that the planner receives differ from the truth."""
        return any(getattr(self, name) != World.model_fields[name].default for name in _SENSING)

    @property
    def locates_imperfectly(self) -> bool:
        """Whether the ego pose that the planner receives differs from the truth."""
        return self.localisation_m > 0 or self.localisation_deg > 0

    @property
    def reports_true_states(self) -> bool:
        """Whether the road users that the planner receives have their true present states."""
        return not any(getattr(self, name) for name in _DISTORTING)

    @property
    def stated(self) -> dict[str, float | str]:
        """The fields that differ from a perfect world, for recipes; empty if the world is perfect.

        Two spellings of one world are equal here, so that they give the same run.
        """
        return {} if self.is_perfect else self.model_dump(exclude_defaults=True)

    def in_words(self) -> str:
        """Return the world as an argument states it: ``perfect``, ``lidar``, or ``camera, missed=0.2``."""
        if self.is_perfect:
            return PERFECT_NAME
        wanted = self.stated
        base = min(PRESETS, key=lambda name: len(_differing(PRESETS[name].world.stated, wanted)))
        changed = _differing(PRESETS[base].world.stated, wanted)
        named = [] if base == PERFECT_NAME else [base]
        values = ((name, getattr(self, name)) for name in changed)
        return ", ".join([*named, *(f"{name}={value}".removesuffix(".0") for name, value in values)])


_SENSING = (
    "range_m",
    "view_deg",
    "visible",
    "position_m",
    "speed_mps",
    "heading_deg",
    "missed",
    "ghosts",
    "confused",
    "confirmed_s",
    "latency_s",
    "dropped",
)
"""The fields that change what is reported; the others only qualify these, or locate the ego."""
_DISTORTING = (
    "position_m",
    "speed_mps",
    "heading_deg",
    "kept_s",
    "latency_s",
    "dropped",
    "localisation_m",
    "localisation_deg",
)
"""The fields with which a reported state differs from the true one."""
PERFECT = World()
"""The default: the planner gets the truth."""
PERFECT_NAME = "perfect"


class Preset(Model):
    """A named world, its purpose, and the source of its values."""

    world: World
    intent: str
    source: str


def _axis_error(mean_distance: float) -> float:
    """Return the standard deviation along each axis of a two-dimensional error with this mean length.

    The error's length has a Rayleigh distribution with a mean of √(π/2) standard deviations.
    """
    return round(mean_distance / math.sqrt(math.pi / 2), 2)


def _heading_error(mean_rad: float) -> float:
    """Return the standard deviation in degrees of a heading error with this mean absolute value in rad.

    The mean of the absolute value of a normal distribution is √(2/π) standard deviations.
    """
    return round(math.degrees(mean_rad / math.sqrt(2 / math.pi)), 1)


_LIDAR = World(
    visible=0.2,
    position_m=_axis_error(0.175),
    speed_mps=_axis_error(0.272),
    heading_deg=_heading_error(0.083),
    correlation_s=1.0,
    missed=0.05,
    missed_s=0.2,
    confirmed_s=0.2,
    kept_s=0.2,
    latency_s=0.1,
    localisation_m=0.05,
    localisation_deg=0.09,
)
_CAMERA = _LIDAR.model_copy(
    update={
        "range_m": 50.0,
        "visible": 0.4,
        "position_m": _axis_error(0.6185),
        "speed_mps": _axis_error(0.3157),
        "heading_deg": _heading_error(0.109),
        "missed": 0.1,
    }
)
PRESETS: Mapping[str, Preset] = MappingProxyType(
    {
        PERFECT_NAME: Preset(world=PERFECT, intent="the planner gets the truth", source="the default"),
        "occlusion": Preset(
            world=World(visible=0.2),
            intent="exact, but without road users that others hide",
            source="the geometry of the scenario; the share in view is chosen",
        ),
        "lidar": Preset(
            world=_LIDAR,
            intent="a lidar on the roof with a tracker",
            source=(
                "errors of cars on nuScenes by TransFusion-L as published with BEVFusion (translation 0.175 m, "
                "velocity 0.272 m/s, orientation 0.083 rad); tracker of AB3DMOT (Weng et al. 2020: three hits, two "
                "frames of memory at 10 Hz); latency: Lin et al. 2018 (100 ms); localisation: Reid et al. 2019, local "
                "streets (95 % within 0.10 m and 0.17°); share in view, misses and time constants are chosen"
            ),
        ),
        "camera": Preset(
            world=_CAMERA,
            intent="cameras around the vehicle with a tracker",
            source=(
                "mean errors on nuScenes by BEVFormer v2 (translation 0.6185 m, velocity 0.3157 m/s) and of cars by "
                "BEVDet (orientation 0.109 rad); range: nuScenes evaluates cars up to 50 m; share in view: the lowest "
                "of nuScenes' four levels of visibility ends at 40 %; the rest as for lidar"
            ),
        ),
        "fog": Preset(
            world=_LIDAR.model_copy(update={"range_m": 50.0}),
            intent="a lidar in fog with a visibility of 50 m",
            source="rear fog lights may be used below 50 m of visibility (§ 17 StVO); the rest as for lidar",
        ),
        "degraded": Preset(
            world=_CAMERA.model_copy(
                update={
                    "position_m": 2 * _CAMERA.position_m,
                    "speed_mps": 2 * _CAMERA.speed_mps,
                    "heading_deg": 2 * _CAMERA.heading_deg,
                    "missed": 0.2,
                    "ghosts": 0.3,
                    "confused": 0.1,
                    "latency_s": 0.3,
                    "dropped": 0.2,
                    "localisation_m": 0.1,
                    "localisation_deg": 0.26,
                }
            ),
            intent="dirty or failing cameras",
            source=(
                "twice the camera's errors; localisation: Reid et al. 2019, freeways (95 % within 0.20 m laterally and "
                "0.51°); all else is chosen"
            ),
        ),
    }
)
"""Named worlds; ``docs/worlds.md`` lists their values."""


def world_of(texts: Sequence[str] | str | World) -> World:
    """Return the world that an argument states by presets and values.

    If it names several presets, each value is the worst of theirs. Assignments replace the presets' values, and later
    assignments replace earlier ones: ``"camera, missed=0.2"`` is the camera's world with more misses. Several texts
    count as one.

    Raises:
        UnknownName: no preset or field has this name.
        InvalidRequest: a value is outside its range. All faults are reported together, with the world that is left.
    """
    if isinstance(texts, World):
        return texts
    presets = [preset.world for _, preset in _presets_in(texts)]
    values: dict[str, Any] = {name: _worst(name, presets) for name in World.model_fields if presets}
    values |= _assignments(texts)
    world = World(**values)
    if world.actuator_s > 0 and not world.moves_by_model:
        models = [name for name in get_args(Dynamics) if name != "exact"]
        raise InvalidRequest(
            "actuator_s delays the commands to a vehicle model, and the ego moves exactly as planned",
            valid=[f"ego={name}" for name in models],
            next_step="add one of these, or leave out actuator_s",
        )
    return PERFECT if world.is_perfect else world


def combination_notes(texts: Sequence[str] | str | World) -> tuple[str, ...]:
    """Return what several presets give together, as the text of a note; empty for a single preset."""
    names = [] if isinstance(texts, World) else list(dict.fromkeys(name for name, _ in _presets_in(texts)))
    if len(names) < 2:
        return ()
    together = world_of(names).in_words()
    return (
        f"the presets {' and '.join(names)} together give the world '{together}': for each setting, the worse value",
    )


def _presets_in(texts: Sequence[str] | str) -> Iterator[tuple[str, Preset]]:
    """Yield the presets that an argument names, without ``perfect``, which adds nothing."""
    for name in map(str.lower, _items(texts)):
        if name in PRESETS and name != PERFECT_NAME:
            yield name, PRESETS[name]


def _worst(name: str, worlds: Sequence[World]) -> Any:
    """Return the worst value of a field: the smallest range or field of view, otherwise the largest value."""
    values = [getattr(world, name) for world in worlds]
    return min(values) if name in _SMALLER_IS_WORSE else max(values)


_SMALLER_IS_WORSE = ("range_m", "view_deg")


def _items(texts: Sequence[str] | str) -> Iterable[str]:
    given = [texts] if isinstance(texts, str) else texts
    return (item.strip() for text in given for item in text.split(",") if item.strip())


def _assignments(texts: Sequence[str] | str) -> dict[str, float | str]:
    """Return the fields that an argument assigns.

    Raises:
        InvalidRequest: items are wrong; the remedy corrects them, or leaves out those without a correction.
    """
    faults, values, left = Faults(), dict[str, float | str](), list[str]()
    for text in _items(texts):
        if text.lower() in PRESETS:
            left.append(text)
            continue
        try:
            name, values[name] = _assigned(text)
            left.append(text)
        except InvalidRequest as fault:
            changes = [change for remedy in fault.remedies[:1] for change in remedy.changes]
            left += [change.words[text] for change in changes if text in change.words]
            with faults.collecting():
                raise
    try:
        faults.raise_all()
    except InvalidRequest as refusal:
        refusal.remedies = (with_values(world=",".join(dict.fromkeys(left)) or None),)
        raise
    return values


def _assigned(text: str) -> tuple[str, float | str]:
    """Return a field and its value from text such as ``missed=0.1``."""
    if "=" not in text:
        raise UnknownName(f"there is no world '{text}'", valid=closest(text, PRESETS), remedies=misspelt(text, PRESETS))
    change = parse_assignment(text)
    if change.name not in World.model_fields:
        near = closest(change.name, World.model_fields) or list(World.model_fields)
        wanted = "" if change.operand is None else f"={change.operand:g}"
        raise UnknownName(
            f"a world has no '{change.name}'",
            valid=near,
            remedies=[instead(text, f"{name}{wanted}") for name in near[:1]],
        )
    if change.name == "ego":
        if change.operator != "=" or change.copied_from not in get_args(Dynamics):
            meant = misspelt_names(change.copied_from or "", get_args(Dynamics))
            raise InvalidRequest(
                f"'{text}' is not a way in which the ego moves",
                valid=[f"ego={name}" for name in closest(change.copied_from or "", get_args(Dynamics))],
                remedies=[instead(text, f"ego={name}") for name in meant],
            )
        return change.name, str(change.copied_from)
    low, high = bounds_of(change.name)
    value = change.operand
    outside = value is None or not low <= value <= high
    if change.operator != "=" or outside or (change.name == "seed" and value != int(value or 0)):
        nearest = low if value is None or value < low else min(value, high)
        nearest = round(nearest) if change.name == "seed" else nearest
        raise InvalidRequest(
            f"'{text}' is out of range"
            if outside and change.operand is not None
            else f"'{text}' is not a setting of a world",
            valid=[f"{change.name} from {low:g} to {high:,.0f}"],
            next_step="choose a value in this range",
            remedies=[instead(text, f"{change.name}={nearest:g}")],
            complete=True,
        )
    return change.name, int(value or 0) if change.name == "seed" else float(value or 0.0)


def bounds_of(name: str) -> tuple[float, float]:
    """Return the smallest and the largest value of a world's field."""
    low, high = 0.0, math.inf
    for rule in World.model_fields[name].metadata:
        low = getattr(rule, "ge", low)
        high = getattr(rule, "le", high)
    return float(low), float(high)


def _differing(first: Mapping[str, float | str], second: Mapping[str, float | str]) -> list[str]:
    """Return the fields in which two stated worlds differ, in the order of the model."""
    defaults = {name: field.default for name, field in World.model_fields.items()}
    return [name for name in defaults if first.get(name, defaults[name]) != second.get(name, defaults[name])]


SightCode = Literal["seen", "kept", "out_of_range", "out_of_view", "occluded", "missed", "unconfirmed"]
"""What the planner got of a road user, and if it got nothing, why.

- ``seen``: its state as the sensors estimated it
- ``kept``: a state extrapolated from its last detection
- ``out_of_range``, ``out_of_view``: it was beyond the sensors' range or field of view
- ``occluded``: other bodies hid it
- ``missed``: it was in view, but was not detected
- ``unconfirmed``: it was detected too recently to be reported
"""
REPORTED: tuple[SightCode, ...] = ("seen", "kept")
"""The codes under which the planner gets a road user."""


class Sighting(Model):
    """The planner's reception of a road user from a planning step until the next entry.

    Only the steps at which it changes have an entry. ``by`` is the road user that hides the largest part of the road
    user.
    """

    obstacle_id: int
    step: int
    code: SightCode
    by: int | None = Field(None, exclude_if=lambda key: key is None)


class Ghost(Model):
    """A road user that the sensors reported although it does not exist, at one planning step."""

    step: int
    x_m: float
    y_m: float
    heading_rad: float
    length_m: float
    width_m: float


class Perceived(Model):
    """The planner's view of the other road users and of the ego's pose, for a run in an imperfect world.

    ``sightings`` are sorted by road user and step. A road user without an entry was never within 80 m of the ego. The
    ego's pose as the planner received it is stored for every planning step if it differed from the truth.
    """

    sightings: tuple[Sighting, ...] = ()
    ghosts: tuple[Ghost, ...] = ()
    ego_x_m: tuple[float, ...] = ()
    ego_y_m: tuple[float, ...] = ()
    ego_heading_rad: tuple[float, ...] = ()


def sightings_of(perceived: Perceived, obstacle_id: int) -> tuple[Sighting, ...]:
    """Return the sightings of one road user, in order of time."""
    return tuple(one for one in perceived.sightings if one.obstacle_id == obstacle_id)
