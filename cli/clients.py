"""The commands of clients: the demo, and the agent with its chat; the entry point is in ``cli/main.py``."""

from pathlib import Path
from typing import Annotated

import typer

from .flags import Workspace, settings_from
from .program import application

__all__ = ["application"]


Model = Annotated[str | None, typer.Option(help="ollama:MODEL, or openai:MODEL@URL.")]
Host = Annotated[str | None, typer.Option(help="Ollama's address; default: OLLAMA_HOST, or this machine.")]
Think = Annotated[str | None, typer.Option(help="Thinking before answers: auto, on or off.")]
ContextTokens = Annotated[int | None, typer.Option(help="Context that the model is asked with.")]
Tools = Annotated[str | None, typer.Option(help="Tools of the own server: auto, all or essential.")]
OtherServer = Annotated[str | None, typer.Option("--server", help="Command that starts another MCP server.")]
Url = Annotated[str | None, typer.Option(help="Address of an MCP server (streamable HTTP).")]
ShowThinking = Annotated[bool, typer.Option("--show-thinking", help="Print what the model thinks.")]


@application.command()
def agent(
    request: Annotated[str, typer.Argument(help="What is to be done, in plain words.")],
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
    """Have a language model carry out one request with the tools, and print what it does.

    Exit code 0: answered, 1: failed, 2: no model or server, 3: out of scope, 4: asked back, 130: interrupted.
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
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the chat that was begun last.")] = False,
    show_thinking: ShowThinking = False,
) -> None:
    """Talk with a language model that has the tools; Ctrl-C ends an answer, /quit leaves."""
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
    scenario: Annotated[Path | None, typer.Option(help="A CommonRoad file to begin with.")] = None,
    map_file: Annotated[
        Path | None, typer.Option("--map", help="An OpenStreetMap extract (.osm) to begin with.")
    ] = None,
    folder: Annotated[Path, typer.Option(help="Where the report, pictures and scenarios go.")] = Path("demo-output"),
) -> None:
    """Take a scenario through every stage with a real MCP client, and write a report."""
    from ..agent.demo import run_demo

    raise typer.Exit(run_demo(scenario=scenario, map_file=map_file, folder=folder))
