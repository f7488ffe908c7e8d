"""The client commands: the demo, the agent and its chat. The entry point is in ``cli/main.py``."""

from pathlib import Path
from typing import Annotated

import typer

from .flags import Workspace, settings_from
from .program import application

__all__ = ["application"]


Model = Annotated[str | None, typer.Option(help="ollama:MODEL, or openai:MODEL@URL.")]
Host = Annotated[str | None, typer.Option(help="Ollama's address; default: OLLAMA_HOST or this machine.")]
Think = Annotated[str | None, typer.Option(help="Whether the model thinks before it answers: auto, on or off.")]
ContextTokens = Annotated[int | None, typer.Option(help="Size of the model's context, in tokens.")]
Tools = Annotated[str | None, typer.Option(help="Tools of PlannerForge's own server: auto, all or essential.")]
OtherServer = Annotated[str | None, typer.Option("--server", help="Command that starts another MCP server.")]
Url = Annotated[str | None, typer.Option(help="Address of an MCP server (streamable HTTP).")]
ShowThinking = Annotated[bool, typer.Option("--show-thinking", help="Print the model's thinking.")]


@application.command()
def agent(
    request: Annotated[str, typer.Argument(help="The task, in plain language.")],
    model: Model = None,
    host: Host = None,
    think: Think = None,
    context_tokens: ContextTokens = None,
    tools: Tools = None,
    server: OtherServer = None,
    url: Url = None,
    workspace: Workspace = None,
    show_thinking: ShowThinking = False,
) -> None:
    """Let a language model carry out one request with the tools, and print its steps.

    Exit code 0: answered, 1: failed, 2: no model or server, 3: out of scope, 4: asked a question, 130: interrupted.
    """
    from rich.console import Console

    from ..agent.settings import agent_settings
    from ..agent.terminal import run_request

    flags = {"model": model, "host": host, "think": think, "context_tokens": context_tokens, "tools": tools}
    settings = agent_settings(**flags, server=server, url=url)
    folder = settings_from(workspace=workspace).workspace.expanduser().resolve()
    console = Console(highlight=False)
    raise typer.Exit(run_request(settings, request, workspace=folder, console=console, show_thinking=show_thinking))


@application.command()
def chat(
    model: Model = None,
    host: Host = None,
    think: Think = None,
    context_tokens: ContextTokens = None,
    tools: Tools = None,
    server: OtherServer = None,
    url: Url = None,
    workspace: Workspace = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue the latest chat.")] = False,
    show_thinking: ShowThinking = False,
) -> None:
    """Chat with a language model that has the tools; Ctrl-C stops an answer, /quit leaves."""
    from rich.console import Console

    from ..agent.settings import agent_settings
    from ..agent.terminal import run_chat

    flags = {"model": model, "host": host, "think": think, "context_tokens": context_tokens, "tools": tools}
    settings = agent_settings(**flags, server=server, url=url)
    folder = settings_from(workspace=workspace).workspace.expanduser().resolve()
    console = Console(highlight=False)
    raise typer.Exit(run_chat(settings, workspace=folder, console=console, resume=resume, show_thinking=show_thinking))


@application.command()
def demo(
    scenario: Annotated[Path | None, typer.Option(help="The CommonRoad file to start with.")] = None,
    map_file: Annotated[
        Path | None, typer.Option("--map", help="The OpenStreetMap extract (.osm) to start with.")
    ] = None,
    folder: Annotated[Path, typer.Option(help="Folder for the report, pictures and scenarios.")] = Path("demo-output"),
) -> None:
    """Take a scenario through every stage with a real MCP client, and write a report."""
    from ..agent.demo import run_demo

    raise typer.Exit(run_demo(scenario=scenario, map_file=map_file, folder=folder))
