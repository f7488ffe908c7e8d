"""``plannerforge install HOST``: writes or prints the settings with which an MCP host starts this server.

Writing keeps a backup and all other content, and does nothing if the file already has the entry. A file that is not
plain JSON (comments, trailing commas) stays untouched; the entry is printed instead.
"""

import json
import re
import shutil
import sys
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution
from itertools import chain, count
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import typer

from ..schemas.errors import InvalidRequest, ResourceFailure, UnknownName, closest

NAME = "plannerforge"
PACKAGE = "plannerforge-mcp"
"""The package, which has a program of the same name, so ``uvx`` starts it by this name."""
_ADDRESSES = ("url", "serverUrl", "httpUrl")
"""The hosts' names for the address of a server that they reach over HTTP."""
_OWN_MODULE = ("-P", "-m", NAME)
BACKUP = ".before-plannerforge"
"""Suffix of the backup of a host's file."""


@dataclass(frozen=True)
class Host:
    """Describes where a host keeps its MCP servers, and the form of an entry.

    ``path``: its settings file, relative to the home folder; ``mac``: the same on macOS, if different; ``key``: the
    table of servers in the file; ``extra``: further fields of an entry; ``then``: what makes the host read the file.
    """

    title: str
    path: str
    key: str
    mac: str = ""
    extra: tuple[tuple[str, str], ...] = ()
    then: str = "restart it"

    def file(self, home: Path, platform: str) -> Path:
        """Return the host's settings file for a home folder and a ``sys.platform`` value."""
        return home / (self.mac if self.mac and platform == "darwin" else self.path)

    def entry(self, command: Sequence[str]) -> dict[str, Any]:
        """Return the server's entry in this host's format."""
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
    """Return a host by name, ignoring case.

    Raises:
        UnknownName: No host has this name.
    """
    folded = name.strip().lower().replace(" ", "-").replace("_", "-")
    if folded not in HOSTS:
        raise UnknownName(f"there is no host '{name}'", valid=closest(name, HOSTS) or list(HOSTS))
    return HOSTS[folded]


def start_command(arguments: Sequence[str], environment: Path | None = None) -> tuple[str, ...]:
    """Return the program and arguments that start this server; the path is absolute, since a host's PATH may differ.

    Args:
        arguments: Flags of ``serve``.
        environment: The folder of the environment that the program runs in; None means this one.
    """
    if may_vanish(environment or Path(sys.prefix)):
        return (*_by_uvx(), "serve", *arguments)
    script = Path(sys.executable).with_name(NAME)
    program = (str(script),) if script.is_file() else (sys.executable, *_OWN_MODULE)
    return (*program, "serve", *arguments)


def may_vanish(environment: Path) -> bool:
    """Return True if an environment is in uv's cache, where ``uvx`` creates it and ``uv cache clean`` removes it."""
    return any(
        re.fullmatch(r"(archive|environments)-v\d+", folder.name) and (folder.parent / "CACHEDIR.TAG").is_file()
        for folder in environment.resolve().parents
    )


def _by_uvx() -> tuple[str, ...]:
    """Return the command with which uv recreates this environment, from the index or from its original source."""
    source = _installed_from()
    return (shutil.which("uvx") or "uvx", *(("--from", source) if source else ()), PACKAGE)


def _installed_from() -> str:
    """Return the file or address that the package was installed from (PEP 610); empty for a package index."""
    try:
        text = distribution(PACKAGE).read_text("direct_url.json")
    except PackageNotFoundError:
        return ""
    if not text:
        return ""
    record = json.loads(text)
    address = urlsplit(record["url"])
    if "vcs_info" in record:
        return f"{PACKAGE} @ {record['vcs_info']['vcs']}+{record['url']}@{record['vcs_info']['commit_id']}"
    return unquote(address.path) if address.scheme == "file" else str(record["url"])


def address_of(entry: Mapping[str, Any]) -> str:
    """Return the HTTP address of an entry; empty if the entry starts a program."""
    return next((str(entry[name]) for name in _ADDRESSES if entry.get(name)), "")


def install(host: Host, command: Sequence[str], *, home: Path, print_only: bool = False) -> int:
    """Write the server into a host's settings, or print the entry; return 0 if the user has nothing left to do.

    Raises:
        ResourceFailure: The file cannot be read or written.
        InvalidRequest: The file has something else in place of the servers.
    """
    path = host.file(home, sys.platform)
    text = _read_text(path)
    entry = host.entry(command)
    snippet = _toml(host, entry) if path.suffix == ".toml" else json.dumps({host.key: {NAME: entry}}, indent=2)
    if print_only:
        typer.echo(snippet)
        return 0
    known, readable = _read_entry(host, path, text)
    if not readable:
        typer.echo(f"{path} is not plain {path.suffix[1:].upper()} and stays unchanged; add this to it:", err=True)
        typer.echo(snippet)
        return 1
    if known is not None and not address_of(known) and _has_entry(known, entry):
        typer.echo(f"{host.title} already has plannerforge ({path}).")
        return 0
    if known is not None and path.suffix == ".toml":
        raise InvalidRequest(
            f"{path} has a section [{host.key}.{NAME}] with other values",
            valid=[line for line in snippet.splitlines() if line],
            next_step="replace it with these lines",
        )
    backup = _write(path, _with_entry(host, path, text, entry, known))
    typer.echo(f"{host.title}: added plannerforge to {path}" + (f" (backup: {backup})" if backup else ""))
    typer.echo(f"Next: {host.then}.")
    return 0


def mend_program(host: Host, *, home: Path) -> tuple[Path, Path | None] | None:
    """Update a host's entry that starts this package with a missing program, so that it starts the current one.

    Entries of another form (a container, the user's script) stay unchanged, and so do flags and variables.

    Returns:
        The file and its backup, or None if the entry needs no repair.

    Raises:
        ResourceFailure: The file cannot be read or written.
        InvalidRequest: The file has something else in place of the servers.
    """
    path = host.file(home, sys.platform)
    text = _read_text(path)
    known, _ = _read_entry(host, path, text)
    if known is None or address_of(known) or shutil.which(str(known.get("command", ""))) or path.suffix == ".toml":
        return None
    flags = _own_flags(known)
    if flags is None:
        return None
    return path, _write(path, _with_entry(host, path, text, host.entry(start_command(flags)), known))


def _own_flags(entry: Mapping[str, Any]) -> list[str] | None:
    """Return the ``serve`` flags of an entry that ``install`` wrote, or None for an entry of another form."""
    arguments = entry.get("args")
    if not isinstance(arguments, list) or "serve" not in arguments:
        return None
    before = tuple(arguments[: arguments.index("serve")])
    name = Path(str(entry.get("command", ""))).name
    is_ours = (name in {NAME, PACKAGE} and not before) or (name.startswith("python") and before == _OWN_MODULE)
    return [str(each) for each in arguments[len(before) + 1 :]] if is_ours else None


def has_server(host: Host, home: Path) -> tuple[Path, dict[str, Any] | None]:
    """Return a host's settings file and this server's entry in it, or None if it has no entry.

    Raises:
        ResourceFailure: The file cannot be read.
    """
    path = host.file(home, sys.platform)
    known, _ = _read_entry(host, path, _read_text(path))
    return path, known


def _read_text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8") if path.is_file() else ""
    except (OSError, UnicodeDecodeError) as error:
        raise ResourceFailure(f"{path} cannot be read: {error}", next_step="use --print") from error


def _read_entry(host: Host, path: Path, text: str) -> tuple[dict[str, Any] | None, bool]:
    """Return a file's entry, and whether the file is readable."""
    try:
        whole = tomllib.loads(text) if path.suffix == ".toml" else json.loads(text or "{}")
    except (tomllib.TOMLDecodeError, json.JSONDecodeError):
        return None, False
    servers = whole.get(host.key, {}) if isinstance(whole, dict) else None
    if not isinstance(servers, dict):
        raise InvalidRequest(
            f"{path} has no table of servers under '{host.key}'", next_step="correct it, or use --print"
        )
    known = servers.get(NAME)
    return (known if isinstance(known, dict) else None), True


def _has_entry(known: Mapping[str, Any], entry: Mapping[str, Any]) -> bool:
    return all(known.get(name) == value for name, value in entry.items())


def _with_entry(host: Host, path: Path, text: str, entry: dict[str, Any], known: dict[str, Any] | None) -> str:
    """Return the file's text with the entry; further fields of an old entry stay, unless it had an HTTP address."""
    if path.suffix == ".toml":
        return f"{text.rstrip()}\n\n{_toml(host, entry)}" if text.strip() else _toml(host, entry)
    whole = json.loads(text or "{}")
    kept = {} if known is None or address_of(known) else known
    whole.setdefault(host.key, {})[NAME] = {**kept, **entry}
    return json.dumps(whole, indent=2, ensure_ascii=False) + "\n"


def _toml(host: Host, entry: dict[str, Any]) -> str:
    """Return the entry as a TOML section; JSON strings and lists of strings are valid TOML."""
    lines = [f"{name} = {json.dumps(value)}" for name, value in entry.items()]
    return "\n".join([f"[{host.key}.{NAME}]", *lines, "startup_timeout_sec = 30", "tool_timeout_sec = 120", ""])


def _write(path: Path, text: str) -> Path | None:
    """Write a file as a whole, and return the path of its backup, if it existed."""
    backup = _free_name(path.with_name(path.name + BACKUP)) if path.is_file() else None
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


def _free_name(backup: Path) -> Path:
    """Return a backup name that is not taken, so that no earlier backup is overwritten."""
    numbered = (backup.with_name(f"{backup.name}-{number}") for number in count(2))
    return next(path for path in chain((backup,), numbered) if not path.exists())
