"""Instructions for a model: the agent's own text, the server's text, and an addition for small models."""

from importlib.resources import files

from ..prompts.composition import system_prompt as task_prompt

OUT_OF_SCOPE = "Out of scope:"
"""The start of an answer that refuses a topic outside the agent's task, as the instructions require."""
_SHORT = "Answer in at most three short sentences."


def own_instructions(condition: str = "none") -> str:
    """Return the agent's own text: its general rules, followed by the session prompt under a condition.

    Args:
        condition: A condition of the paper, or ``none`` for only the general rules, which fit any server.

    Raises:
        UnknownName: There is no such condition.
    """
    manners = files(__package__).joinpath("instructions.md").read_text(encoding="utf-8").strip()
    return manners if condition == "none" else f"{manners}\n\n{task_prompt('session', condition)}"


def system_prompt(server_instructions: str, *, short: bool, given: str = "") -> str:
    """Return the system message of a conversation.

    Args:
        server_instructions: The MCP server's instructions for its tools.
        short: True to request short answers, for models with a small context.
        given: A text that replaces the agent's own, such as a prompt condition of the evaluation.
    """
    parts = [
        given or own_instructions(),
        f"About the tools: {server_instructions.strip()}" if server_instructions.strip() else "",
    ]
    return "\n\n".join(part for part in [*parts, _SHORT if short else ""] if part)
