"""The options of each planner: weights, presets, and settings without effect.

This module imports nothing heavy, so that the server reads the tables without loading a planner. To add a planner, add
a ``PlannerTuning`` to ``TUNINGS`` under its name in ``engine/planners/registry.py``.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Literal, TypeVar

from ...schemas.errors import UnknownName, closest
from ...schemas.planning import PlannerDeclaration
from ...schemas.text import enumerated
from ..planners import known_planner, own_planner

LARGEST_WEIGHT = 1e6
"""Chosen: 200,000 times the largest weight of a preset, and far from where sums of costs lose digits."""


@dataclass(frozen=True)
class Weight:
    """One weight: a factor ≥ 0 on the raw value of a cost term, or a parameter of a planner without cost terms.

    ``raising`` describes the effect of a larger value. ``computed_by``: the C++ core, this program, or absent.
    ``of_cost``: True for a factor on a cost term of the driven plan, False for hard limits, desired distances, and
    values that affect only the search. ``term``: the recorded term that includes it, if the term has a different name.
    """

    name: str
    meaning: str
    raising: str
    computed_by: Literal["core", "ours", "absent"]
    lowest: float = 0.0
    highest: float = LARGEST_WEIGHT
    of_cost: bool = True
    term: str = ""

    @property
    def acts(self) -> bool:
        """True if the weight affects the driven motion."""
        return self.computed_by != "absent"


@dataclass(frozen=True)
class Preset:
    """A full set of weights by name, in order.

    ``short_name`` is the name in the paper's comparison figure.
    """

    name: str
    short_name: str
    intent: str
    weights: dict[str, float]


@dataclass(frozen=True)
class PlannerTuning:
    """The weights, presets and settings that a planner offers for tuning, by name.

    ``external`` weights are stored but have no effect. ``first_preset`` is the preset used if only the planner's name
    is given. ``idle_settings`` have no effect on this planner.
    """

    summary: str
    weights: Mapping[str, Weight]
    external: Mapping[str, Weight]
    presets: Mapping[str, Preset]
    first_preset: str = "Default"
    idle_settings: tuple[str, ...] = ()

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        """The ranges of the weights that have a range other than 0 to 1e6, by name."""
        ranges = {name: (weight.lowest, weight.highest) for name, weight in self.weights.items()}
        return {name: limits for name, limits in ranges.items() if limits != (0.0, LARGEST_WEIGHT)}

    def preset(self, word: str, planner: str = "this planner") -> Preset:
        """Return a preset of the planner by its name, short name or usual synonym, ignoring case.

        Raises:
            UnknownName: There is no such preset; the error lists the names, likeliest first.
        """
        folded = word.strip().lower()
        for preset in self.presets.values():
            words = (preset.name.lower(), preset.short_name.lower(), *_PRESET_WORDS.get(preset.short_name, ()))
            if folded in words:
                return preset
        likely = closest(word, self.presets)
        others = [name for name, tuning in TUNINGS.items() if tuning is not self and tuning.has_preset(folded)]
        elsewhere = f"; {enumerated(others)} {'has' if len(others) == 1 else 'have'} one" if others else ""
        raise UnknownName(
            f"{planner} has no preset '{word}'{elsewhere}",
            valid=[*likely, *(name for name in self.presets if name not in likely)],
            next_step=f"choose one of these{', or set weights with configure_planner' if self.weights else ''}",
        )

    def has_preset(self, folded: str) -> bool:
        """Return whether a preset has this name or short name, in lower case."""
        return any(folded in (preset.name.lower(), preset.short_name.lower()) for preset in self.presets.values())


_PRESET_WORDS = MappingProxyType(
    {
        "Default": ("reset",),
        "Comfort": ("comfortable",),
        "Balanced": ("balance",),
        "Sporty": ("efficiency", "efficient"),
        "Safety": ("conservative", "careful", "safe"),
        "Cautious": ("careful", "defensive"),
    }
)
"""Synonyms for presets in the prompts of the paper's released code."""
_Named = TypeVar("_Named", Weight, Preset)


def tuning_of(planner: str) -> PlannerTuning:
    """Return the options of a planner.

    Raises:
        UnknownName: There is no such planner.
        PlannerFailure: A user-supplied planner cannot be imported.
    """
    name = known_planner(planner)
    return TUNINGS[name] if name in TUNINGS else _declared(own_planner(name).declaration)


def _declared(declaration: PlannerDeclaration) -> PlannerTuning:
    """Return the options that a user-supplied planner declares."""
    defaults = {name: weight.default for name, weight in declaration.weights.items()}
    weights = {
        name: Weight(
            name,
            weight.meaning,
            weight.raising or "as declared",
            "ours",
            weight.lowest,
            weight.highest,
            of_cost=weight.kind == "weight",
        )
        for name, weight in declaration.weights.items()
    }
    presets = {"Default": Preset("Default", "Default", "its defaults", defaults)} | {
        name: Preset(name, name, preset.intent or "as declared", defaults | preset.weights)
        for name, preset in declaration.presets.items()
    }
    return PlannerTuning(declaration.summary, weights, {}, presets, idle_settings=("search",))


def _preset(weights: tuple[Weight, ...], name: str, short_name: str, intent: str, values: tuple[float, ...]) -> Preset:
    by_name = {weight.name: value for weight, value in zip(weights, values, strict=True)}
    return Preset(name, short_name, intent, by_name)


def _by_name(entries: tuple[_Named, ...]) -> dict[str, _Named]:
    return {entry.name: entry for entry in entries}


_COST_WEIGHTS = (
    Weight("acceleration", "integral of acceleration² (Simpson)", "gentler speed changes", "core"),
    Weight("jerk", "integral of total jerk²", "smoother acceleration", "core"),
    Weight("lateral_jerk", "√(integral of lateral jerk²) over the first 0.1 s", "smoother steering", "core"),
    Weight(
        "longitudinal_jerk",
        "√(integral of longitudinal jerk²) over the first 0.1 s",
        "smoother acceleration and braking",
        "core",
    ),
    Weight(
        "orientation_offset",
        "heading offset from the path, over the candidate's second half and at its end",
        "heading closer to the path's",
        "core",
    ),
    Weight("path_length", "length of the candidate in m", "shorter, slower candidates", "ours"),
    Weight(
        "lane_center_offset",
        "mean distance to the lane's centre, 5 m where there is no lane",
        "closer to the lane's centre",
        "ours",
    ),
    Weight("velocity_offset", "norm of speed − desired speed", "closer to the desired speed", "core"),
    Weight(
        "velocity", "|mean speed − speed that reaches the goal in time|", "arrival closer to the goal's time", "ours"
    ),
    Weight(
        "distance_to_reference_path",
        "norm of the offset over the candidate's second half",
        "closer to the path",
        "core",
    ),
    Weight(
        "distance_to_obstacles",
        "Σ 1 / smallest distance², with others assumed stationary",
        "farther from others",
        "core",
    ),
    Weight(
        "prediction",
        "1,000 × probability of a collision with predicted road users",
        "farther from predicted motion",
        "core",
    ),
    Weight(
        "responsibility",
        "nearness to road users that the ego must keep clear of",
        "stricter lane keeping, distances and giving way",
        "ours",
    ),
)
"""The thirteen weights of Frenetix in the order of the paper, with the meanings of its released code.

The C++ core computes nine of the terms; ours are in ``engine/planners/frenetix/costs.py``.
"""
_EXTERNAL_WEIGHTS = (
    Weight("occ_pm", "occlusion phantom module: harm to an unseen pedestrian", "module absent", "absent"),
    Weight("occ_um", "occlusion uncertainty module: distance to its map", "module absent", "absent"),
    Weight("occ_ve", "occlusion visibility estimator: shift to see more", "module absent", "absent"),
)
"""Weights of occlusion modules that are not part of this planner: stored and written, but without effect."""
_FRENETIX_PRESETS = (
    _preset(
        _COST_WEIGHTS,
        "Default",
        "Default",
        "the released code's tuning: follow the path, keep the speed",
        (0.0, 0.0, 0.2, 0.2, 0.0, 0.0, 0.0, 1.0, 0.0, 5.0, 0.0, 0.2, 0.0),
    ),
    _preset(
        _COST_WEIGHTS,
        "Comfort",
        "Comfort",
        "gentle: jerk and acceleration count most",
        (0.2, 0.2, 0.8, 0.8, 0.0, 0.0, 0.5, 0.3, 0.0, 1.0, 0.3, 0.2, 0.1),
    ),
    _preset(
        _COST_WEIGHTS,
        "Balanced",
        "Balanced",
        "between the others",
        (0.3, 0.3, 0.5, 0.5, 0.1, 0.2, 0.7, 0.6, 0.2, 2.0, 0.8, 0.3, 0.2),
    ),
    _preset(
        _COST_WEIGHTS,
        "Efficiency-Sporty",
        "Sporty",
        "brisk: speed and progress count more than comfort",
        (0.2, 0.15, 0.25, 0.25, 0.2, 0.6, 0.6, 1.0, 0.4, 2.0, 0.6, 0.2, 0.1),
    ),
    _preset(
        _COST_WEIGHTS,
        "Safety-Conservative",
        "Safety",
        "like Default, but distance to others, prediction and responsibility count more",
        (0.0, 0.0, 0.2, 0.2, 0.0, 0.0, 0.0, 1.0, 0.0, 5.0, 1.0, 0.5, 0.3),
    ),
)
"""The paper names the presets; the values are those of its released code."""

_CHANNELS = (
    Weight("distance_to_reference_path", "mean offset from the path / 3 m", "closer to the path", "ours"),
    Weight("distance_to_reference_path_final", "final offset from the path / 3 m", "ends closer to the path", "ours"),
    Weight("velocity_offset_final", "(final − desired speed)² / (5 m/s)²", "closer to the desired speed", "ours"),
    Weight("orientation_offset", "mean (heading − path)² / (0.5 rad)²", "heading closer to the path's", "ours"),
    Weight(
        "orientation_offset_final", "final (heading − path)² / (0.5 rad)²", "final heading closer to the path's", "ours"
    ),
    Weight(
        "prediction", "Σ 1 / Mahalanobis distance² to predicted road users", "farther from predicted motion", "ours"
    ),
    Weight("distance_to_boundary", "mean 1 / clearance² to the road's edge", "farther from the road's edge", "ours"),
)
"""The seven channels of MP-RBFN by the names of its public copy, normalised in ``engine/planners/rbfn/costs.py``."""
_CHANNEL_PRESETS = (
    _preset(_CHANNELS, "Default", "Default", "follow the path, keep the speed", (0.6, 0.3, 0.8, 0.1, 0.1, 0.3, 0.1)),
    _preset(_CHANNELS, "Comfort", "Comfort", "speed counts less, heading more", (0.4, 0.2, 0.3, 0.6, 0.4, 0.3, 0.1)),
    _preset(_CHANNELS, "Balanced", "Balanced", "between the others", (0.5, 0.3, 0.5, 0.3, 0.2, 0.4, 0.2)),
    _preset(
        _CHANNELS,
        "Efficiency-Sporty",
        "Sporty",
        "the desired speed counts most, the path less",
        (0.3, 0.2, 1.0, 0.1, 0.1, 0.2, 0.05),
    ),
    _preset(
        _CHANNELS,
        "Safety-Conservative",
        "Safety",
        "keep away from predicted road users and the road's edge",
        (0.6, 0.3, 0.5, 0.1, 0.1, 0.9, 0.4),
    ),
)
"""The paper names the presets but prints no values for this planner; the values are ours."""

_IDM_PARAMETERS = (
    Weight("time_headway_s", "desired time gap T to the leader, s", "larger following distance", "ours", 0.1, 10.0),
    Weight("minimum_gap_m", "gap s0 at standstill, m", "longer gaps to others at standstill", "ours", 0.1, 30.0),
    Weight("acceleration_mps2", "maximum acceleration a, m/s²", "brisker, reaches its speed sooner", "ours", 0.1, 10.0),
    Weight("deceleration_mps2", "comfortable deceleration b, m/s²", "later and harder braking", "ours", 0.1, 10.0),
    Weight(
        "lateral_acceleration_mps2",
        "maximum lateral acceleration in curves, m/s²",
        "faster through curves",
        "ours",
        0.5,
        10.0,
    ),
)
_IDM_PRESETS = (
    _preset(_IDM_PARAMETERS, "Default", "Default", "the values in the model's paper", (1.6, 2.0, 0.73, 1.67, 3.0)),
    _preset(_IDM_PARAMETERS, "Cautious", "Cautious", "large gaps, gentle", (2.4, 4.0, 0.6, 1.2, 2.0)),
    _preset(_IDM_PARAMETERS, "Sporty", "Sporty", "small gaps, brisk", (1.0, 1.5, 2.0, 3.0, 4.0)),
)
"""Default has the values of the model's source (Treiber, Hennecke, Helbing: Congested traffic states in empirical
observations and microscopic simulations, Physical Review E 62, 2000, table I); Cautious and Sporty are ours. The three
lateral accelerations are those that passengers rated on a test track (Optimal Lateral Acceleration for Different Levels
of Automated Driving, preprint 10.31234/osf.io/kcw2d): 2 m/s² often too slow, 3 balanced, 4 often too fast.
"""

_parameter = partial(Weight, of_cost=False)
_FISS_WEIGHTS = (
    Weight("time", "horizon − duration, s", "longer plans", "core"),
    Weight("speed", "(final − desired or following speed)²", "closer to the desired speed", "core"),
    Weight("acceleration", "mean acceleration², along and across", "gentler speed changes", "core"),
    Weight("jerk", "mean jerk², along and across", "smoother", "core"),
    Weight("lateral", "(final offset from the lane's centre)²", "ends closer to the lane's centre", "core"),
    Weight("lane_change", "lanes changed", "fewer lane changes", "core"),
    Weight("route", "1 if the lane is not on the route", "closer to its route", "ours", term="lane_change"),
    _parameter(
        "history",
        "squared distance to the previous end state, for the first guess",
        "search nearer to the previous result",
        "core",
    ),
    Weight("headway", "mean (1 − gap / desired gap)² ahead", "larger gaps ahead", "core", term="proximity"),
    Weight(
        "time_to_collision",
        "mean (1 − time to collision / desired time)² ahead",
        "earlier slowing for others",
        "core",
        term="proximity",
    ),
    Weight(
        "clearance",
        "mean (1 − lateral gap / desired)² alongside",
        "passes others farther away",
        "core",
        term="proximity",
    ),
    _parameter("desired_gap_m", "desired gap at standstill, m", "stops farther behind others", "core", 0.1, 30.0),
    _parameter("desired_headway_s", "desired time gap ahead, s", "larger following distance", "core", 0.0, 10.0),
    _parameter(
        "desired_time_to_collision_s", "desired time to collision, s", "earlier slowing for others", "core", 0.1, 30.0
    ),
    _parameter("desired_clearance_m", "desired lateral gap, m", "passes others farther away", "core", 0.1, 10.0),
    _parameter(
        "follow_time_s",
        "time to reach the desired gap, s; 0: never drives slower than the leader",
        "closes up more slowly",
        "core",
        0.0,
        30.0,
    ),
    _parameter("least_gap_m", "smallest gap ahead, m; hard limit", "rejects closer following", "core", 0.0, 30.0),
    _parameter(
        "least_headway_s", "smallest time gap ahead, s; hard limit", "rejects closer following", "core", 0.0, 10.0
    ),
    _parameter(
        "least_time_to_collision_s",
        "smallest time to collision, s; hard limit",
        "rejects candidates that close in fast",
        "core",
        0.0,
        30.0,
    ),
    _parameter("reaction_time_s", "grace period after a cut-in, s", "hard limits apply later", "core", 0.0, 5.0),
    _parameter(
        "crossing_gap_s", "smallest time to crossing traffic, s; hard limit", "waits for larger gaps", "core", 0.0, 5.0
    ),
)
"""The available weights and distances of FISS's core; meanings from its documentation, defaults of version 1.0.0."""
_KEPT = (10.0, 5.0, 5.0, 3.0, 1.5, 4.0, 1.0, 3.0, 2.0, 0.3, 1.5, 0.5, 0.75)
_NOT_KEPT = (0.0, 0.0, 0.0, 3.0, 1.5, 4.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.0)
_FISS_DEFAULT = (1.0, 1.0, 0.1, 0.1, 2.0, 5.0, 10.0, 1.0, *_KEPT)
_FISS_PRESETS = (
    _preset(_FISS_WEIGHTS, "Default", "Default", "its authors' defaults", _FISS_DEFAULT),
    _preset(
        _FISS_WEIGHTS,
        "Plain",
        "Plain",
        "without keeping a distance, as in its papers: only collisions count",
        (1.0, 1.0, 0.1, 0.1, 2.0, 5.0, 10.0, 1.0, *_NOT_KEPT),
    ),
)
"""Plain: called "without the safety envelope and proximity cost" in its authors' ablations."""
_FOLLOWING = (
    Weight(
        "follows",
        "1: drives to the goal and keeps its distance like idm; 0: keeps its initial speed",
        "drives to the goal whenever its model does not intervene",
        "ours",
        0.0,
        1.0,
    ),
    Weight("time_headway_s", "desired time gap to the leader, s", "larger following distance", "ours", 0.1, 10.0),
)
"""The behaviour of a reference driver while its model does not react."""
_CAREFUL = (
    *_FOLLOWING,
    Weight("wandering_m", "lateral motion that is noticed, m", "notices a cut-in later", "ours", 0.05, 2.0),
    Weight("perception_s", "risk perception, s", "reacts later", "ours", 0.0, 3.0),
    Weight("delay_s", "time from the decision to braking, s", "brakes later", "ours", 0.0, 3.0),
    Weight("critical_ttc_s", "critical time to collision, s", "brakes earlier", "ours", 0.5, 10.0),
    Weight("critical_thw_s", "critical time headway, s", "brakes earlier", "ours", 0.5, 10.0),
    Weight("hard_mps2", "leader's deceleration that is noticed, m/s²", "notices braking later", "ours", 0.5, 10.0),
)
_FUZZY = (
    *_FOLLOWING,
    Weight("response_s", "response time, s", "reacts later", "ours", 0.0, 3.0),
    Weight("gentle_mps2", "comfortable braking, m/s²", "brakes later", "ours", 0.5, 9.0),
    Weight("hard_mps2", "hardest braking, m/s²", "later and harder braking", "ours", 0.5, 9.0),
    Weight("front_mps2", "deceleration expected of the leader, m/s²", "brakes earlier", "ours", 0.5, 10.0),
    Weight("standstill_m", "gap when standing, m", "stops earlier", "ours", 0.0, 10.0),
    Weight("margin_m", "margin of the safe distance, m", "brakes earlier", "ours", 0.0, 10.0),
)
_RSS = (
    *_FOLLOWING,
    Weight("response_s", "response time ρ, s", "reacts later", "ours", 0.0, 3.0),
    Weight("own_mps2", "its own assumed deceleration, m/s²", "smaller safe distance", "ours", 0.5, 9.0),
    Weight("front_mps2", "leader's hardest deceleration, m/s²", "larger safe distance", "ours", 0.5, 10.0),
    Weight("across_mps2", "lateral acceleration of others, m/s²", "changes the lateral gap", "ours", 0.1, 5.0),
    Weight("fluctuation_m", "lateral fluctuation µ, m", "larger lateral gap", "ours", 0.0, 2.0),
)


def _reference(weights: tuple[Weight, ...], values: tuple[float, ...], summary: str) -> "PlannerTuning":
    """Return the tuning of a reference driver: its source's parameters, with and without following others."""
    presets = (
        _preset(
            weights, "Default", "Default", "parameters of its source; follows others like idm", (1.0, 2.0, *values)
        ),
        _preset(
            weights,
            "Verdict",
            "Verdict",
            "as in verdicts on collisions: keeps its speed until it sees a danger",
            (0.0, 2.0, *values),
        ),
    )
    return PlannerTuning(summary, _by_name(weights), {}, _by_name(presets), idle_settings=_PATH_FOLLOWERS_IGNORE)


_PATH_FOLLOWERS_IGNORE = ("sampling_level", "search")
"""Settings without effect in planners that follow the reference path."""
_NO_PARAMETERS = {"Default": Preset("Default", "Default", "no parameters", {})}

TUNINGS = {
    "frenetix": PlannerTuning(
        summary="sampling planner from TUM",
        weights=_by_name(_COST_WEIGHTS),
        external=_by_name(_EXTERNAL_WEIGHTS),
        presets=_by_name(_FRENETIX_PRESETS),
        idle_settings=("search",),
    ),
    "mp_rbfn": PlannerTuning(
        summary="learned motion primitives (radial basis functions); network and preset weights from PlannerForge",
        weights=_by_name(_CHANNELS),
        external={},
        presets=_by_name(_CHANNEL_PRESETS),
        idle_settings=("search",),
    ),
    "idm": PlannerTuning(
        summary="lane-following Intelligent Driver Model, a baseline; no cost terms",
        weights=_by_name(_IDM_PARAMETERS),
        external={},
        presets=_by_name(_IDM_PRESETS),
        idle_settings=_PATH_FOLLOWERS_IGNORE,
    ),
    "fiss": PlannerTuning(
        summary="fast iterative search over sampled end states; search=0 (FOP) and 1 (FOP+) examine all of them",
        weights=_by_name(_FISS_WEIGHTS),
        external={},
        presets=_by_name(_FISS_PRESETS),
    ),
    "r157_careful": _reference(
        _CAREFUL,
        (0.375, 0.4, 0.75, 2.0, 2.0, 5.0),
        "reference driver: the careful and competent human driver of UN regulation R157",
    ),
    "fsm": _reference(
        _FUZZY, (0.75, 4.0, 6.0, 7.0, 2.0, 2.0), "reference driver: the fuzzy safety model of UN regulation R157"
    ),
    "rss": _reference(_RSS, (0.75, 4.0, 8.0, 1.0, 0.3), "reference driver: Responsibility-Sensitive Safety"),
    "full_braking": PlannerTuning(
        "reference driver: brakes fully from the start", {}, {}, _NO_PARAMETERS, idle_settings=_PATH_FOLLOWERS_IGNORE
    ),
    "keep_lane": PlannerTuning(
        "reference driver: always keeps its lane and speed",
        {},
        {},
        _NO_PARAMETERS,
        idle_settings=_PATH_FOLLOWERS_IGNORE,
    ),
}
"""The planners by name, as in ``engine/planners/registry.py``."""
