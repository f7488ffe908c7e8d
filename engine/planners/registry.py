"""Looks up planners and traffic by name, and imports heavy modules (numpy, C++ cores) only to create them.

User-supplied planners (``external``) are available together with the built-in ones; their code is imported on use.

To add a planner, add a function that creates it to ``PLANNERS``, and its ``PlannerTuning`` under the same name to
``engine/tuning/tunings.py``.
"""

import hashlib
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import TYPE_CHECKING, get_args

from ...schemas.errors import InvalidRequest, PlannerFailure, UnknownName, closest
from ...schemas.reviews import DriverModelName
from ...schemas.runs import Prediction
from ...schemas.runs import Traffic as TrafficMode
from ...schemas.worlds import PERFECT, World
from .external.found import Found, found_planners

if TYPE_CHECKING:
    from commonroad.planning.planning_problem import PlanningProblem

    from ..commonroad import LoadedScenario
    from ..vehicles import VehicleParameters
    from .external.command import ScenarioFile
    from .interface import Planner
    from .traffic.recorded import Traffic


def _frenetix() -> "Planner":
    from .frenetix.planner import Frenetix

    return Frenetix()


def _intelligent_driver() -> "Planner":
    from .idm import IntelligentDriver

    return IntelligentDriver()


def _radial_basis_primitives() -> "Planner":
    from .rbfn.planner import RadialBasisPrimitives

    return RadialBasisPrimitives()


def _iterative_search() -> "Planner":
    from .fiss.planner import Fiss

    return Fiss()


def _reference_driver(name: DriverModelName) -> "Callable[[], Planner]":
    def make() -> "Planner":
        from .reference_drivers.planner import reference_planner

        return reference_planner(name)

    return make


PLANNERS: dict[str, "Callable[[], Planner]"] = {
    "frenetix": _frenetix,
    "mp_rbfn": _radial_basis_primitives,
    "idm": _intelligent_driver,
    "fiss": _iterative_search,
    "r157_careful": _reference_driver("r157_careful"),
    "fsm": _reference_driver("fsm"),
    "rss": _reference_driver("rss"),
    "full_braking": _reference_driver("full_braking"),
    "keep_lane": _reference_driver("keep_lane"),
}


_IGNORE_OTHERS = frozenset({"full_braking", "keep_lane"})
"""Built-in planners that ignore other road users, so that no prediction can change their motion."""


def planner_names() -> tuple[str, ...]:
    """Return the available planners: the built-in planners, then the user's."""
    others = found_planners(PLANNERS).values()
    return (*PLANNERS, *(each.name for each in others if not each.fault))


def is_built_in(name: str) -> bool:
    """Return True if a planner is not user-supplied."""
    return known_planner(name) in PLANNERS


def refused_planners() -> tuple[str, ...]:
    """Return why user-supplied planners cannot be used, one sentence each."""
    return tuple(each.fault for each in found_planners(PLANNERS).values() if each.fault)


def known_planner(name: str) -> str:
    """Return a planner's registered name, ignoring case.

    Raises:
        UnknownName: There is no such planner.
    """
    folded = name.strip().lower().replace("-", "_")
    if folded not in PLANNERS:
        own_planner(name)
    return folded


def own_planner(name: str) -> Found:
    """Return the user-supplied planner with this name.

    Raises:
        UnknownName: There is no such planner.
        PlannerFailure: Its name is already taken.
    """
    found = found_planners(PLANNERS).get(name.strip().lower().replace("-", "_"))
    if found is None:
        names = planner_names()
        raise UnknownName(
            f"there is no planner '{name.strip()}'",
            valid=closest(name, names) or list(names),
            next_step="choose one of these, or install your own in the server's Python environment",
        )
    if found.fault:
        raise PlannerFailure(found.fault, reason="name_taken")
    return found


def make_planner(name: str, scenario: "ScenarioFile | None" = None) -> "Planner":
    """Return a new planner; a program planner gets the scenario's file.

    Raises:
        UnknownName: There is no such planner.
        PlannerFailure: A user-supplied planner cannot be created.
    """
    folded = known_planner(name)
    if folded in PLANNERS:
        return PLANNERS[folded]()
    found = own_planner(folded)
    if found.command is None:
        from .external.guarded import guarded

        return guarded(folded, found.own().make)
    if scenario is None:
        raise PlannerFailure(f"planner {folded} is a program and needs the scenario's file", reason="no_file")
    from .external.program import program_driver

    return program_driver(folded, found.command, scenario)


def needs_file(name: str) -> bool:
    """Return True if a planner is a program, which reads the scenario's file.

    Raises:
        UnknownName: There is no such planner.
    """
    folded = known_planner(name)
    return folded not in PLANNERS and own_planner(folded).command is not None


def planner_version(name: str) -> str:
    """Return a digest of a user-supplied planner's source; empty for built-in planners, which have our version."""
    folded = known_planner(name)
    return "" if folded in PLANNERS else own_planner(folded).version


CORES: dict[str, tuple[str, ...]] = {"frenetix": ("frenetix",), "fiss": ("fiss-planner",)}
"""The packages with the core of a built-in planner."""
_OURS = "plannerforge-mcp"


@dataclass(frozen=True)
class PlannerVersion:
    """The version of a planner: ``words`` for people, ``source``: a digest of the code that distinguishes versions.

    For a user's planner the digest covers its source, for a built-in one the versions of our package and of its core.
    """

    words: str
    source: str


def built_in_version(name: str, versions: Mapping[str, str]) -> PlannerVersion:
    """Return the version of a built-in planner, given the versions of packages by name."""
    named = [package for package in (*CORES.get(name, ()), _OURS) if package in versions]
    words = ", ".join(f"{package} {versions[package]}" for package in named)
    return PlannerVersion(words, hashlib.sha256(words.encode()).hexdigest()[:12])


def version_that_drives(name: str) -> PlannerVersion:
    """Return the version of the planner that currently has a name; only for workers, since it imports the class.

    Raises:
        UnknownName: There is no such planner.
        PlannerFailure: A user's planner cannot be imported.
    """
    folded = known_planner(name)
    if folded in PLANNERS:
        return _installed_version(folded)
    from .external.versions import version_in_words

    found = own_planner(folded)
    return PlannerVersion(version_in_words(found), found.version)


def source_that_drives(name: str) -> str:
    """Return the digest of :func:`version_that_drives`, without importing anything.

    Raises:
        UnknownName: There is no such planner.
    """
    folded = known_planner(name)
    return _installed_version(folded).source if folded in PLANNERS else own_planner(folded).version


def _installed_version(name: str) -> PlannerVersion:
    from importlib.metadata import version

    return built_in_version(name, {package: version(package) for package in (*CORES.get(name, ()), _OURS)})


def uses_prediction(name: str) -> bool:
    """Return True if a planner uses predictions: built-in planners that react to others, and external planners that
    declare it.
    """
    folded = known_planner(name)
    if folded in PLANNERS:
        return folded not in _IGNORE_OTHERS
    found = own_planner(folded)
    return (found.command or found.own().declaration).uses_prediction


def check_modes(traffic: TrafficMode, prediction: Prediction, world: World = PERFECT) -> None:
    """Refuse to give a planner the future of vehicles that have no future yet, or that its sensors cannot know.

    Raises:
        InvalidRequest: The prediction is ``ground_truth``, and the traffic is reactive or the world is imperfect.
    """
    others = [name for name in get_args(Prediction) if name != "ground_truth"]
    if world.hides_truth and prediction == "ground_truth":
        raise InvalidRequest(
            "prediction ground_truth is the recording itself, which the sensors of this world cannot know",
            valid=others,
            next_step="use one of these predictions, or leave out world",
        )
    if traffic == "reactive" and prediction == "ground_truth":
        raise InvalidRequest(
            "prediction ground_truth is the recording, which reactive traffic does not follow",
            valid=others,
            next_step="use one of these predictions, or traffic=recorded",
        )


def check_world(planner: str, world: World) -> None:
    """Refuse an imperfect world to a program that reads the whole recording before it plans.

    Raises:
        InvalidRequest: The planner is a program with the protocol one_shot.
        UnknownName: There is no such planner.
    """
    folded = known_planner(planner)
    if not world.hides_truth or folded in PLANNERS:
        return
    declared = own_planner(folded).command
    if declared is not None and declared.protocol == "one_shot":
        raise InvalidRequest(
            f"planner {folded} reads the scenario's file, which contains what its sensors would miss",
            valid=["a planner that is called at every step: protocol stepwise, or a Python class"],
            next_step="leave out world, or use one of these planners",
        )


def open_traffic(
    mode: TrafficMode, loaded: "LoadedScenario", problem: "PlanningProblem", vehicle: "VehicleParameters", seed: int
) -> "AbstractContextManager[Traffic]":
    """Yield the other road users of a scenario at the ego's first step, for a ``with`` block.

    Raises:
        NotPossible: No vehicle can react, since no lanelet is drivable.
        WorkerFailure: SUMO refused the network or a vehicle, or stopped.
    """
    if mode == "reactive":
        from .traffic.reactive import reactive_traffic

        return reactive_traffic(loaded, problem, vehicle, seed)
    from .traffic.recorded import RecordedTraffic

    return nullcontext(RecordedTraffic.of(loaded))
