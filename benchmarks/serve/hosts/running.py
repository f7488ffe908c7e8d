"""Runs every client through the story, over standard input and HTTP, and records the results.

A client's driver (``drivers/``) is a small program in the client's own environment that uses only the client's public
interface. It receives the path of an input file, and writes an output file with what the client showed:

- input: ``command``, ``arguments`` and ``env`` of the server, or its ``url``. ``model`` (address of the scripted model)
  and ``model_name``. ``request`` (the user's request). ``helped`` (whether the roster's setting is used). ``packages``
  (a file next to the Node packages, from which they are found).
- output, at ``report``: ``said`` (what the user saw at the end), and ``progress`` (notes shown), if there is a place
  for them.
"""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

from ...faults.http_process import QUIET, http_process
from ...harness import Figures, LeftOut
from ..bench import ServeBench
from . import wire
from .environments import Environments, Installed, default_folder, quiet_variables
from .model import NAME, scripted_model
from .records import HostRecord, StoryRun, Transport, figures_of, table_of, write_page
from .roster import Host, chosen_hosts
from .story import REQUEST, faults_of, goes_on_after_refusals, stored_work, summary_of

_DRIVERS = Path(__file__).parent / "drivers"
_TIMEOUT_S = 420.0
"""Time limit of a client's story (chosen): the slowest takes a minute on a quiet machine."""
_LOG_TAIL = 1500


def measure(bench: ServeBench) -> Figures:
    """Install missing clients, run each through the story, and judge."""
    environments = Environments(bench.environments or default_folder(), bench.node)
    records = [_record(host, environments, bench) for host in chosen_hosts(bench.hosts)]
    sys.stderr.write(f"\n{table_of(records)}\n")
    if bench.page is not None:
        write_page(bench.page, records)
    return figures_of(records)


def _record(host: Host, environments: Environments, bench: ServeBench) -> HostRecord:
    try:
        installed = environments.installed(host)
    except LeftOut as reason:
        sys.stderr.write(f"{host.title} is left out: {reason}\n")
        return HostRecord(host, left_out=str(reason))
    runs: list[StoryRun] = []
    for transport in host.transports:
        for helped in (False, True) if host.help else (False,):
            run = _story_run(host, installed, bench, transport, helped)
            runs.append(run)
            sys.stderr.write(f"{host.title} by {transport}: {'; '.join(run.faults) or 'passed'}\n")
            if run.passed:
                break
    return HostRecord(host, installed.version, tuple(runs))


def _story_run(host: Host, installed: Installed, bench: ServeBench, transport: Transport, helped: bool) -> StoryRun:
    folder = bench.folder(f"{host.name}-{transport}{'-helped' if helped else ''}")
    workspace, copy = folder / "workspace", folder / "wire.txt"
    with ExitStack() as stack:
        model = stack.enter_context(scripted_model())
        settings = dict(host.help_settings) if helped else {}
        given: dict[str, Any] = {"model": model.url, "model_name": NAME, "request": REQUEST, "helped": helped}
        if transport == "http":
            given["url"] = stack.enter_context(http_process(folder, settings=settings)).url
        else:
            given |= _server_by_stdio(workspace, copy, settings)
        report = _driven(host, installed, folder, given)
    work, facts = stored_work(workspace), wire.wire_facts(copy)
    faults = faults_of(work, str(report.get("said", "")), facts.client)
    if faults and report.get("failure"):
        faults.append(str(report["failure"]))
    return StoryRun(
        transport,
        helped,
        tuple(faults),
        client=work.calls[-1].client if work.calls else "",
        revision=facts.revision,
        shown=summary_of(model.shown) if model.shown else None,
        asks_progress=facts.asks_progress,
        progress_shown=report.get("progress"),
        goes_on=goes_on_after_refusals(work.calls),
    )


def _server_by_stdio(workspace: Path, copy: Path, settings: Mapping[str, str]) -> dict[str, Any]:
    """Return the server's command for a client, behind a relay that copies all lines."""
    server = [sys.executable, "-P", "-m", "plannerforge", "serve", "--workspace", str(workspace)]
    paths = {"PYTHONPATH": os.environ["PYTHONPATH"]} if os.environ.get("PYTHONPATH") else {}
    variables = {**QUIET, **paths, **settings}
    return {"command": sys.executable, "arguments": ["-P", wire.__file__, str(copy), *server], "env": variables}


def _driven(host: Host, installed: Installed, folder: Path, given: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a driver's report; ``failure`` says how it ended if it failed."""
    task, report = folder / "task.json", folder / "report.json"
    given = {"url": "", "report": str(report), "packages": str(installed.folder / "node_modules" / "x"), **given}
    task.write_text(json.dumps(given), encoding="utf-8")
    variables = quiet_variables(folder / "home")
    variables["PATH"] = os.pathsep.join([*installed.path, variables.get("PATH", "")])
    with (folder / "driver.log").open("w") as log:
        driver = subprocess.Popen(
            [*installed.program, str(_DRIVERS / host.driver), str(task)],
            cwd=folder,
            env=variables,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        failure = ""
        try:
            if status := driver.wait(_TIMEOUT_S):
                failure = f"its driver ended with {status}"
        except subprocess.TimeoutExpired:
            failure = f"not done in {_TIMEOUT_S:g} s"
        finally:
            with suppress(ProcessLookupError):  # processes that the client left running end with it
                os.killpg(driver.pid, signal.SIGKILL)
            driver.wait()
    if failure:
        tail = (folder / "driver.log").read_text(encoding="utf-8", errors="replace")[-_LOG_TAIL:]
        sys.stderr.write(f"{host.title}: {failure}\n{tail}\n")
    written: dict[str, Any] = json.loads(report.read_text(encoding="utf-8")) if report.is_file() else {}
    return {**written, **({"failure": failure} if failure else {})}
