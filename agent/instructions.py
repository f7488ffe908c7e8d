"""What a model is told before a conversation: the agent's own text, the server's, and what holds for small models."""

from importlib.resources import files

OUT_OF_SCOPE = "Out of scope:"
"""How an answer begins that refuses what is not the agent's business; the text asks for it."""
_SHORT = "Answer in at most three short sentences."


def system_prompt(server_instructions: str, *, short: bool, given: str = "") -> str:
    """The system message of a conversation.

    Args:
        server_instructions: what the MCP server says about its tools.
        short: ask for short answers, for models with little room.
        given: a text in place of the agent's own, such as one of the evaluation's prompt conditions.
    """
    own = given or files(__package__).joinpath("instructions.md").read_text(encoding="utf-8").strip()
    parts = [own, f"About the tools: {server_instructions.strip()}" if server_instructions.strip() else ""]
    return "\n\n".join(part for part in [*parts, _SHORT if short else ""] if part)
