"""What the demo prints: what it asks, what came back, how long it took."""

import json
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.padding import Padding
from rich.text import Text

SHOWN_LINES = 12


class DemoConsole:
    """Prints stages, questions and answers in plain words."""

    def __init__(self, console: Console | None = None) -> None:
        self.console = console or Console(highlight=False, width=min(Console().width, 118))
        self._stage = 0

    def stage(self, title: str, sentence: str) -> None:
        """Begin a stage of the work."""
        self._stage += 1
        self.console.print()
        self.console.rule(f"[bold]{self._stage}  {escape(title)}[/bold]", align="left")
        self.console.print(escape(sentence))

    def asks(self, tool: str, arguments: dict[str, Any]) -> None:
        """Show a call as it is sent."""
        shown = json.dumps(arguments, ensure_ascii=False)
        self.console.print(Text.assemble(("  ask   ", "bold cyan"), (tool, "cyan"), f" {shown}"))

    def answers(self, text: str, seconds: float, *, refused: bool = False) -> None:
        """Show the answer's text, its first lines, and the time it took."""
        label, style = ("  refused", "bold yellow") if refused else ("  answer", "bold green")
        self.console.print(Text.assemble((label, style), (f"  ({seconds:.2f} s)", "dim")))
        lines = text.strip().splitlines()
        body = "\n".join(lines[:SHOWN_LINES])
        if len(lines) > SHOWN_LINES:
            body += f"\n… {len(lines) - SHOWN_LINES} more lines"
        self.console.print(Padding(Text(body), (0, 0, 0, 4)))

    def says(self, sentence: str) -> None:
        """A sentence of the demo's own."""
        self.console.print(Text(f"  {sentence}", style="dim"))

    def ends(self, lines: list[str]) -> None:
        """The closing lines."""
        self.console.print()
        self.console.rule("[bold]Done[/bold]", align="left")
        for line in lines:
            self.console.print(Text(line))
