"""The prompts: one per task an engineer comes with, text only (some hosts fail on anything else)."""

from dataclasses import dataclass

from mcp.types import GetPromptResult, Prompt, PromptArgument, PromptMessage, TextContent

from ..schemas.errors import InvalidRequest, UnknownName, closest
from ..schemas.text import one_line, quoted

_LONGEST = 1000
"""Characters of an argument that a prompt holds; chosen."""


@dataclass(frozen=True)
class _PromptSpec:
    """A prompt: its arguments (name → meaning and default; an empty default makes it required) and its text."""

    name: str
    title: str
    description: str
    arguments: dict[str, tuple[str, str]]
    text: str

    def description_for_clients(self) -> Prompt:
        """The prompt as a client lists it."""
        return Prompt(
            name=self.name,
            title=self.title,
            description=self.description,
            arguments=[
                PromptArgument(name=name, description=meaning, required=not default)
                for name, (meaning, default) in self.arguments.items()
            ],
        )


PROMPTS: tuple[_PromptSpec, ...] = (
    _PromptSpec(
        "compare_presets",
        "Compare two planner presets",
        "Run two presets on the same scenarios and say what got better",
        {
            "scenarios": ("what the scenarios should show, in words", ""),
            "preset_a": ("first preset", "Default"),
            "preset_b": ("second preset", "Safety-Conservative"),
        },
        "Find or generate scenarios that show: {scenarios}. Run Frenetix on them with preset {preset_a} and with "
        "preset {preset_b} in one run_planner call. Then use compare_results and tell me, with figures and run "
        "ids, which scenarios flipped each way, what got better, what got worse, and whether the "
        "difference is significant. Show a picture of one scenario that flipped.",
    ),
    _PromptSpec(
        "find_the_weak_spot",
        "Find a planner's weak spot",
        "Make a scenario harder step by step until the planner fails, and explain why",
        {"scenario": ("scenario id or description", ""), "config": ("configuration", "frenetix:Default")},
        "Take the scenario {scenario}. Describe it, then make it harder with one edit at a time (a cut-in, an "
        "aggressive follower, a slower lead vehicle, an added truck), running {config} after each edit, until the "
        "planner fails. Use analyze_results with detail timeline on the failing run and explain in three "
        "sentences why it failed, quoting the figures and the run id.",
    ),
    _PromptSpec(
        "explain_a_run",
        "Explain a run",
        "What happened in a run and which weight to change",
        {"run": ("run id", "latest_run")},
        "Explain the run {run}: its outcome, the seconds before the end, the cost terms that dominated, and which "
        "weight of which configuration you would change in which direction, and why. Quote figures from "
        "analyze_results only.",
    ),
)


def prompt_text(name: str, given: dict[str, str]) -> GetPromptResult:
    """A prompt with its arguments filled in.

    Raises:
        UnknownName: no such prompt or argument.
        InvalidRequest: a required argument is missing.
    """
    by_name = {prompt.name: prompt for prompt in PROMPTS}
    prompt = by_name.get(name)
    if prompt is None:
        raise UnknownName(f"there is no prompt {quoted(name)}", valid=closest(name, by_name))
    for argument in given:
        if argument not in prompt.arguments:
            raise UnknownName(f"the prompt {name} has no argument {quoted(argument)}", valid=prompt.arguments)
    values = {
        argument: one_line(given.get(argument, ""), _LONGEST) or default
        for argument, (_, default) in prompt.arguments.items()
    }
    missing = [argument for argument, value in values.items() if not value]
    if missing:
        raise InvalidRequest(f"the prompt {name} needs {', '.join(missing)}", valid=prompt.arguments)
    message = PromptMessage(role="user", content=TextContent(type="text", text=prompt.text.format(**values)))
    return GetPromptResult(description=prompt.description, messages=[message])
