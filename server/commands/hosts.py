"""``plannerforge install HOST``: write, or print, the settings by which a host starts this server.

A host's file is written with a backup beside it, keeps all else that is in it, and is left alone where it has the
entry already. A file that is not plain JSON (comments, trailing commas) is not touched: what belongs there is printed.
"""

import json
import shutil
import sys
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, count
from pathlib import Path
from typing import Any

import typer

from ...schemas.errors import InvalidRequest, ResourceFailure, UnknownName, closest

NAME = "plannerforge"
BACKUP = ".before-plannerforge"
"""Ending of the copy of a host's file as it was before."""


@dataclass(frozen=True)
class Host:
    """Where a host keeps its MCP servers, and how it writes one down.

    ``path``: of its settings file from the home folder; ``mac``: there, where it is another one; ``key``: the table of
    servers in it; ``extra``: what its entries hold beside command and arguments; ``then``: what makes it read the file.
    """

    title: str
    path: str
    key: str
    mac: str = ""
    extra: tuple[tuple[str, str], ...] = ()
    then: str = "restart it"

    def file(self, home: Path, platform: str) -> Path:
        """Its settings file, for a home folder and a platform as ``sys.platform`` has it."""
        return home / (self.mac if self.mac and platform == "darwin" else self.path)

    def entry(self, command: Sequence[str]) -> dict[str, Any]:
        """The server as this host writes it."""
        return {**dict(self.extra), "command": command[0], "args": list(command[1:])}


_STDIO = (("type", "stdio"),)
_SUPPORT = "Library/Application Support"
HOSTS: dict[str, Host] = {
    "claude-desktop": Host(
        "Claude Desktop",
        ".config/Claude/claude_desktop_config.json",
        "mcpServers",
        mac=f"{_SUPPORT}/Claude/claude_desktop_config.json",
    ),
    "claude-code": Host("Claude Code", ".claude.json", "mcpServers", extra=_STDIO, then="begin a session"),
    "vscode": Host(
        "VS Code",
        ".config/Code/User/mcp.json",
        "servers",
        mac=f"{_SUPPORT}/Code/User/mcp.json",
        extra=_STDIO,
        then="run its command 'MCP: List Servers' and start the server there",
    ),
    "cursor": Host("Cursor", ".cursor/mcp.json", "mcpServers"),
    "windsurf": Host("Windsurf", ".codeium/windsurf/mcp_config.json", "mcpServers"),
    "codex": Host("Codex", ".codex/config.toml", "mcp_servers", then="begin a session"),
    "gemini": Host("Gemini CLI", ".gemini/settings.json", "mcpServers", then="begin a session"),
    "zed": Host("Zed", ".config/zed/settings.json", "context_servers", then="look at its list of servers"),
}


def named_host(name: str) -> Host:
    """The host of that name, whatever its case.

    Raises:
        UnknownName: no such host.
    """
    folded = name.strip().lower().replace(" ", "-").replace("_", "-")
    if folded not in HOSTS:
        raise UnknownName(f"there is no host '{name}'", valid=closest(name, HOSTS) or list(HOSTS))
    return HOSTS[folded]


def start_command(arguments: Sequence[str]) -> tuple[str, ...]:
    """Program and arguments that start this server from anywhere: absolute, since hosts have a PATH of their own."""
    script = Path(sys.executable).with_name("plannerforge")
    program = (str(script),) if script.is_file() else (sys.executable, "-P", "-m", "plannerforge")
    return (*program, "serve", *arguments)


def install(host: Host, command: Sequence[str], *, home: Path, print_only: bool = False) -> int:
    """Write the server into a host's settings, or print what belongs there; 0 where nothing is left to do by hand.

    Raises:
        ResourceFailure: the file cannot be read or written.
        InvalidRequest: it holds something else where the servers belong.
    """
    path = host.file(home, sys.platform)
    text = _text(path)
    entry = host.entry(command)
    snippet = _toml(host, entry) if path.suffix == ".toml" else json.dumps({host.key: {NAME: entry}}, indent=2)
    if print_only:
        typer.echo(snippet)
        return 0
    known, readable = _known(host, path, text)
    if not readable:
        typer.echo(f"{path} is no plain {path.suffix[1:].upper()} and is left alone; put this into it:", err=True)
        typer.echo(snippet)
        return 1
    if known is not None and all(known.get(name) == value for name, value in entry.items()):
        typer.echo(f"{host.title} has plannerforge already ({path}).")
        return 0
    if known is not None and path.suffix == ".toml":
        raise InvalidRequest(
            f"{path} has a section [{host.key}.{NAME}] that says otherwise",
            valid=[line for line in snippet.splitlines() if line],
            next_step="put these lines in its place",
        )
    backup = _written(path, _with_entry(host, path, text, entry, snippet))
    typer.echo(f"{host.title}: plannerforge is in {path} now" + (f" (as it was: {backup})" if backup else ""))
    typer.echo(f"Next: {host.then}.")
    return 0


def has_server(host: Host, home: Path) -> tuple[Path, dict[str, Any] | None]:
    """A host's settings file, and the entry of this server in it; None where there is none.

    Raises:
        ResourceFailure: the file cannot be read.
    """
    path = host.file(home, sys.platform)
    known, _ = _known(host, path, _text(path))
    return path, known


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8") if path.is_file() else ""
    except (OSError, UnicodeDecodeError) as error:
        raise ResourceFailure(f"{path} cannot be read: {error}", next_step="use --print") from error


def _known(host: Host, path: Path, text: str) -> tuple[dict[str, Any] | None, bool]:
    """The entry that a file has, and whether the file can be read at all."""
    try:
        whole = tomllib.loads(text) if path.suffix == ".toml" else json.loads(text or "{}")
    except (tomllib.TOMLDecodeError, json.JSONDecodeError):
        return None, False
    servers = whole.get(host.key, {}) if isinstance(whole, dict) else None
    if not isinstance(servers, dict):
        raise InvalidRequest(
            f"{path} holds no table of servers under '{host.key}'", next_step="mend it, or use --print"
        )
    known = servers.get(NAME)
    return (known if isinstance(known, dict) else None), True


def _with_entry(host: Host, path: Path, text: str, entry: dict[str, Any], snippet: str) -> str:
    if path.suffix == ".toml":
        return f"{text.rstrip()}\n\n{snippet}" if text.strip() else snippet
    whole = json.loads(text or "{}")
    servers = whole.setdefault(host.key, {})
    servers[NAME] = {**servers.get(NAME, {}), **entry}
    return json.dumps(whole, indent=2, ensure_ascii=False) + "\n"


def _toml(host: Host, entry: dict[str, Any]) -> str:
    """A section; JSON's strings and lists of strings are TOML's too."""
    lines = [f"{name} = {json.dumps(value)}" for name, value in entry.items()]
    return "\n".join([f"[{host.key}.{NAME}]", *lines, "startup_timeout_sec = 30", "tool_timeout_sec = 120", ""])


def _written(path: Path, text: str) -> Path | None:
    """Write a file whole; the path of the copy of what was there before, if anything was."""
    backup = _free(path.with_name(path.name + BACKUP)) if path.is_file() else None
    target = path.resolve()  # dotfiles are often links into a folder under version control
    partial = target.with_name(f"{target.name}.{NAME}-partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if backup is not None:
            shutil.copy2(path, backup)
        partial.write_text(text, encoding="utf-8")
        if backup is not None:
            shutil.copymode(path, partial)
        partial.replace(target)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise ResourceFailure(
            f"{path} cannot be written: {error.strerror or error}", next_step="use --print"
        ) from error
    return backup


def _free(backup: Path) -> Path:
    """A name that no earlier copy has: none of them is overwritten."""
    numbered = (backup.with_name(f"{backup.name}-{number}") for number in count(2))
    return next(path for path in chain((backup,), numbered) if not path.exists())
