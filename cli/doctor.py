"""``plannerforge doctor``: checks everything that the server needs, and says how to repair what is broken.

Checks of heavy or crash-prone parts (SUMO, the planners' cores, the embedding model) run in a separate process.
"""

import json
import os
import shutil
import socket
import sqlite3
import subprocess
import sys
import sysconfig
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal
from urllib.parse import urlsplit

from rich.console import Console
from rich.markup import escape
from rich.table import Column, Table

from .. import __version__
from ..schemas.catalog import EMBEDDINGS_EXTRA
from ..schemas.errors import PlannerForgeError, misspelt_names
from ..server.settings import Settings, settings_file
from ..workflows.context import INDEX_FOLDER
from .hosts import HOSTS, Host, address_of, has_server, mend_program

State = Literal["ok", "note", "fault"]
_TRY_LIMIT_S = 120.0
"""Time limit for importing a library (chosen: from a cold disk, PyTorch takes half a minute)."""
_ASK_LIMIT_S = 5.0
"""Time limit for a map service to accept a connection (chosen)."""
_OWN_LIMIT_S = 0.5
"""Time limit for a server on this machine (chosen)."""
_LEAST_FREE_MB = 2000
"""Free disk below which long batches may fill it (chosen: a batch of 500 runs takes 300 MB)."""
_OWN_NAMES = frozenset({"127.0.0.1", "localhost", "::1"})
_SIGNS = {"ok": "[green]✓[/green]", "note": "[yellow]●[/yellow]", "fault": "[red]✗[/red]"}


@dataclass(frozen=True)
class Trial:
    """A program that runs a check in a separate process and prints its findings, and the remedy if the check fails."""

    program: str
    mend: str


TRIALS = {
    "SUMO": Trial(
        """
import subprocess
from pathlib import Path
import libsumo, sumo
command = [Path(sumo.SUMO_HOME, "bin", "netconvert"), "--version"]
print(subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()[0])
""",
        "pip install --force-reinstall libsumo eclipse-sumo, in the versions that plannerforge-mcp names",
    ),
    "planner cores": Trial(
        """
from importlib.metadata import version
import commonroad_dc.pycrcc, frenetix
print("frenetix", version("frenetix") + ", drivability checker", version("commonroad-drivability-checker"))
""",
        "pip install --force-reinstall frenetix commonroad-drivability-checker; Polygon3 needs a compiler",
    ),
    "text ranking": Trial(
        """
import sys
from plannerforge.engine.catalog import EmbeddingModel
from plannerforge.schemas.errors import ResourceFailure
try:
    print(sys.argv[1] + ", vectors of", EmbeddingModel.of(sys.argv[1]).embed(["a truck"]).shape[1])
except ResourceFailure as failure:
    sys.exit(str(failure))
""",
        f"pip install '{EMBEDDINGS_EXTRA}' for a model that is not packaged, or correct the setting embedding_model; "
        "searches without text still work",
    ),
    "text index": Trial(
        """
import chromadb
print("chromadb", chromadb.__version__)
""",
        "pip install --force-reinstall chromadb",
    ),
}


LOOK_AT_INDEX = """
import sys
from pathlib import Path
from plannerforge.engine.catalog import damaged_parts
print(*damaged_parts(Path(sys.argv[1])), sep="\\n")
"""


@dataclass(frozen=True)
class Diagnosis:
    """One check: its name, its state, the finding, and the remedy."""

    name: str
    state: State
    found: str
    mend: str = ""


def run_doctor(settings: Settings, *, as_json: bool, fix: bool, home: Path) -> int:
    """Run all checks, apply safe repairs if ``fix`` is set, and print the results; return 1 if a fault remains."""
    mended = list(_repair(settings, home)) if fix else []
    found = list(diagnoses(settings, home))
    if as_json:
        sys.stderr.write("".join(f"{words}\n" for words in mended))
        sys.stdout.write(json.dumps([asdict(each) for each in found], indent=1, ensure_ascii=False) + "\n")
    else:
        _print(found, mended)
    return 1 if any(each.state == "fault" for each in found) else 0


def diagnoses(settings: Settings, home: Path) -> Iterator[Diagnosis]:
    """Yield the diagnoses in the order of the checks."""
    yield Diagnosis("version", "ok", f"plannerforge {__version__}, Python {sys.version.split()[0]} ({sys.executable})")
    yield _settings_file()
    yield _compiler()
    for name, trial in TRIALS.items():
        yield _run_trial(name, trial, settings.embedding_model)
    yield from _workspace(settings)
    yield from _index(settings)
    yield from _folders(settings)
    yield from _services(settings)
    yield from _hosts(home)


def _settings_file() -> Diagnosis:
    path = settings_file()
    return Diagnosis("settings", "ok", f"{path}" if path.is_file() else f"defaults; {path} is read if it exists")


def _compiler() -> Diagnosis:
    header = Path(sysconfig.get_paths()["include"]) / "Python.h"
    compiler = next((name for name in ("cc", "gcc", "clang") if shutil.which(name)), "")
    if compiler and header.is_file():
        return Diagnosis("compiler", "ok", f"{compiler}, Python's headers (only installation needs them)")
    lacks = " and ".join(["a C compiler"] * (not compiler) + ["Python's headers"] * (not header.is_file()))
    return Diagnosis(
        "compiler",
        "note",
        f"{lacks} not found; only the installation of Polygon3 needs it",
        "apt install gcc python3-dev",
    )


def _run_trial(name: str, trial: Trial, model: str) -> Diagnosis:
    done = _run(trial.program, model)
    if done is None:
        return Diagnosis(name, "fault", f"no answer in {_TRY_LIMIT_S:g} s", trial.mend)
    if done.returncode:
        return Diagnosis(name, "fault", _last_line(done), trial.mend)
    return Diagnosis(name, "ok", done.stdout.strip())


def _run(program: str, argument: str) -> subprocess.CompletedProcess[str] | None:
    """Run a program in a separate process; return None if it took too long."""
    try:
        return subprocess.run(
            [sys.executable, "-P", "-c", program, argument],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=_TRY_LIMIT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return None


def _last_line(done: subprocess.CompletedProcess[str]) -> str:
    lines = done.stderr.strip().splitlines()
    ending = f"signal {-done.returncode}" if done.returncode < 0 else f"status {done.returncode}"
    return lines[-1] if lines else f"ended with {ending}"


def _workspace(settings: Settings) -> Iterator[Diagnosis]:
    root = settings.workspace.expanduser().resolve()
    if not root.is_dir():
        above = _lowest_above(root)
        where = "" if above == root.parent else f", and the folders above it from {above} on"
        yield Diagnosis(
            "workspace",
            "note",
            f"{root} does not exist yet; the first start creates it",
            f"--fix creates it now{where}",
        )
        return
    free_mb = shutil.disk_usage(root).free // 1024**2
    if not os.access(root, os.W_OK | os.X_OK):
        yield Diagnosis("workspace", "fault", f"{root} cannot be written to", "change its owner, or set workspace")
    elif free_mb < _LEAST_FREE_MB:
        yield Diagnosis("workspace", "note", f"{root}: {free_mb:,} MB of disk are free", "free some, or set workspace")
    else:
        yield Diagnosis("workspace", "ok", f"{root}, {free_mb:,} MB free")
    yield _records(root)


def _records(root: Path) -> Diagnosis:
    from ..engine.workspace import Workspace, disagreements

    try:
        workspace = Workspace(root)
        try:
            found = list(disagreements(workspace))
        finally:
            workspace.close()
    except (PlannerForgeError, sqlite3.Error) as error:
        return Diagnosis("records", "fault", str(error), "set another workspace, or restore this one")
    lost = [each for each in found if each.is_lost]
    if lost:
        more = f", and {len(lost) - 1} more" if len(lost) > 1 else ""
        words = f"{lost[0].where}: {lost[0].what}{more}"
        return Diagnosis("records", "fault", words, "restore the workspace from a copy; create what is lost again")
    if found:
        return Diagnosis("records", "note", f"{len(found)} folders without a record", "plannerforge workspace gc")
    return Diagnosis("records", "ok", "intact, with all their files")


def _index(settings: Settings) -> Iterator[Diagnosis]:
    root = _index_folder(settings)
    if not root.is_dir():
        return
    damaged, reason = _damaged_parts(root)
    mend = "--fix removes the damaged parts; the next text search rebuilds them"
    if reason:
        yield Diagnosis("index files", "note", f"not checked: {reason}", "repair the text index (above) first")
    elif damaged:
        names = ", ".join(str(part.relative_to(root.parent)) for part in damaged)
        yield Diagnosis("index files", "fault", f"damaged: {names}", mend)
    else:
        yield Diagnosis("index files", "ok", f"{root} is readable")


def _index_folder(settings: Settings) -> Path:
    return settings.workspace.expanduser().resolve() / INDEX_FOLDER


def _damaged_parts(root: Path) -> tuple[list[Path], str]:
    """Return the unreadable parts of the text index, or the reason why they are unknown.

    If a signal ends the checking process, every generation counts as damaged.
    """
    done = _run(LOOK_AT_INDEX, str(root))
    if done is None:
        return [], f"no answer in {_TRY_LIMIT_S:g} s"
    if done.returncode > 0:
        return [], _last_line(done)
    if done.returncode < 0:
        return sorted(path for path in root.iterdir() if path.is_dir()), ""
    return [Path(line) for line in done.stdout.splitlines() if line], ""


def _folders(settings: Settings) -> Iterator[Diagnosis]:
    for name, folders in (("roots", settings.roots), ("map folders", settings.map_folders)):
        missing = [folder.expanduser() for folder in folders if not folder.expanduser().is_dir()]
        if missing:
            text = "; ".join(f"{folder} (nearest: {_nearest(folder.resolve())})" for folder in missing)
            mend = f"correct the setting {name.replace(' ', '_')}, or create the folder; --fix does not create it"
            yield Diagnosis(name, "note", f"not there: {text}", mend)
        elif folders:
            yield Diagnosis(name, "ok", ", ".join(map(str, folders)))


def _lowest_above(folder: Path) -> Path:
    """Return the closest parent folder that exists."""
    return next(parent for parent in folder.parents if parent.is_dir())


def _nearest(folder: Path) -> Path:
    """Return a replacement for a missing folder: a sibling with a similar name, or the lowest folder above it."""
    above = _lowest_above(folder)
    missing = folder.relative_to(above).parts[0]
    siblings = [path.name for path in above.iterdir() if path.is_dir()] if os.access(above, os.R_OK | os.X_OK) else []
    like = misspelt_names(missing, siblings)
    return above / like[0] if like else above


def _services(settings: Settings) -> Iterator[Diagnosis]:
    services = settings.map_services()
    if services.mode != "online":
        yield Diagnosis("map services", "ok", f"not checked (maps_online is {services.mode})")
        return
    addresses = dict.fromkeys((services.nominatim_url, *services.overpass_urls))
    reached = [address for address in addresses if _accepts(address)]
    lost = [urlsplit(address).hostname or address for address in addresses if address not in reached]
    if not lost:
        yield Diagnosis("map services", "ok", f"{len(reached)} of {len(addresses)} accept connections")
    else:
        words = f"{len(reached)} of {len(addresses)} accept connections; not {', '.join(lost)}"
        yield Diagnosis(
            "map services",
            "note",
            words,
            "built-in and own maps work without them; maps_online=offline skips this check",
        )


def _accepts(address: str, limit_s: float = _ASK_LIMIT_S) -> bool:
    parts = urlsplit(address)
    port = parts.port or (80 if parts.scheme == "http" else 443)
    try:
        with socket.create_connection((parts.hostname or "", port), timeout=limit_s):
            return True
    except OSError:
        return False


def _hosts(home: Path) -> Iterator[Diagnosis]:
    for name, host in HOSTS.items():
        try:
            path, entry = has_server(host, home)
        except PlannerForgeError as error:
            yield Diagnosis(host.title, "note", error.message, f"plannerforge install {name} --print")
            continue
        if entry is None:
            continue
        command, mend = str(entry.get("command", "")), f"plannerforge install {name}"
        if address_of(entry):
            yield _by_http(host, path, entry, mend)
        elif shutil.which(command) is None:
            yield Diagnosis(host.title, "fault", f"{path}: '{command}' is not a program", mend)
        else:
            yield Diagnosis(host.title, "ok", f"{path}")


def _by_http(host: Host, path: Path, entry: Mapping[str, Any], mend: str) -> Diagnosis:
    """Return the diagnosis of a host's entry that has an address; only a server on this machine is contacted."""
    try:
        parts = urlsplit(address_of(entry))
        is_address = parts.scheme in {"http", "https"} and bool(parts.hostname) and parts.port != 0
    except ValueError:
        is_address = False
    if not is_address:
        return Diagnosis(host.title, "fault", f"{path}: '{address_of(entry)}' is not an HTTP address", mend)
    if "command" in entry:
        return Diagnosis(host.title, "fault", f"{path}: the entry has both an address and a program", mend)
    text = f"{path}: HTTP at {parts.scheme}://{parts.netloc.rpartition('@')[2]}{parts.path}"
    if parts.hostname in _OWN_NAMES and not _accepts(address_of(entry), _OWN_LIMIT_S):
        return Diagnosis(host.title, "note", f"{text}; nothing listens there", "plannerforge serve --http")
    return Diagnosis(host.title, "ok", text)


def _repair(settings: Settings, home: Path) -> Iterator[str]:
    """Create the workspace folder, remove a damaged text index, and update entries with a missing program.

    Missing user folders are not created, since the setting may be mistyped.
    """
    from ..engine.catalog import remove_damaged
    from ..engine.workspace import make_private

    root = settings.workspace.expanduser().resolve()
    if not root.is_dir():
        make_private(root)
        yield f"created {root}"
    index = _index_folder(settings)
    damaged, _ = _damaged_parts(index) if index.is_dir() else ([], "")
    if damaged:
        remove_damaged(index, damaged)
        yield f"removed {', '.join(map(str, damaged))}: the next text search rebuilds it"
    for host in HOSTS.values():
        try:
            written = mend_program(host, home=home)
        except PlannerForgeError as error:
            yield f"{host.title} is left unchanged: {error.message}"
            continue
        if written is not None:
            path, backup = written
            yield f"{host.title}: {path} now starts this program (backup: {backup})"


def _print(found: list[Diagnosis], mended: list[str]) -> None:
    console = Console()
    for words in mended:
        console.print(escape(words), highlight=False)
    table = Table(Column(""), Column("what"), Column("found", overflow="fold"), Column("mend", overflow="fold"))
    for each in found:
        table.add_row(_SIGNS[each.state], each.name, escape(each.found), escape(each.mend))
    console.print(table)
    faults = sum(each.state == "fault" for each in found)
    notes = sum(each.state == "note" for each in found)
    console.print(f"{len(found)} checks: {faults} fault(s), {notes} note(s)", highlight=False)
