"""Compose the prompts for the paper's tasks from the parts in ``parts/`` and the vocabularies of the schemas.

The five conditions are those of the paper (Methodology, Prompting Techniques): the task alone (``baseline``), the task
with context (``cp``), and the task with context and demonstrations (``icl``), reasoning steps (``cot``), or both.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from string import Template
from types import MappingProxyType
from typing import Final, Literal, get_args

from ..engine.cosimulation import presets as behaviour_presets
from ..engine.planners import PLANNERS
from ..engine.tuning import tuning_of
from ..engine.vehicles import vehicle_classes
from ..schemas.errors import UnknownName, closest
from ..schemas.generation import Density, ScenarioType
from ..schemas.modification import EditOperation
from ..schemas.text import cited, quoted
from ..schemas.vocabulary import FEATURES, MEASURES, OBSTACLE_TYPES, ROAD_NET_KEYS, TAGS

Task = Literal["generation", "selection", "modification", "routing", "tuning", "analysis", "session"]
Condition = Literal["baseline", "cp", "cp_cot", "cp_icl", "cp_icl_cot"]
TASKS: Final[tuple[Task, ...]] = get_args(Task)
CONDITIONS: Final[Mapping[Condition, tuple[str, ...]]] = MappingProxyType(
    {
        "baseline": ("Task",),
        "cp": ("Task", "Context"),
        "cp_cot": ("Task", "Context", "Reasoning"),
        "cp_icl": ("Task", "Context", "Demonstrations"),
        "cp_icl_cot": ("Task", "Context", "Demonstrations", "Reasoning"),
    }
)
"""The conditions with their parts, in reading order."""
DEFAULT_CONDITION: Final[Condition] = "cp_icl_cot"
_PLANNER = "frenetix"
_MOST_PLACES, _LONGEST_PLACE = 12, 60
"""How many places of a workspace a prompt lists, and the maximum length of each (chosen)."""


@dataclass(frozen=True)
class WorkspaceFacts:
    """Facts about a workspace for a prompt: places on its maps, and countries (ISO alpha-3) of its scenarios."""

    map_places: tuple[str, ...] = ()
    countries: tuple[str, ...] = ()


def system_prompt(task: str, condition: str, facts: WorkspaceFacts | None = None) -> str:
    """Return the system prompt of a task under a condition.

    Args:
        facts: the content of the workspace; without it, the prompt says where to look it up.

    Raises:
        UnknownName: there is no such task or condition.
    """
    if task not in TASKS:
        raise UnknownName(f"there is no task {quoted(task)}", valid=closest(task, TASKS))
    headings = next((parts for name, parts in CONDITIONS.items() if name == condition), None)
    if headings is None:
        raise UnknownName(f"there is no condition {quoted(condition)}", valid=tuple(CONDITIONS))
    parts = task_parts(task)
    filled = {**parts, "Context": Template(parts["Context"]).substitute(_words(facts or WorkspaceFacts()))}
    return "\n\n".join([filled["Task"], *(f"{heading}:\n{filled[heading]}" for heading in headings[1:])])


def task_parts(task: str) -> dict[str, str]:
    """Return the parts of a task's file by heading, with vocabulary still as ``$names``."""
    text = files(__package__).joinpath("parts", f"{task}.md").read_text(encoding="utf-8")
    sections = (section.partition("\n") for section in f"\n{text}".split("\n## ")[1:])
    return {heading.strip(): body.strip() for heading, _, body in sections}


def _words(facts: WorkspaceFacts) -> dict[str, str]:
    """Return the value of each ``$name`` in a part."""
    tuning = tuning_of(_PLANNER)
    return {
        "map_places": _places(facts.map_places),
        "countries": _places(facts.countries),
        "scenario_types": ", ".join(get_args(ScenarioType)),
        "densities": ", ".join(get_args(Density)),
        "vehicle_classes": ", ".join(vehicle_classes()),
        "tags": ", ".join(TAGS),
        "features": ", ".join(FEATURES),
        "measures": ", ".join(MEASURES),
        "road_net": ", ".join(key for key in ROAD_NET_KEYS if key != "lanes"),
        "obstacle_types": ", ".join(OBSTACLE_TYPES),
        "edit_ops": ", ".join(get_args(EditOperation)),
        "behaviours": ", ".join(sorted(behaviour_presets())),
        "planners": ", ".join(PLANNERS),
        "presets": ", ".join(preset.short_name for preset in tuning.presets.values()),
        "weights": "\n".join(f"- {weight.name}: {weight.raising}" for weight in tuning.weights.values()),
    }


def _places(names: Sequence[str]) -> str:
    """Return names of places in one line; they come from files, so each is shortened and kept on one line."""
    if not names:
        return "see describe_catalog"
    shown = [cited(name, _LONGEST_PLACE) for name in names[:_MOST_PLACES]]
    return ", ".join(shown) + (" and more (describe_catalog)" if len(names) > _MOST_PLACES else "")
