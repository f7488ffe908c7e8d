"""Discovers user-supplied planners from package metadata and the environment, and imports them only when used.

Planners come from the entry points of the group ``plannerforge.planners`` and from ``PLANNERFORGE_PLANNERS``, through
which the server passes the programs in its settings to its workers. Unusable planners are listed, too, with the reason.
The server's process never imports other people's code: a separate process reads a planner's declaration.
"""

import hashlib
import importlib
import os
import subprocess
import sys
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import TypeAdapter, ValidationError

from ....schemas.base import problem_of
from ....schemas.errors import PlannerFailure
from ....schemas.planning import PLANNERS_VARIABLE, WEIGHT_NAME, CommandPlanner, PlannerDeclaration
from ....schemas.text import cited, one_line

if TYPE_CHECKING:
    from ..interface import Planner

ENTRY_POINTS = "plannerforge.planners"
IMPORT_LIMIT_S = 60.0
"""Time limit for importing a planner's package (chosen: PyTorch takes seconds)."""
_LARGEST_SOURCE_BYTES = 10_000_000
"""Files of a program up to this size are part of its version (chosen: includes scripts, excludes data and
interpreters).
"""
_SOURCE_SUFFIXES = (".py", ".so", ".pyd")
"""Suffixes of a package's code files: Python's own and its compiled modules."""
_IMPORT_BYTES = 4 * 1024**3
"""Data memory of the process that imports a planner for its declaration (chosen: the same as a worker's)."""
_COMMANDS = TypeAdapter(dict[str, CommandPlanner])
_BROKEN = "entry_point_broken"


@dataclass(frozen=True)
class OwnPlanner:
    """The target of an entry point: the planner's class, or a function that creates one, and its declaration."""

    make: "Callable[[], Planner]"
    declaration: PlannerDeclaration

    def __post_init__(self) -> None:
        if not callable(self.make):
            raise TypeError(f"make is {type(self.make).__name__}, neither a class nor a function")
        if not isinstance(self.declaration, PlannerDeclaration):
            raise TypeError(f"declaration is {type(self.declaration).__name__}, not PlannerDeclaration")


@dataclass(frozen=True)
class PlannerObject:
    """A planner that is an object of this process, and the text that distinguishes its versions."""

    planner: OwnPlanner
    source: str


@dataclass(frozen=True)
class Found:
    """A user-supplied planner: an entry point, a program or an object of this process.

    ``fault``: the reason why its name cannot be used; empty if it can be used.
    """

    name: str
    where: str
    entry: EntryPoint | None = None
    command: CommandPlanner | None = None
    here: PlannerObject | None = None
    fault: str = ""

    def own(self) -> OwnPlanner:
        """Import the entry point's object into this process and return it; only workers may call this.

        Raises:
            PlannerFailure: The object cannot be imported, or is not an ``OwnPlanner``.
        """
        if self.here is not None:
            return self.here.planner
        if self.entry is None:
            raise PlannerFailure(f"planner {self.name} is a program, not a class", reason=_BROKEN)
        try:
            return _imported(self.entry.value, self.version)
        except (
            Exception,
            SystemExit,
        ) as error:  # the boundary to other people's code: any exception becomes this planner's error
            raise self._broken(_format_exception(error)) from error

    @property
    def declaration(self) -> PlannerDeclaration:
        """The planner's declaration.

        Raises:
            PlannerFailure: The planner cannot be imported, or is not an ``OwnPlanner``.
        """
        if self.command is not None or self.entry is None:
            return self.command or self.own().declaration
        try:
            return _load_declaration(self.entry.value, self.version)
        except (ValueError, subprocess.TimeoutExpired) as error:
            raise self._broken(one_line(str(error))) from error

    @property
    def sources(self) -> list[Path]:
        """The planner's source files: those in a program's command, or those of a package."""
        if self.command is not None:
            named = [Path(part) for part in self.command.command if part.startswith("/")]
            return [path for path in named if path.is_file() and path.stat().st_size <= _LARGEST_SOURCE_BYTES]
        return _sources(self.entry.module if self.entry else "")

    @property
    def version(self) -> str:
        """A digest of the planner's own source; a changed digest makes an edited planner run again."""
        if self.here is not None:
            return _digest(self.here.source, [])
        return _digest("" if self.command is None else self.command.model_dump_json(), self.sources)

    @property
    def package_version(self) -> str:
        """The version of the planner's package; empty for a program."""
        return self.entry.dist.version if self.entry is not None and self.entry.dist is not None else ""

    def _broken(self, why: str) -> PlannerFailure:
        value = self.entry.value if self.entry else ""
        return PlannerFailure(
            f"planner {self.name}: {value} of the {self.where} cannot be used: {why}",
            next_step="correct it; its entry point must be an OwnPlanner(make, declaration)",
            reason=_BROKEN,
        )


def found_planners(built_in: Collection[str]) -> dict[str, Found]:
    """Return the user-supplied planners by name; a malformed, duplicate or built-in name sets ``fault``.

    Raises:
        PlannerFailure: The environment variable is malformed.
    """
    found: dict[str, Found] = {}
    of_environment = _programs_in_environment(os.environ.get(PLANNERS_VARIABLE, ""))
    for each in (*_entry_point_planners(_path_times()), *of_environment, *_planners_of_process().values()):
        fault = ""
        if each.name in built_in:
            fault = f"the {each.where} has the name of the built-in planner {each.name}; rename it"
        elif not WEIGHT_NAME.fullmatch(each.name):
            fault = f"{each.where}: '{one_line(each.name)}' is not a valid name; use lower-case letters, digits and _"
        elif each.name in found:
            fault = f"two planners have the name {each.name}: {found[each.name].where} and {each.where}; rename one"
        found[each.name] = replace(each, fault=fault)
    return found


@contextmanager
def programs_named(commands: Mapping[str, CommandPlanner]) -> Iterator[None]:
    """Register the given programs as planners while the block runs, in this process and in those that it starts."""
    before = os.environ.get(PLANNERS_VARIABLE)
    if commands:
        os.environ[PLANNERS_VARIABLE] = _COMMANDS.dump_json(dict(commands)).decode()
    try:
        yield
    finally:
        if before is not None:
            os.environ[PLANNERS_VARIABLE] = before
        elif commands:
            os.environ.pop(PLANNERS_VARIABLE, None)


@contextmanager
def registered_objects(planners: Mapping[str, PlannerObject]) -> Iterator[None]:
    """Register the given objects as planners while the block runs, only in this process."""
    known = _planners_of_process()
    named = {
        _fold_name(name): Found(_fold_name(name), "object of this process", here=one) for name, one in planners.items()
    }
    before = {name: known[name] for name in named if name in known}
    known.update(named)
    try:
        yield
    finally:
        for name in named:
            known.pop(name, None)
        known.update(before)


def is_planner_object(name: str) -> bool:
    """Return True if a planner is an object of this process, which only this process can run."""
    return _fold_name(name) in _planners_of_process()


@cache
def _planners_of_process() -> dict[str, Found]:
    return {}


def _path_times() -> tuple[tuple[str, int], ...]:
    """Return the folders of installed packages with their modification times, because reading metadata takes 20 ms."""
    folders = [Path(entry or ".") for entry in sys.path]
    return tuple((str(folder), folder.stat().st_mtime_ns) for folder in folders if folder.exists())


@cache
def _entry_point_planners(path_times: tuple[tuple[str, int], ...]) -> tuple[Found, ...]:
    del path_times  # the cache's key, so that packages installed later are found
    return tuple(
        Found(_fold_name(entry.name), f"entry point of {_package(entry)}", entry=entry)
        for entry in entry_points(group=ENTRY_POINTS)
    )


def _fold_name(name: str) -> str:
    return name.strip().lower().replace("-", "_")


def _package(entry: EntryPoint) -> str:
    return entry.dist.name if entry.dist is not None else entry.module


@cache
def _programs_in_environment(text: str) -> tuple[Found, ...]:
    if not text:
        return ()
    try:
        commands = _COMMANDS.validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        name, *where = first["loc"] or ("",)
        problem, _ = problem_of(CommandPlanner, {**first, "loc": tuple(where)})
        raise PlannerFailure(
            f"{PLANNERS_VARIABLE} cannot be read: {': '.join(filter(None, (str(name), problem)))}",
            next_step="correct it; see docs/own_planner.md",
            reason="settings_broken",
        ) from error
    return tuple(Found(_fold_name(name), "command in the settings", command=each) for name, each in commands.items())


def _sources(module: str) -> list[Path]:
    """Return the Python files and compiled modules of the module's package, without importing it."""
    spec = find_spec(module.partition(".")[0]) if module else None
    if spec is None:
        return []
    folders = [Path(folder) for folder in spec.submodule_search_locations or ()]
    found = (path for folder in folders for path in folder.rglob("*") if path.suffix in _SOURCE_SUFFIXES)
    return sorted(found) or [Path(spec.origin or "")]


def _digest(text: str, files: list[Path]) -> str:
    stats = [(path, path.stat()) for path in files if path.is_file()]
    return _digest_of(
        text, tuple((path, s.st_mtime_ns, s.st_size) for path, s in stats if s.st_size <= _LARGEST_SOURCE_BYTES)
    )


@cache
def _digest_of(text: str, files: tuple[tuple[Path, int, int], ...]) -> str:
    """Return a digest of the files' contents; modification times and sizes are only the cache's key."""
    digest = hashlib.sha256(text.encode())
    for path, _, _ in files:
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:12]


@cache
def _imported(value: str, version: str) -> OwnPlanner:
    """Return the object at ``module:name``; an edited package is imported again, since workers live long."""
    module, _, name = value.partition(":")
    package = module.partition(".")[0]
    before = _imported_versions().setdefault(package, version)
    if before != version:
        _imported_versions()[package] = version
        for known in [key for key in sys.modules if key == package or key.startswith(f"{package}.")]:
            del sys.modules[known]
        importlib.invalidate_caches()
    loaded: object = importlib.import_module(module)
    for part in name.split(".") if name else ():
        loaded = getattr(loaded, part)
    if not isinstance(loaded, OwnPlanner):
        raise TypeError(f"it is {type(loaded).__name__}, not OwnPlanner")
    return loaded


@cache
def _imported_versions() -> dict[str, str]:
    """Return the version of each package that this process has imported."""
    return {}


@cache
def _load_declaration(value: str, version: str) -> PlannerDeclaration:
    """Return the declaration of the object at ``module:name``, from a separate process.

    The import may crash or hang.

    Raises:
        ValueError: The object cannot be imported; the message gives the reason.
        subprocess.TimeoutExpired: The import takes too long.
    """
    del version  # only part of the cache's key
    program = f"from {__name__} import print_declaration; print_declaration({value!r})"
    done = subprocess.run(
        [sys.executable, "-P", "-c", program],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        timeout=IMPORT_LIMIT_S,
        check=False,
    )
    if done.returncode:
        lines = done.stderr.decode("utf-8", "replace").strip().splitlines()
        raise ValueError(lines[-1] if lines else f"its import ended with exit status {done.returncode}")
    return PlannerDeclaration.model_validate_json(done.stdout)


def print_declaration(value: str) -> None:
    """Print the declaration of the object at ``module:name`` as JSON; runs in the separate process."""
    from ...execution import limit_memory

    answer = os.dup(1)
    os.dup2(2, 1)  # the output of the planner's package is not part of the declaration
    limit_memory(_IMPORT_BYTES)
    try:
        os.write(answer, _imported(value, "").declaration.model_dump_json().encode())
    except (Exception, SystemExit) as error:  # noqa: BLE001 - the boundary to other people's code
        sys.exit(_format_exception(error))


def _format_exception(error: BaseException) -> str:
    """Return an exception of other people's code in one line."""
    if isinstance(error, ValidationError):
        return "; ".join(one_line(each["msg"].removeprefix("Value error, ")) for each in error.errors())
    return f"{type(error).__name__}: {cited(error)}"
