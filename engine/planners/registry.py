"""The planners by name. Nothing is imported until a planner is made."""

from importlib import import_module
from typing import TYPE_CHECKING

from plannerforge.schemas.errors import UnknownName, closest

if TYPE_CHECKING:
    from plannerforge.engine.planners.interface import Planner

PLANNERS: dict[str, str] = {
    "frenetix": "plannerforge.engine.planners.frenetix:Frenetix",
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
    module, _, attribute = PLANNERS[known_planner(name)].partition(":")
    planner: Planner = getattr(import_module(module), attribute)()
    return planner
