"""Planner programs that look for tokens (:mod:`.spy`), under servers that received secrets in every possible way.

Tokens and keys are in variables, in a token file and in the headers for a collector. One program is called once, one at
each step, and one stays alive. The bench searches everything that they read for each secret, in plain text and in
Base64.

Keys: ``secrets_seen`` (secrets that a program saw, by place); ``places_looked_at`` (environments, command lines and
descriptors); ``ancestors_seen`` (processes with an environment that a program could open); ``secrets_planted``.
"""

import base64
import hashlib
import json
import os
import stat
import sys
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import anyio
from mcp import Client, StdioServerParameters, stdio_client

from ...faults.http_process import QUIET, http_client, listening
from ...harness import Figures, ask
from .bench import StreetBench

_SCENARIO = "ZAM_Landmoor-17_1_T-1"
_SERVE = ("-m", "plannerforge", "serve")
_PROTOCOLS: Mapping[str, Mapping[str, Any]] = {
    "once": {},
    "stays": {"stays": True},
    "stepwise": {"protocol": "stepwise"},
}


_KINDS = ("token", "reading", "filed", "collector", "cloud", "model")
"""The server's secrets: tokens in a variable and in a file, headers for a collector, keys of other programs."""
_CONTROL, _WAYS = "control", 2
"""A secret that each program receives openly, so that a blind search is noticed; over HTTP and stdio."""


def _secret(name: str) -> str:
    """Return a secret that occurs nowhere else, not even in this program's text."""
    return hashlib.sha256(f"{name} {os.getpid()}".encode()).hexdigest()


def measure(bench: StreetBench) -> Figures:
    """Let programs look, and search their findings."""
    folder = bench.folder("secrets")
    secrets = {name: _secret(name) for name in (*_KINDS, _CONTROL)}
    anyio.run(_let_them_look, folder, secrets)
    looked, seen, environments = 0, list[str](), 0
    for report in sorted(folder.glob("seen-*")):
        for line in report.read_text(encoding="utf-8").splitlines():
            name, _, content = (bytes.fromhex(part) if part != " " else b"" for part in line.partition(" "))
            looked += 1
            environments += name.endswith(b" environ") and bool(content)
            found = [secret for secret, value in secrets.items() if any(form in content for form in _forms(value))]
            seen += [f"{report.name}: {secret} in {name.decode(errors='replace')}" for secret in found]
    controls = [text for text in seen if _CONTROL in text]
    seen = [text for text in seen if _CONTROL not in text]
    if len(controls) < len(_PROTOCOLS) * _WAYS:
        raise RuntimeError(f"the programs do not see the control secret: {controls}")
    for text in seen:
        sys.stderr.write(f"{text}\n")
    return {
        "secrets_seen": len(seen),
        "places_looked_at": looked,
        "ancestors_seen": environments,
        "secrets_planted": len(_KINDS),
    }


def _forms(secret: str) -> list[bytes]:
    """Return a secret in plain text, and in Base64 at each of three byte offsets."""
    forms = [secret.encode()]
    forms += [base64.b64encode(b"x" * shift + secret.encode())[4:-4] for shift in range(3)]
    return forms


async def _let_them_look(folder: Path, secrets: Mapping[str, str]) -> None:
    tokens = folder / "tokens"
    tokens.write_text(f"filed {secrets['filed']}\n", encoding="utf-8")
    tokens.chmod(stat.S_IRUSR | stat.S_IWUSR)
    given = {
        **os.environ,
        **QUIET,
        "PLANNERFORGE_HTTP_TOKENS": f"ci {secrets['token']},viewer {secrets['reading']} read-only",
        "OTEL_EXPORTER_OTLP_HEADERS": f"authorization=Bearer {secrets['collector']}",
        "AWS_SECRET_ACCESS_KEY": secrets["cloud"],
        "OPENAI_API_KEY": secrets["model"],
    }
    for way, connect in (("http", _by_http), ("stdio", _by_stdio)):
        planners = {
            name: {
                "summary": "looks around",
                "command": [
                    sys.executable,
                    "-S",
                    str(Path(__file__).with_name("spy.py")),
                    f"{folder}/seen-{way}-{name}",
                ],
                "environment": {"CONTROL": secrets[_CONTROL]},
                **more,
            }
            for name, more in _PROTOCOLS.items()
        }
        environment = {**given, "PLANNERFORGE_PLANNERS": json.dumps(planners)}
        environment["PLANNERFORGE_WORKSPACE"] = str(folder / way)
        async with connect(folder, environment, tokens, secrets["token"]) as client:
            await ask(client, "find_scenarios", limit=1)
            for name in planners:
                call = {"scenarios": [_SCENARIO], "configs": [name], "wait_s": 50}
                await client.call_tool("run_planner", call)


@asynccontextmanager
async def _by_http(folder: Path, environment: Mapping[str, str], tokens: Path, token: str) -> AsyncIterator[Client]:
    arguments = (*_SERVE, "--http", "--token-file", str(tokens))
    with listening(arguments, folder, environment, folder / "http.log") as server:
        async with http_client(server.url, token) as client:
            yield client


@asynccontextmanager
async def _by_stdio(folder: Path, environment: Mapping[str, str], tokens: Path, token: str) -> AsyncIterator[Client]:
    del tokens, token
    server = StdioServerParameters(command=sys.executable, args=list(_SERVE), env=dict(environment), cwd=str(folder))
    with (folder / "stdio.log").open("w") as errors:
        async with Client(stdio_client(server, errlog=errors), cache=None) as client:
            yield client
