"""Traces and metrics: one span a call, of the SDK, with what workers and jobs did below it; nothing where it is off."""

import http.server
import json
import os
import socket
import subprocess
import sys
import threading
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import anyio
import pytest
from mcp import Client, StdioServerParameters
from mcp.client.stdio import stdio_client
from opentelemetry.sdk.metrics import MeterProvider
from opentelemetry.sdk.metrics.export import InMemoryMetricReader
from opentelemetry.sdk.trace import TracerProvider
from opentelemetry.sdk.trace.export import SimpleSpanProcessor
from opentelemetry.sdk.trace.export.in_memory_span_exporter import InMemorySpanExporter
from opentelemetry.trace import StatusCode
from support.server import GUARD_S

from plannerforge.engine.execution import Executor, JobRunner, JobStore, Operation
from plannerforge.engine.execution.jobs import JobProgress
from plannerforge.engine.workspace import Recipe, Workspace
from plannerforge.schemas.base import Model
from plannerforge.schemas.errors import NotPossible, PlannerForgeError, WorkerFailure
from plannerforge.server.assembly import create_server
from plannerforge.server.observing.logs import CallNames, EndedCall
from plannerforge.server.observing.telemetry import LAST_S, Telemetry
from plannerforge.server.settings import Settings

TRACE, PARENT = "0af7651916cd43dd8448eb211c80319c", "b7ad6b7169203331"


class Nothing(Model):
    pass


class Memory:
    """Telemetry that keeps what it is told."""

    def __init__(self) -> None:
        self.spans, self.reader = InMemorySpanExporter(), InMemoryMetricReader()
        self.traces = TracerProvider()
        self.traces.add_span_processor(SimpleSpanProcessor(self.spans))
        self.telemetry = Telemetry(self.traces, MeterProvider([self.reader]))

    def points(self) -> dict[str, list[Any]]:
        """The points of each metric now."""
        data = self.reader.get_metrics_data()
        assert data is not None
        return {
            metric.name: list(metric.data.data_points)
            for resource in data.resource_metrics
            for scope in resource.scope_metrics
            for metric in scope.metrics
        }


class Slow:
    """An executor that works until it is told to end, or fails."""

    capacity, notice = 1, "as it is set up"

    def __init__(self, error: PlannerForgeError | None = None) -> None:
        self.end, self.error = anyio.Event(), error

    async def run(self, operation: Any, request: Any, *, on_progress: Any = None) -> Any:
        await self.end.wait()
        if self.error is not None:
            raise self.error
        return request


OPERATION = Operation("plannerforge.engine.somewhere:do_it", Nothing, Nothing)


@pytest.mark.anyio
async def test_operations_have_spans_and_their_queue_is_counted() -> None:
    memory, slow = Memory(), Slow()
    inner: Executor = slow  # type: ignore[assignment]
    watched = memory.telemetry.watched(inner, lambda: 3)
    assert (watched.capacity, watched.notice) == (1, "as it is set up")
    async with anyio.create_task_group() as tasks:
        for _ in range(3):
            tasks.start_soon(watched.run, OPERATION, Nothing())
        await anyio.wait_all_tasks_blocked()
        points = memory.points()
        compute = {name: next(point.value for point in points[name] if point.attributes["lane"] == "compute")
                   for name in ("plannerforge.operations.waiting", "plannerforge.operations.running")}  # fmt: skip
        assert compute == {"plannerforge.operations.waiting": 2, "plannerforge.operations.running": 1}
        assert [point.value for point in points["plannerforge.workers"]] == [3]
        slow.end.set()
    (duration,) = memory.points()["plannerforge.operation.duration"]
    assert (duration.count, dict(duration.attributes)) == (
        3,
        {"plannerforge.operation": "do_it", "plannerforge.lane": "compute"},
    )
    assert [span.name for span in memory.spans.get_finished_spans()] == ["operation do_it"] * 3


@pytest.mark.anyio
async def test_an_operation_that_fails_is_reported_with_the_code_of_its_error() -> None:
    memory, slow = Memory(), Slow(WorkerFailure("it died"))
    inner: Executor = slow  # type: ignore[assignment]
    slow.end.set()
    with pytest.raises(WorkerFailure):
        await memory.telemetry.watched(inner, int).run(OPERATION, Nothing())
    (span,) = memory.spans.get_finished_spans()
    assert span.status.status_code is StatusCode.ERROR
    assert span.attributes is not None
    assert span.attributes["error.type"] == WorkerFailure.code
    (duration,) = memory.points()["plannerforge.operation.duration"]
    assert duration.attributes["error.type"] == WorkerFailure.code


@pytest.mark.anyio
async def test_a_job_has_a_span_below_the_call_that_began_it_and_is_counted_while_it_runs(tmp_path: Path) -> None:
    memory, workspace = Memory(), Workspace(tmp_path / "workspace")
    store, go_on = JobStore(workspace.database), anyio.Event()

    async def in_place(function: Any, *arguments: Any) -> None:
        await function(*arguments)

    async def work(progress: JobProgress) -> None:
        await go_on.wait()
        raise NotPossible("it cannot be done")

    async with anyio.create_task_group() as tasks:
        runner = JobRunner(store, tasks, memory.telemetry.jobs_apart(in_place, store))
        with memory.traces.get_tracer("test").start_as_current_span("the call") as call:
            job = runner.start("batch", Recipe(tool="run_planner"), work)
        await anyio.wait_all_tasks_blocked()
        assert [point.value for point in memory.points()["plannerforge.jobs"]] == [1]
        go_on.set()
    span = next(span for span in memory.spans.get_finished_spans() if span.name == "job")
    assert span.parent is not None
    assert span.parent.span_id == call.get_span_context().span_id
    assert dict(span.attributes or {}) == {"plannerforge.job.id": job.job_id, "plannerforge.job.state": "failed"}
    assert span.status.status_code is StatusCode.ERROR
    assert [point.value for point in memory.points()["plannerforge.jobs"]] == [0]


def test_calls_and_errors_are_counted_and_timed_by_tool() -> None:
    memory = Memory()
    with memory.traces.get_tracer("test").start_as_current_span("tools/call echo"):
        for outcome in ("ok", "not_possible", "asks"):
            memory.telemetry.call_ended(EndedCall(CallNames("id", "echo", "host"), outcome, 0.2))
    points = memory.points()
    assert [point.value for point in points["plannerforge.calls"]] == [3]
    ((errors, about),) = [(point.value, point.attributes) for point in points["plannerforge.call.errors"]]
    assert (errors, about["error.type"], about["gen_ai.tool.name"]) == (1, "not_possible", "echo")
    assert sum(point.count for point in points["mcp.server.operation.duration"]) == 3
    (span,) = memory.spans.get_finished_spans()
    assert dict(span.attributes or {}) == {
        "plannerforge.call.id": "id",
        "plannerforge.client": "host",
        "plannerforge.outcome": "asks",
    }


@pytest.fixture
def collector() -> Iterator[tuple[str, dict[str, list[Any]]]]:
    """A collector on the loopback: its address, and what was sent, by path."""
    received: dict[str, list[Any]] = defaultdict(list)

    class Collector(http.server.BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            import gzip

            body = self.rfile.read(int(self.headers["Content-Length"]))
            packed = self.headers.get("Content-Encoding") == "gzip"
            received[self.path].append(json.loads(gzip.decompress(body) if packed else body))
            self.send_response(200)
            self.send_header("Content-Type", "application/json")
            self.end_headers()
            self.wfile.write(b"{}")

        def log_message(self, *args: object) -> None:
            del args

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Collector)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{server.server_address[1]}", received
    server.shutdown()
    thread.join()
    server.server_close()


@pytest.mark.anyio
@pytest.mark.usefixtures("starter_ready")
async def test_a_server_sends_one_trace_of_a_call_below_that_of_its_client(
    collector: tuple[str, dict[str, list[Any]]], settings: Settings, tmp_path: Path
) -> None:
    address, received = collector
    serve = ["-m", "plannerforge", "serve", "--no-warm-up", "--workers", "1", "--telemetry-endpoint", address]
    server = StdioServerParameters(
        command=sys.executable,
        args=[*serve, "--workspace", str(settings.workspace)],
        cwd=tmp_path,
        env=dict(os.environ),
    )
    meta: Any = {"traceparent": f"00-{TRACE}-{PARENT}-01"}
    async with Client(stdio_client(server)) as client:
        await client.call_tool("describe_scenario", {"scenario_id": "ZAM_Fahrhausen-21_1_T-1"}, meta=meta)
        await client.call_tool("get_job", {"job_id": "job_none"})
    sent = [
        span
        for request in received["/v1/traces"]
        for resource in request["resourceSpans"]
        for scope in resource["scopeSpans"]
        for span in scope["spans"]
    ]
    of_trace = {span["name"]: span for span in sent if span["traceId"] == TRACE}
    call = of_trace.pop("tools/call describe_scenario")
    assert call["parentSpanId"] == PARENT
    assert of_trace, "what a worker did for the call"
    assert {span["parentSpanId"] for span in of_trace.values()} == {call["spanId"]}
    assert all(name.startswith("operation ") for name in of_trace)
    about = {attribute["key"]: attribute["value"] for attribute in call["attributes"]}
    assert about["plannerforge.outcome"] == {"stringValue": "ok"}
    assert [span["name"] for span in sent].count("tools/call get_job") == 1
    metrics = {
        metric["name"]
        for request in received["/v1/metrics"]
        for resource in request["resourceMetrics"]
        for scope in resource["scopeMetrics"]
        for metric in scope["metrics"]
    }
    assert {"plannerforge.calls", "plannerforge.call.errors", "plannerforge.workers"} <= metrics


@pytest.fixture(params=["hangs", "refuses"])
def collector_that_takes_nothing(request: pytest.FixtureRequest) -> Iterator[str]:
    """The address of a collector that accepts a connection and never answers, or of none at all."""
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        if request.param == "hangs":
            listening.listen()
        yield f"http://127.0.0.1:{listening.getsockname()[1]}"


def test_the_end_waits_at_most_a_second_for_an_unresponsive_collector(
    collector_that_takes_nothing: str, tmp_path: Path
) -> None:
    program = f"""
import time
from plannerforge.server.observing.telemetry import Telemetry
from opentelemetry import trace
telemetry = Telemetry.sending_to({collector_that_takes_nothing!r})
trace.get_tracer("test").start_span("span").end()
started = time.monotonic()
telemetry.close()
print(time.monotonic() - started)
"""
    ended = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=True, timeout=GUARD_S
    )
    assert float(ended.stdout) < 2 * LAST_S, ended.stderr
    assert "did not take the last traces" in ended.stderr


def test_without_its_packages_the_setting_gives_the_install_command(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "opentelemetry.exporter.otlp.json.http.trace_exporter", None)
    monkeypatch.setitem(sys.modules, "opentelemetry.exporter.otlp.json.http.metric_exporter", None)
    settings = Settings(workspace=tmp_path / "workspace", telemetry_endpoint="http://127.0.0.1:4318")
    with pytest.raises(NotPossible, match=r"pip install 'plannerforge-mcp\[telemetry\]'"):
        create_server(settings)
