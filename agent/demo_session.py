"""A client session that shows every call it makes and remembers it for the report."""

import time
from dataclasses import dataclass, field
from typing import Any

from mcp import Client
from mcp.types import CallToolResult, TextContent

from plannerforge.agent.demo_console import DemoConsole
from plannerforge.schemas.errors import NotPossible


@dataclass(frozen=True)
class Step:
    """One call: what was asked, what came back, how long it took."""

    tool: str
    arguments: dict[str, Any]
    text: str
    structured: dict[str, Any]
    seconds: float
    refused: bool


@dataclass
class DemoSession:
    """Calls tools through a real client, and prints what it does."""

    client: Client
    console: DemoConsole
    steps: list[Step] = field(default_factory=list)

    async def ask(self, tool: str, arguments: dict[str, Any], *, quiet: bool = False) -> Step:
        """Make a call; a refusal is an answer too."""
        if not quiet:
            self.console.asks(tool, arguments)
        started = time.perf_counter()
        result = await self.client.call_tool(tool, arguments)
        step = Step(
            tool=tool,
            arguments=arguments,
            text=_text(result),
            structured=result.structured_content or {},
            seconds=time.perf_counter() - started,
            refused=bool(result.is_error),
        )
        self.steps.append(step)
        if not quiet:
            self.console.answers(step.text, step.seconds, refused=step.refused)
        return step

    async def must(self, tool: str, arguments: dict[str, Any]) -> Step:
        """Make a call that the rest of the demo needs.

        Raises:
            NotPossible: it was refused.
        """
        step = await self.ask(tool, arguments)
        if step.refused:
            raise NotPossible(f"the demo cannot go on: {step.text}")
        return step

    @property
    def seconds(self) -> float:
        """Time spent in calls."""
        return sum(step.seconds for step in self.steps)


def _text(result: CallToolResult) -> str:
    return "\n".join(block.text for block in result.content if isinstance(block, TextContent))
