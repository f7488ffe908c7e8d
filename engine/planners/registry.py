"""The planners by name. A planner's module, and with it numpy and the C++ core, is imported when one is made.

To add a planner, add a function that makes it to ``PLANNERS``, and its ``PlannerTuning`` under the same name to
``engine/tuning/tunings.py``.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

from ...schemas.errors import UnknownName, closest

if TYPE_CHECKING:
    from .interface import Planner


def _frenetix() -> "Planner":
    from .frenetix.planner import Frenetix

    return Frenetix()


def _intelligent_driver() -> "Planner":
    from .idm import IntelligentDriver

    return IntelligentDriver()


PLANNERS: dict[str, "Callable[[], Planner]"] = {"frenetix": _frenetix, "idm": _intelligent_driver}


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
    return PLANNERS[known_planner(name)]()
