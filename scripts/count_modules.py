"""Count the modules that a generation request passes, and its returns: ``python scripts/count_modules.py``.

A request *passes* a module if one of its functions gets the request: the tool's arguments, the ``GenerationSpec`` that
is read from them, or a scenario's ``GenerationRequest``. A *return* is a call from another module into one that was
passed before; repeated calls of one function count once. The counts include the worker, which runs in this process.
They exclude ``schemas/``, which defines the request, and ``workflows/context.py``, which only carries it.

``--all`` counts every call between modules of ``tools/``, ``workflows/`` and ``engine/generation/`` instead. The last
line is one JSON object.
"""

import argparse
import asyncio
import json
import sys
import tempfile
from dataclasses import dataclass, field
from inspect import CO_ASYNC_GENERATOR, CO_COROUTINE, CO_GENERATOR, CO_NEWLOCALS
from pathlib import Path
from types import CodeType, FrameType
from typing import Any, cast

import plannerforge
from plannerforge.engine.execution import Limits, Operation, Request, Response, silent
from plannerforge.engine.workspace import Workspace
from plannerforge.schemas.generation import GenerateScenariosArguments, GenerationRequest, GenerationSpec
from plannerforge.schemas.maps import MapServices
from plannerforge.tools import scenarios
from plannerforge.tools.call import ToolCall
from plannerforge.workflows.context import Services

PROJECT = Path(plannerforge.__file__).resolve().parent
USUAL = {"place": "Landmoor", "vehicles": ["truck=1"], "duration_s": 5, "seed": 3}
"""The default request, on a packaged map."""
REQUEST = GenerateScenariosArguments | GenerationSpec | GenerationRequest
CARRIERS = ("workflows/context.py",)
OWN = ("tools/", "workflows/", "engine/generation/")
_SUSPENDED = CO_COROUTINE | CO_GENERATOR | CO_ASYNC_GENERATOR


@dataclass
class Way:
    """The calls between modules, in order; each is (from module, function, to module, function).

    ``all_calls``: count every call in ``OWN``, not only those that get the request.
    """

    all_calls: bool = False
    calls: dict[tuple[str, str, str, str], None] = field(default_factory=dict)
    _names: dict[str, str] = field(default_factory=dict)
    _begun: dict[int, FrameType] = field(default_factory=dict)

    def __call__(self, frame: FrameType, event: str, argument: object) -> None:
        """Record a call; this is the interpreter's profile function."""
        del argument
        code = frame.f_code
        module = self._module(code)
        if event != "call" or not module or not self._counts(frame, module):
            return
        if code.co_flags & _SUSPENDED:  # it is entered once, and only resumed later
            if id(frame) in self._begun:
                return
            self._begun[id(frame)] = frame  # kept, or another frame could get its id
        caller = frame.f_back
        while caller is not None and not self._module(caller.f_code):
            caller = caller.f_back
        name = "" if caller is None else caller.f_code.co_qualname
        before = "" if caller is None else self._module(caller.f_code)
        if before != module:
            self.calls[before, name, module, code.co_qualname] = None

    def figures(self) -> dict[str, Any]:
        """Return the number of passed modules, of returns, and of entries by module."""
        entered: dict[str, int] = {}
        for _, _, module, _ in self.calls:
            entered[module] = entered.get(module, 0) + 1
        return {"modules": len(entered), "returns": sum(entered.values()) - len(entered), "entered": entered}

    def _counts(self, frame: FrameType, module: str) -> bool:
        code = frame.f_code
        if module in CARRIERS or not code.co_flags & CO_NEWLOCALS:  # no function: a class or a module is being made
            return False
        if self.all_calls:
            return module.startswith(OWN)
        names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
        handed = any(isinstance(frame.f_locals.get(name), REQUEST) for name in names)
        return handed and not module.startswith(("schemas/", "scripts/"))

    def _module(self, code: CodeType) -> str:
        """Return the file relative to the project; empty for other code, lambdas and comprehensions."""
        if code.co_name.startswith("<"):
            return ""
        if code.co_filename not in self._names:
            path = Path(code.co_filename).resolve()
            inside = path.is_relative_to(PROJECT) and "site-packages" not in path.parts and path.suffix == ".py"
            self._names[code.co_filename] = path.relative_to(PROJECT).as_posix() if inside else ""
        return self._names[code.co_filename]


class _InProcess:
    """An executor that runs operations in this process, so that the worker's calls count too."""

    capacity = 1
    notice = ""

    async def run(self, operation: Operation[Request, Response], request: Request, **options: object) -> Response:
        """Return the operation's response."""
        del options
        return operation.load()(request, silent)


def count(arguments: GenerateScenariosArguments, folder: Path, *, all_calls: bool = False) -> dict[str, Any]:
    """Generate a call's scenarios in a workspace in the folder, and count its request's modules.

    Returns:
        ``modules``, ``returns``, and ``entered``: the number of calls into each module.
    """
    way, unused, workspace = Way(all_calls), cast("Any", None), Workspace(folder)
    services = Services(
        workspace,
        _InProcess(),
        unused,
        unused,
        Limits(roots=()),
        with_starter=False,
        online=MapServices(mode="offline"),
    )

    async def call() -> None:
        sys.setprofile(way)
        try:
            await scenarios.generate_scenarios(arguments, ToolCall(services))
        finally:
            sys.setprofile(None)

    asyncio.run(call())
    workspace.close()
    return way.figures()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("arguments", nargs="?", default=json.dumps(USUAL), help="of generate_scenarios, as JSON")
    parser.add_argument("--all", action="store_true", help="count every call in tools, workflows and engine/generation")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        asked = GenerateScenariosArguments.model_validate_json(given.arguments)
        figures = count(asked, Path(scratch), all_calls=given.all)
    for name, entries in figures["entered"].items():
        sys.stdout.write(f"{entries:3} {name}\n")
    sys.stdout.write(json.dumps({key: figures[key] for key in ("modules", "returns")}) + "\n")
