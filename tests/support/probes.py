"""Small probe tools, offered next to a few real ones that need no other part of the project."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import pytest
from pydantic import Field

from plannerforge.resources.templates import picture_link
from plannerforge.schemas.base import Answer, Arguments, Model, Result
from plannerforge.schemas.errors import NotPossible
from plannerforge.server import assembly
from plannerforge.server.tool_calls import MOST_IMAGE_BYTES
from plannerforge.tools.call import Image, ImageAnswer, ToolCall
from plannerforge.tools.registry import TOOLS, ToolSpec
from plannerforge.workflows.context import Question

REAL = ("get_job", "cancel_job", "list_artifacts", "export_artifacts")
PNG = bytes.fromhex("89504e470d0a1a0a")


class Edit(Model):
    op: Literal["remove", "reroute"]
    vehicle_id: int | None = None


class EchoArguments(Arguments):
    """Say the arguments again."""

    text: str
    count: int = Field(1, ge=1, le=5, description="how often")
    share: float | None = Field(None, gt=0, lt=1)
    density: Literal["low", "medium", "high"] = "medium"
    tags: list[str] = Field(default=[])
    edits: list[Edit] = Field(default=[])


class EchoResult(Result):
    """The arguments."""

    said: EchoArguments
    note: str | None = None

    def answer(self) -> Answer:
        return Answer(self.said.model_dump_json())


class NoArguments(Arguments):
    """Take nothing."""


async def echo(arguments: EchoArguments, call: ToolCall) -> EchoResult:
    return EchoResult(said=arguments)


async def refuse(arguments: NoArguments, call: ToolCall) -> EchoResult:
    raise NotPossible("the lane ends", valid=["lane 1", "lane 2"], next_step="call describe_scenario")


async def break_down(arguments: NoArguments, call: ToolCall) -> EchoResult:
    raise KeyError("secret")


async def draw(arguments: NoArguments, call: ToolCall) -> ImageAnswer:
    path: Path = call.workspace.root / "pictures" / "p.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(PNG)
    return ImageAnswer("a pic\u200bture", (Image(path, "image/png"),), (picture_link(path, "image/png"),))


async def say_much(arguments: EchoArguments, call: ToolCall) -> EchoResult:
    return EchoResult(said=EchoArguments(text="a" * int(arguments.text)), note="structure")


async def draw_much(arguments: NoArguments, call: ToolCall) -> ImageAnswer:
    path: Path = call.workspace.root / "pictures" / "p.gif"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(bytes(MOST_IMAGE_BYTES // 2))
    return ImageAnswer("pictures", (Image(path, "image/gif"),) * 3, (picture_link(path, "image/gif"),))


async def tell_progress(arguments: NoArguments, call: ToolCall) -> EchoResult:
    for share in (0.2, 0.1, 0.2, 0.3, 1.0):
        await call.progress(share, f"at {share}")
    return EchoResult(said=EchoArguments(text="told"))


async def start_job(arguments: EchoArguments, call: ToolCall) -> EchoResult:
    import anyio

    from plannerforge.engine.execution.jobs import JobProgress
    from plannerforge.engine.workspace.recipe import Recipe

    async def work(progress: JobProgress) -> None:
        progress.add_result("run_0123456789ab")
        progress.report(0.5, "half")
        if arguments.text == "endless":
            await anyio.sleep_forever()

    job = call.start_job("batch", Recipe(tool="start_job", arguments={"text": arguments.text}), work)
    call.made("job", job.job_id)
    return EchoResult(said=EchoArguments(text=job.job_id))


async def make_long(arguments: EchoArguments, call: ToolCall) -> EchoResult:
    """Work of a job until the workspace has a file of this name; says the state of the job and its id."""
    import anyio

    from plannerforge.engine.execution.jobs import JobProgress
    from plannerforge.engine.workspace.recipe import Recipe

    async def work(progress: JobProgress) -> None:
        step = 0
        while not (call.workspace.root / arguments.text).exists():
            progress.report(step / (step + 1), f"step {step}")
            step += 1
            await anyio.sleep(0.05)

    recipe = Recipe(tool="make_long", arguments={"text": arguments.text})
    job = call.start_job("batch", recipe, work)
    call.made("job", job.job_id)
    job = await call.wait_for(job.job_id, 0.1)
    return EchoResult(said=EchoArguments(text=job.state), note=job.job_id)


async def ask_late(arguments: EchoArguments, call: ToolCall) -> EchoResult:
    """Ask as soon as the workspace has a file of this name."""
    import anyio

    while not (call.workspace.root / arguments.text).exists():
        await anyio.sleep(0.05)
    chosen = await call.ask(Question("Which?", ("left", "right")))
    return EchoResult(said=EchoArguments(text=chosen or "nothing chosen"))


@dataclass(frozen=True)
class ProbeSpec(ToolSpec):
    """A tool of these tests, given as a function instead of its location."""

    call: Callable[..., Any] = echo

    def load_function(self) -> Callable[..., Any]:
        return self.call


PROBES: tuple[ToolSpec, ...] = tuple(
    ProbeSpec(function.__name__, "Probe", "", read_only=True, call=function)
    for function in (echo, refuse, break_down, draw, say_much, draw_much, tell_progress, start_job)
) + tuple(ProbeSpec(function.__name__, "Probe", "", call=function) for function in (make_long, ask_late))


@pytest.fixture
def probe_tools(monkeypatch: pytest.MonkeyPatch) -> tuple[ToolSpec, ...]:
    """Return the tools of the test's servers: four real ones, then the probes."""
    tools = tuple(spec for spec in TOOLS if spec.name in REAL) + PROBES
    monkeypatch.setattr(assembly, "TOOLS", tools)
    return tools
