"""The planners by name. Nothing is imported until a planner is made."""

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

from ...schemas.errors import UnknownName, closest

if TYPE_CHECKING:
    from .interface import Planner


@dataclass(frozen=True)
class _RegisteredPlanner:
    """Where a planner's class is and, in a module that imports nothing heavy, what can be set in it."""

    planner: str
    tuning: str


PLANNERS: dict[str, _RegisteredPlanner] = {
    "frenetix": _RegisteredPlanner(
        "plannerforge.engine.planners.frenetix.planner:Frenetix", "plannerforge.engine.tuning:frenetix_tuning"
    ),
    "idm": _RegisteredPlanner(
        "plannerforge.engine.planners.idm:IntelligentDriver", "plannerforge.engine.tuning:idm_tuning"
    ),
}


def known_planner(name: str) -> str:
    """The name as registered, whatever its case.

    Raises:
        UnknownName: no such planner.
    """
    folded = name.strip().lower().replace("-", "_")
    if folded not in PLANNERS:
        raise UnknownName(
            f"there is no planner '{name}'",
            valid=closest(name, PLANNERS) or list(PLANNERS),
            next_step="call list_planners",
        )
    return folded


def make_planner(name: str) -> "Planner":
    """A new planner.

    Raises:
        UnknownName: no such planner.
    """
    module, _, attribute = PLANNERS[known_planner(name)].planner.partition(":")
    planner: Planner = getattr(import_module(module), attribute)()
    return planner
