"""Draws wrong calls, sends them, follows the first suggestion of each refusal, and counts."""

import hashlib
import json
import os
import random
import sys
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mcp import Client, StdioServerParameters, stdio_client
from mcp.types import CallToolResult, TextContent

from ...harness import Figures
from .following import first_suggestion
from .world import World, make_world
from .wrong_calls import wrong_calls
from .wrong_edits import edit_of, wrong_edits

_FILES = 8
"""Number of the folder's scenarios for the calls."""
_MOST_WAITED_S = 600


async def measure_advice(
    folder: Path,
    half: str = "odd",
    seed: int = 37,
    refusals: int = 240,
    tools: Sequence[str] | None = None,
    kinds: Sequence[str] | None = None,
) -> Figures:
    """Draw refusals and follow their first suggestions; figures by the keys that ``__main__`` explains.

    Args:
        folder: scenarios to draw on.
        half: ``odd`` or ``even``: the half of the folder by the digest of names; ``both``: all of it.
        seed: of the draw.
        refusals: how many are drawn.
        tools: only these; all if it is None.
        kinds: only kinds of faults that have one of these in their names; all if it is None.
    """
    rng = random.Random(seed)  # noqa: S311 - a draw, no secret
    paths = sorted(path for path in folder.rglob("*.xml") if half == "both" or _half_of(path) == half)
    files = rng.sample(paths, min(_FILES, len(paths)))
    counts: Counter[str] = Counter()
    by_tool: dict[str, Counter[str]] = {}
    edits = (("modify_scenario", kind, edit_of(make)) for kind, make in wrong_edits().items())
    draws = [
        (tool, kind, draw)
        for tool, kind, draw in (*edits, *wrong_calls())
        if (tools is None or tool in tools) and (kinds is None or any(word in kind for word in kinds))
    ]
    with tempfile.TemporaryDirectory() as name:
        base = Path(name).resolve()
        async with _server(base) as client:
            world = await make_world(client, base / "root", files, seed)
            pending: list[tuple[str, str, Any]] = []
            while counts["refusals"] < refusals and counts["drawn"] < 4 * refusals:
                if not pending:
                    pending = rng.sample(draws, len(draws))
                tool, kind, draw = pending.pop()
                arguments = draw(world, rng)
                counts["drawn"] += 1
                if arguments is None:
                    continue
                verdict = await _tried(client, world, tool, kind, arguments)
                counts[verdict] += 1
                if verdict != "not_refused":
                    counts["refusals"] += 1
                    by_tool.setdefault(tool, Counter())[verdict] += 1
    for tool, verdicts in sorted(by_tool.items()):
        sys.stderr.write(f"{tool}: {dict(verdicts)}\n")
    asked = max(counts["refusals"], 1)
    return {
        "seed": seed,
        "refusals": counts["refusals"],
        "advice_succeeds": round((counts["mends"] + counts["looks_up"]) / asked, 4),
        "advice_mends": round(counts["mends"] / asked, 4),
        "advice_repeated": counts["repeated"],
        "advice_names_ego": counts["names_ego"],
        "not_refused": counts["not_refused"],
    }


def _half_of(path: Path) -> str:
    return "odd" if hashlib.sha256(path.name.encode()).digest()[0] % 2 else "even"


def _server(base: Path) -> Client:
    """Open a client of a server in its own process, over standard input and output, in an empty workspace."""
    (base / "root").mkdir()
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PLANNERFORGE_")}
    settings = {"STARTER": "false", "MAPS_ONLINE": "offline", "WARM_UP": "false", "ROOTS": str(base / "root")}
    environment |= {f"PLANNERFORGE_{name}": value for name, value in settings.items()}
    serve = ["-m", "plannerforge", "serve", "--workspace", str(base / "workspace")]
    server = StdioServerParameters(command=sys.executable, args=serve, env=environment, cwd=str(base / "root"))
    return Client(stdio_client(server, errlog=(base / "log").open("w")), read_timeout_seconds=_MOST_WAITED_S)


async def _tried(client: Client, world: World, tool: str, kind: str, arguments: Mapping[str, Any]) -> str:
    """Return the result of a wrong call: the verdict on its first suggestion. Report failed ones on standard error."""
    refused = await client.call_tool(tool, dict(arguments))
    if not refused.is_error:
        await _cancel(client, refused)
        return "not_refused"
    text = _text_of(refused)
    head = f"{tool} {kind} {json.dumps(arguments, ensure_ascii=False)}\n    {text}\n"
    suggested = first_suggestion(text, tool, arguments)
    if suggested is None:
        sys.stderr.write(f"NO CALL: {head}")
        return "no_call"
    if _names_ego(world, suggested.arguments):
        sys.stderr.write(f"NAMES THE EGO: {head}")
        return "names_ego"
    if suggested.tool == tool and suggested.arguments == dict(arguments):
        sys.stderr.write(f"REPEATED: {head}")
        return "repeated"
    answer = await client.call_tool(suggested.tool, dict(suggested.arguments))
    await _cancel(client, answer)
    if answer.is_error:
        again = first_suggestion(_text_of(answer), suggested.tool, suggested.arguments)
        verdict = "repeated" if again == suggested else "fails"
        sys.stderr.write(f"{verdict.upper()}: {head}    -> {_text_of(answer)}\n")
        return verdict
    if suggested.tool == tool:
        return "mends"
    sys.stderr.write(f"LOOKS UP: {head}")
    return "looks_up"


def _text_of(result: CallToolResult) -> str:
    return "\n".join(block.text for block in result.content if isinstance(block, TextContent))


def _names_ego(world: World, arguments: Mapping[str, Any]) -> bool:
    """Return True if a call names the ego as a vehicle of the traffic."""
    stage = next((one for one in world.stages if one.scenario_id == arguments.get("scenario_id")), None)
    egos = {"ego"} if stage is None else {"ego", *stage.ego_ids}
    named = {
        str(word).lower().removeprefix("!")
        for edit in arguments.get("edits", [])
        if isinstance(edit, dict)
        for word in edit.get("vehicles", [])
    }
    return bool(egos & named)


async def _cancel(client: Client, answer: CallToolResult) -> None:
    """Cancel the job of an answer, so that it does not disturb later calls."""
    given = answer.structured_content or {}
    if given.get("job_id") and given.get("state") == "running":
        await client.call_tool("cancel_job", {"job_id": given["job_id"]})
