"""The clients and versions that are tried, one entry each."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Host:
    """A client of the protocol by another maker.

    Args:
        name: of its environment and its keys.
        title: its makers' spelling.
        installer: the installing program.
        packages: installed packages with versions; the first is the client itself.
        driver: the file in ``drivers/`` that uses it as its documentation shows.
        transports: the transports to try.
        help: the setting to try if the story fails without it, in its users' notation.
        help_settings: the variables of the server's process for it, if it is the server's.
        note: further advice for its users.
    """

    name: str
    title: str
    installer: Literal["pip", "npm"]
    packages: tuple[str, ...]
    driver: str
    transports: tuple[Literal["stdio", "http"], ...] = ("stdio", "http")
    help: str = ""
    help_settings: tuple[tuple[str, str], ...] = ()
    note: str = ""


HOSTS = (
    Host("fastmcp", "FastMCP client", "pip", ("fastmcp==4.2.3",), "fastmcp_driver.py"),
    Host(
        "langchain",
        "LangChain MCP adapters",
        "pip",
        ("langchain-mcp-adapters==0.3.2", "langchain==1.5.2", "langchain-openai==1.7.4", "mcp==1.30.0"),
        "langchain_driver.py",
        help="PLANNERFORGE_LINKS=false",
        help_settings=(("PLANNERFORGE_LINKS", "false"),),
        note="`client.get_tools()` starts a server for each call; the tools of a `client.session(…)` share one.",
    ),
    Host(
        "pydantic_ai",
        "Pydantic AI",
        "pip",
        ("pydantic-ai-slim[openai,mcp]==2.68.0", "mcp==2.3.0"),
        "pydantic_ai_driver.py",
        help='MCPToolset(…, tool_error_behavior="failed")',
        note="it waits 5 s for the start; `init_timeout` of the toolset allows more.",
    ),
    Host(
        "openai_agents",
        "OpenAI Agents SDK",
        "pip",
        ("openai-agents==0.24.0", "mcp==2.3.0"),
        "openai_agents_driver.py",
        note="it waits 5 s for an answer; `client_session_timeout_seconds` of the server allows more.",
    ),
    Host(
        "mcp_use",
        "mcp-use",
        "pip",
        ("mcp-use==1.7.1", "langchain-openai==1.7.4", "mcp==1.30.0"),
        "mcp_use_driver.py",
        note="it ends after 5 steps; `max_steps` of the agent allows more.",
    ),
    Host(
        "ollmcp",
        "ollmcp",
        "pip",
        ("ollmcp==0.35.1", "mcp==2.1.1"),
        "ollmcp_driver.py",
        note="it asks before each call (`/human-in-the-loop` turns that off) and after each seven (`/loop-limit`).",
    ),
    Host(
        "smolagents",
        "smolagents",
        "pip",
        ("smolagents[mcp]==1.26.0", "mcp[ws]==1.30.0"),
        "smolagents_driver.py",
        note="it needs `mcp[ws]` below 2, and keeps only an answer's structured content or first item.",
    ),
    Host(
        "inspector",
        "MCP Inspector (command line)",
        "npm",
        ("@modelcontextprotocol/inspector@2.12.0",),
        "inspector_driver.py",
    ),
    Host("typescript", "TypeScript SDK client", "npm", ("@modelcontextprotocol/client@2.4.0",), "typescript.mjs"),
    Host(
        "claude_code",
        "Claude Code",
        "npm",
        ("@anthropic-ai/claude-code@2.1.331",),
        "claude_code_driver.py",
        note="its model searches for tools; with `ENABLE_TOOL_SEARCH=false`, as here, it gets all of them.",
    ),
    Host(
        "codex",
        "Codex",
        "npm",
        ("@openai/codex@0.169.0",),
        "codex_driver.py",
        note="with `required = true` in its section, as here, the first request of `codex exec` waits for the server.",
    ),
)


def chosen_hosts(names: Sequence[str]) -> tuple[Host, ...]:
    """Return the clients with the given names, all by default.

    Raises:
        ValueError: a name is unknown; the message lists the valid ones.
    """
    known = [host.name for host in HOSTS]
    if unknown := sorted(set(names) - set(known)):
        raise ValueError(f"unknown client: {', '.join(unknown)}; valid are {', '.join(known)}")
    return tuple(host for host in HOSTS if not names or host.name in names)
