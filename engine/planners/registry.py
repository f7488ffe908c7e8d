"""The planners by name. Nothing is imported until a planner is made."""

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

from plannerforge.schemas.errors import UnknownName, closest

if TYPE_CHECKING:
    from plannerforge.engine.planners.interface import Planner


@dataclass(frozen=True)
class RegisteredPlanner:
    """Where a planner's class is and, in a module that imports nothing heavy, what can be set in it."""

    planner: str
    tuning: str


_IN = "plannerforge.engine"
PLANNERS: dict[str, RegisteredPlanner] = {
    "frenetix": RegisteredPlanner(f"{_IN}.planners.frenetix:Frenetix", f"{_IN}.tuning.frenetix_tuning:tuning"),
    "idm": RegisteredPlanner(f"{_IN}.planners.idm:IntelligentDriver", f"{_IN}.tuning.idm_tuning:tuning"),
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
