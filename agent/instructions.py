"""What a model is told before a conversation: the agent's own text, the server's, and what holds for small models."""

from importlib.resources import files

from ..prompts.composition import system_prompt as task_prompt

OUT_OF_SCOPE = "Out of scope:"
"""How an answer begins that refuses what is not the agent's business; the text asks for it."""
_SHORT = "Answer in at most three short sentences."


def own_instructions(condition: str = "none") -> str:
    """The agent's own text: its manners, and below them the prompt of a session under a condition.

    Args:
        condition: one of the paper's, or ``none`` for the manners alone, which hold for any server.

    Raises:
        UnknownName: there is no such condition.
    """
    manners = files(__package__).joinpath("instructions.md").read_text(encoding="utf-8").strip()
    return manners if condition == "none" else f"{manners}\n\n{task_prompt('session', condition)}"


def system_prompt(server_instructions: str, *, short: bool, given: str = "") -> str:
    """The system message of a conversation.

    Args:
        server_instructions: what the MCP server says about its tools.
        short: ask for short answers, for models with little room.
        given: a text in place of the agent's own, such as one of the evaluation's prompt conditions.
    """
    parts = [
        given or own_instructions(),
        f"About the tools: {server_instructions.strip()}" if server_instructions.strip() else "",
    ]
    return "\n\n".join(part for part in [*parts, _SHORT if short else ""] if part)
