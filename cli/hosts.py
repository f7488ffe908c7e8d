"""``plannerforge install HOST``: write, or print, the settings by which a host starts this server.

A host's file is written with a backup beside it, keeps all else that is in it, and is left alone where it has the
entry already. A file that is not plain JSON (comments, trailing commas) is not touched: what belongs there is printed.
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
"""The package, and the one of its programs that ``uvx`` starts by the package's name alone."""
_ADDRESSES = ("url", "serverUrl", "httpUrl")
"""What hosts call the address of a server that they reach by HTTP and do not start."""
_OWN_MODULE = ("-P", "-m", NAME)
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


def start_command(arguments: Sequence[str], environment: Path | None = None) -> tuple[str, ...]:
    """Program and arguments that start this server from anywhere: absolute, since hosts have a PATH of their own.

    Args:
        arguments: flags of ``serve``.
        environment: the folder of the environment that the program runs in; None for this one.
    """
    if may_vanish(environment or Path(sys.prefix)):
        return (*_by_uvx(), "serve", *arguments)
    script = Path(sys.executable).with_name(NAME)
    program = (str(script),) if script.is_file() else (sys.executable, *_OWN_MODULE)
    return (*program, "serve", *arguments)


def may_vanish(environment: Path) -> bool:
    """Whether an environment lies in uv's cache, where ``uvx`` makes it and ``uv cache clean`` removes it."""
    return any(
        re.fullmatch(r"(archive|environments)-v\d+", folder.name) and (folder.parent / "CACHEDIR.TAG").is_file()
        for folder in environment.resolve().parents
    )


def _by_uvx() -> tuple[str, ...]:
    """How uv makes such an environment again: from the index, or from where this one was installed from."""
    source = _installed_from()
    return (shutil.which("uvx") or "uvx", *(("--from", source) if source else ()), PACKAGE)


def _installed_from() -> str:
    """The file or address that the package was installed from (PEP 610); empty for a package index."""
    try:
        text = distribution(PACKAGE).read_text("direct_url.json")
    except PackageNotFoundError:
        return ""
    if not text:
        return ""
    told = json.loads(text)
    address = urlsplit(told["url"])
    if "vcs_info" in told:
        return f"{PACKAGE} @ {told['vcs_info']['vcs']}+{told['url']}@{told['vcs_info']['commit_id']}"
    return unquote(address.path) if address.scheme == "file" else str(told["url"])


def address_of(entry: Mapping[str, Any]) -> str:
    """Where a host reaches the server by HTTP; empty where it starts a program."""
    return next((str(entry[name]) for name in _ADDRESSES if entry.get(name)), "")


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
    if known is not None and not address_of(known) and _holds(known, entry):
        typer.echo(f"{host.title} has plannerforge already ({path}).")
        return 0
    if known is not None and path.suffix == ".toml":
        raise InvalidRequest(
            f"{path} has a section [{host.key}.{NAME}] that says otherwise",
            valid=[line for line in snippet.splitlines() if line],
            next_step="put these lines in its place",
        )
    backup = _written(path, _with_entry(host, path, text, entry, known))
    typer.echo(f"{host.title}: plannerforge is in {path} now" + (f" (as it was: {backup})" if backup else ""))
    typer.echo(f"Next: {host.then}.")
    return 0


def mend_program(host: Host, *, home: Path) -> tuple[Path, Path | None] | None:
    """Where a host's entry starts this package by a program that is gone, name the one that runs now in its place.

    An entry of another form (a container, a script of the user's) is left alone, and so are flags and variables.

    Returns:
        The file and the copy of what it was before; None where nothing was to be mended.

    Raises:
        ResourceFailure: the file cannot be read or written.
        InvalidRequest: it holds something else where the servers belong.
    """
    path = host.file(home, sys.platform)
    text = _text(path)
    known, _ = _known(host, path, text)
    if known is None or address_of(known) or shutil.which(str(known.get("command", ""))) or path.suffix == ".toml":
        return None
    flags = _own_flags(known)
    if flags is None:
        return None
    return path, _written(path, _with_entry(host, path, text, host.entry(start_command(flags)), known))


def _own_flags(entry: Mapping[str, Any]) -> list[str] | None:
    """The flags of ``serve`` in an entry as ``install`` writes it; None for one of another form."""
    arguments = entry.get("args")
    if not isinstance(arguments, list) or "serve" not in arguments:
        return None
    before = tuple(arguments[: arguments.index("serve")])
    name = Path(str(entry.get("command", ""))).name
    is_ours = (name in {NAME, PACKAGE} and not before) or (name.startswith("python") and before == _OWN_MODULE)
    return [str(each) for each in arguments[len(before) + 1 :]] if is_ours else None


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


def _holds(known: Mapping[str, Any], entry: Mapping[str, Any]) -> bool:
    return all(known.get(name) == value for name, value in entry.items())


def _with_entry(host: Host, path: Path, text: str, entry: dict[str, Any], known: dict[str, Any] | None) -> str:
    """The file's text with the entry; what an entry of before holds beside it stays, unless that was by HTTP."""
    if path.suffix == ".toml":
        return f"{text.rstrip()}\n\n{_toml(host, entry)}" if text.strip() else _toml(host, entry)
    whole = json.loads(text or "{}")
    kept = {} if known is None or address_of(known) else known
    whole.setdefault(host.key, {})[NAME] = {**kept, **entry}
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
