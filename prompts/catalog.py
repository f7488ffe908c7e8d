"""The prompts of the server: complete workflows, and tasks under a condition of the study.

They contain only text, because some hosts fail on other content.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from mcp.types import GetPromptResult, Prompt, PromptArgument, PromptMessage, TextContent

from ..engine.planners import PLANNERS
from ..engine.tuning import tuning_of
from ..engine.workspace import ArtifactKind, Workspace
from ..schemas.errors import InvalidRequest, UnknownName, closest
from ..schemas.text import one_line, quoted
from .composition import CONDITIONS, DEFAULT_CONDITION, TASKS, Task, WorkspaceFacts, system_prompt

_LONGEST = 1000
"""The maximum length of an argument in a prompt, in characters (chosen)."""
_MOST_IDS = 1000
"""How many of the newest artifacts of a kind are offered as completions of an id (chosen)."""


@dataclass(frozen=True)
class _WholeTask:
    """A prompt: its arguments (by name, meaning and default; an empty default makes it required) and its text."""

    name: str
    title: str
    description: str
    arguments: dict[str, tuple[str, str]]
    text: str

    def description_for_clients(self) -> Prompt:
        """Return the prompt as a client lists it."""
        return Prompt(
            name=self.name,
            title=self.title,
            description=self.description,
            arguments=[
                PromptArgument(name=name, description=meaning, required=not default)
                for name, (meaning, default) in self.arguments.items()
            ],
        )


_WHOLE_TASKS: Final[tuple[_WholeTask, ...]] = (
    _WholeTask(
        "compare_presets",
        "Compare two planner presets",
        "Run two presets on the same scenarios and report what improved",
        {
            "scenarios": ("what the scenarios should show, in words", ""),
            "preset_a": ("first preset", "Default"),
            "preset_b": ("second preset", "Safety-Conservative"),
        },
        "Find or generate scenarios that show: {scenarios}. Run Frenetix on them with preset {preset_a} and with "
        "preset {preset_b} in one run_planner call. Then use compare_results and report, with figures and run "
        "ids, which scenarios flipped in each direction, what improved, what got worse, and whether the "
        "difference is significant. Show a picture of one scenario that flipped.",
    ),
    _WholeTask(
        "find_the_weak_spot",
        "Find a planner's weak spot",
        "Make a scenario harder step by step until the planner fails, and explain why",
        {"scenario": ("scenario id or description", ""), "config": ("configuration", "frenetix:Default")},
        "Take the scenario {scenario}. Describe it, then make it harder with one edit at a time (a cut-in, an "
        "aggressive follower, a slower lead vehicle, an added truck), running {config} after each edit, until the "
        "planner fails. Use analyze_results with detail timeline on the failing run and explain in three "
        "sentences why it failed, quoting the figures and the run id.",
    ),
    _WholeTask(
        "explain_a_run",
        "Explain a run",
        "What happened in a run, and which weight to change",
        {"run": ("run id", "latest_run")},
        "Explain the run {run}: its outcome, the seconds before the end, the dominant cost terms, and which "
        "weight of which configuration you would change in which direction, and why. Quote figures from "
        "analyze_results only.",
    ),
)


_TITLES: Final[dict[Task, tuple[str, str]]] = {
    "generation": ("Generate scenarios", "How to turn a request into scenarios from a map"),
    "selection": ("Find scenarios", "How to turn a request into a search of the catalogue"),
    "modification": ("Modify a scenario", "How to turn a request into edits of traffic or goal"),
    "routing": ("Choose the tool", "How to choose the tool for a request"),
    "tuning": ("Tune a planner", "How to turn a request into cost weights"),
    "analysis": ("Analyse runs", "How to run planners, explain runs and compare configurations"),
    "session": ("A whole session", "How to take an engineer from a scenario to a tuned planner"),
}
_TASK_ARGUMENTS: Final[dict[str, str]] = {
    "condition": f"{', '.join(CONDITIONS)}; default {DEFAULT_CONDITION}",
    "request": "what the user wants, in the user's words",
}


def listed_prompts() -> list[Prompt]:
    """Return all prompts as a client lists them: the paper's tasks, then complete tasks with blanks to fill in."""
    arguments = [PromptArgument(name=name, description=meaning) for name, meaning in _TASK_ARGUMENTS.items()]
    tasks = [
        Prompt(name=task, title=_TITLES[task][0], description=_TITLES[task][1], arguments=arguments) for task in TASKS
    ]
    return [*tasks, *(prompt.description_for_clients() for prompt in _WHOLE_TASKS)]


def prompt_text(name: str, given: dict[str, str], facts: WorkspaceFacts) -> GetPromptResult:
    """Return a prompt with its arguments filled in.

    Args:
        facts: the content of the workspace, for the prompts of tasks.

    Raises:
        UnknownName: there is no such prompt, argument or condition.
        InvalidRequest: a required argument is missing.
    """
    arguments = _arguments_of(name)
    for argument in given:
        if argument not in arguments:
            raise UnknownName(f"the prompt {name} has no argument {quoted(argument)}", valid=arguments)
    if name in TASKS:
        condition = one_line(given.get("condition", ""), _LONGEST) or DEFAULT_CONDITION
        request = one_line(given.get("request", ""), _LONGEST)
        text = system_prompt(name, condition, facts)
        return _message(_TITLES[name][1], f"{text}\n\nRequest: {request}" if request else text)
    prompt = next(prompt for prompt in _WHOLE_TASKS if prompt.name == name)
    values = {
        argument: one_line(given.get(argument, ""), _LONGEST) or default
        for argument, (_, default) in prompt.arguments.items()
    }
    missing = [argument for argument, value in values.items() if not value]
    if missing:
        raise InvalidRequest(f"the prompt {name} needs {', '.join(missing)}", valid=prompt.arguments)
    return _message(prompt.description, prompt.text.format(**values))


def completions(name: str, argument: str, typed: str, workspace: Workspace) -> list[str]:
    """Return the values of a prompt's argument that complete the typed text, ignoring case; empty for free text.

    Raises:
        UnknownName: there is no such prompt or argument.
    """
    arguments = _arguments_of(name)
    if argument not in arguments:
        raise UnknownName(f"the prompt {name} has no argument {quoted(argument)}", valid=arguments)
    values = _VALUES.get(argument, _no_values)(workspace)
    return [value for value in values if value.casefold().startswith(typed.casefold())]


def workspace_facts(workspace: Workspace, map_places: tuple[str, ...]) -> WorkspaceFacts:
    """Return the facts that prompts state about a workspace, with the places of the local maps."""
    from ..engine.catalog import is_ready, known_places  # the first answers do not need it

    connection = workspace.database.connection()
    countries = known_places(connection).countries if is_ready(connection) else ()
    return WorkspaceFacts(tuple(dict.fromkeys(map_places)), countries)


def _arguments_of(name: str) -> tuple[str, ...]:
    """Return the names of a prompt's arguments."""
    by_name = {task: tuple(_TASK_ARGUMENTS) for task in TASKS} | {
        prompt.name: tuple(prompt.arguments) for prompt in _WHOLE_TASKS
    }
    if name not in by_name:
        raise UnknownName(f"there is no prompt {quoted(name)}", valid=closest(name, by_name))
    return by_name[name]


def _message(description: str, text: str) -> GetPromptResult:
    message = PromptMessage(role="user", content=TextContent(type="text", text=text))
    return GetPromptResult(description=description, messages=[message])


def _presets(_: Workspace) -> list[str]:
    return list(tuning_of("frenetix").presets)


def _configurations(workspace: Workspace) -> list[str]:
    presets = [f"{planner}:{preset}" for planner in PLANNERS for preset in tuning_of(planner).presets]
    return [*presets, *_ids("config")(workspace)]


def _no_values(_: Workspace) -> list[str]:
    return []


def _ids(kind: ArtifactKind) -> Callable[[Workspace], list[str]]:
    """Return a function that lists the ids of a kind, newest first."""
    return lambda workspace: [found.artifact_id for found in workspace.newest(kind=kind, limit=_MOST_IDS)]


_VALUES: Final[dict[str, Callable[[Workspace], list[str]]]] = {
    "condition": lambda _: list(CONDITIONS),
    "preset_a": _presets,
    "preset_b": _presets,
    "config": _configurations,
    "scenario": _ids("scenario"),
    "run": _ids("run"),
}
"""Arguments with a list of values, by name. A name means the same in every prompt."""
