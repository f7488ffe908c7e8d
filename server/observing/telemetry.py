"""Traces and metrics with OpenTelemetry, sent to ``telemetry_endpoint``; if it is not set, nothing here is imported.

As soon as a provider is set, the MCP SDK creates a span for each request, below the request's trace (``traceparent`` in
``_meta``). That span gets the call's attributes, and the spans of its operations in workers and of its job are below
it.
"""

import logging
import threading
import time
from collections import Counter
from collections.abc import Awaitable, Callable, Iterable
from typing import TYPE_CHECKING, Any

from opentelemetry import trace
from opentelemetry.metrics import CallbackOptions, Observation
from opentelemetry.trace import SpanKind, StatusCode

from ... import __version__
from ...engine.execution import (
    Executor,
    ExecutorAround,
    JobStore,
    Lane,
    OnProgress,
    Operation,
    Request,
    Response,
    no_progress,
)
from ...schemas.errors import NotPossible, PlannerForgeError
from .logs import EndedCall

if TYPE_CHECKING:
    from opentelemetry.sdk.metrics import MeterProvider
    from opentelemetry.sdk.trace import TracerProvider

    from ...engine.execution import RunApart

logger = logging.getLogger(__name__)
_NAME = "plannerforge"
_TIMEOUT_S, _DELAY_MS, _INTERVAL_MS = 5.0, 1_000, 15_000
"""Timeout of one message to the collector, and interval of spans and metrics; chosen."""
LAST_S = 1.0
"""How long a stopping server waits for the collector; chosen: a host kills it after two seconds."""
_SECONDS = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1, 2.5, 5, 10, 25, 50, 100, 300)
"""Bounds of the histograms, in seconds: a call that reads takes 0.003, an operation has 300."""
_OK = frozenset({"ok", "asks"})


class Telemetry:
    """Reports calls, jobs, operations and workers to its providers."""

    def __init__(self, traces: "TracerProvider", metrics: "MeterProvider") -> None:
        self._traces, self._metrics = traces, metrics
        self._tracer = traces.get_tracer(_NAME, __version__)
        meter = metrics.get_meter(_NAME, __version__)
        self._calls = meter.create_counter("plannerforge.calls", "{call}", "Calls of tools that have ended")
        self._errors = meter.create_counter("plannerforge.call.errors", "{call}", "Calls that were refused or failed")
        self._call_s = meter.create_histogram(
            "mcp.server.operation.duration", "s", "Time of calls", explicit_bucket_boundaries_advisory=_SECONDS
        )
        self._operation_s = meter.create_histogram(
            "plannerforge.operation.duration",
            "s",
            "Time of operations in workers, including their wait",
            explicit_bucket_boundaries_advisory=_SECONDS,
        )
        self._jobs = meter.create_up_down_counter("plannerforge.jobs", "{job}", "Jobs of this server that run")
        self._meter = meter
        self._under_way: Counter[Lane] = Counter()
        self._lock = threading.Lock()

    @classmethod
    def sending_to(cls, endpoint: str) -> "Telemetry":
        """Return telemetry to a collector by OTLP over HTTP, including the spans of the MCP SDK.

        Args:
            endpoint: its address without the path of a signal, such as ``http://127.0.0.1:4318``.

        Raises:
            NotPossible: the required packages are not installed.
        """
        try:
            from opentelemetry.exporter.otlp.json.http.metric_exporter import OTLPMetricExporter
            from opentelemetry.exporter.otlp.json.http.trace_exporter import OTLPSpanExporter
            from opentelemetry.sdk.metrics import MeterProvider
            from opentelemetry.sdk.metrics.export import PeriodicExportingMetricReader
            from opentelemetry.sdk.resources import Resource
            from opentelemetry.sdk.trace import TracerProvider
            from opentelemetry.sdk.trace.export import BatchSpanProcessor
        except ImportError as error:
            raise NotPossible(
                f"telemetry_endpoint is {endpoint}, but the required packages are not installed",
                next_step="pip install 'plannerforge-mcp[telemetry]', or remove the setting",
            ) from error
        resource = Resource.create({"service.name": _NAME, "service.version": __version__})
        address = endpoint.rstrip("/")
        traces = TracerProvider(resource=resource, shutdown_on_exit=False)  # ``close`` ends it
        spans = OTLPSpanExporter(endpoint=f"{address}/v1/traces", timeout=_TIMEOUT_S)
        traces.add_span_processor(BatchSpanProcessor(spans, schedule_delay_millis=_DELAY_MS))
        sender = OTLPMetricExporter(endpoint=f"{address}/v1/metrics", timeout=_TIMEOUT_S)
        metrics = MeterProvider([PeriodicExportingMetricReader(sender, _INTERVAL_MS)], resource, shutdown_on_exit=False)
        trace.set_tracer_provider(traces)  # the MCP SDK looks for it there
        return cls(traces, metrics)

    def close(self) -> None:
        """Send the remaining data and shut down, within a second, even if the collector does not answer.

        The SDK's own shutdown retries and waits for the traces first, and then for the metrics: seven seconds if a
        collector hangs.
        """
        ends = [threading.Thread(target=each.shutdown, daemon=True) for each in (self._traces, self._metrics)]
        for end in ends:
            end.start()
        until = time.monotonic() + LAST_S
        for end in ends:
            end.join(max(0.0, until - time.monotonic()))
        if any(end.is_alive() for end in ends):
            logger.warning("the collector did not take the last traces and metrics within %g s", LAST_S)

    def call_ended(self, call: EndedCall) -> None:
        """Count a call, and add its attributes to the span of its request."""
        about = {"gen_ai.tool.name": call.names.tool}
        failed = {} if call.outcome in _OK else {"error.type": call.outcome}
        self._calls.add(1, about)
        if failed:
            self._errors.add(1, about | failed)
        self._call_s.record(call.duration_s, {"mcp.method.name": "tools/call"} | about | failed)
        span = trace.get_current_span()
        if span.is_recording():
            span.set_attributes(
                {
                    "plannerforge.call.id": call.names.call_id,
                    "plannerforge.client": call.names.client,
                    "plannerforge.outcome": call.outcome,
                }
            )

    def watched(self, executor: Executor, workers: Callable[[], int]) -> Executor:
        """Return the executor with a span for each operation.

        Args:
            workers: returns the current number of worker processes.
        """
        most: dict[Lane, int] = {"compute": executor.capacity, "retrieval": 1}

        def waiting(options: CallbackOptions) -> Iterable[Observation]:
            del options
            return [Observation(max(0, self._under_way[lane] - most[lane]), {"lane": lane}) for lane in most]

        def running(options: CallbackOptions) -> Iterable[Observation]:
            del options
            return [Observation(min(most[lane], self._under_way[lane]), {"lane": lane}) for lane in most]

        def processes(options: CallbackOptions) -> Iterable[Observation]:
            del options
            return [Observation(workers())]

        for name, callback, unit, words in (
            ("plannerforge.operations.waiting", waiting, "{operation}", "Operations that wait for a worker"),
            ("plannerforge.operations.running", running, "{operation}", "Operations that a worker carries out"),
            ("plannerforge.workers", processes, "{process}", "Worker processes"),
        ):
            self._meter.create_observable_gauge(name, [callback], unit, words)
        return _WatchedExecutor(executor, self._carried_out)

    def jobs_apart(self, run_apart: "RunApart", store: JobStore) -> "RunApart":
        """Return a runner of jobs that gives each a span below the call that started it."""

        async def run(function: Callable[..., Awaitable[None]], job_id: str, *arguments: object) -> None:
            async def in_its_thread() -> None:
                with self._tracer.start_as_current_span("job", attributes={"plannerforge.job.id": job_id}) as span:
                    self._jobs.add(1)
                    try:
                        await function(job_id, *arguments)
                        state = store.get(job_id).state
                        span.set_attribute("plannerforge.job.state", state)
                        if state == "failed":
                            span.set_status(StatusCode.ERROR)
                    finally:
                        self._jobs.add(-1)

            await run_apart(in_its_thread)

        return run

    async def _carried_out(
        self, executor: Executor, operation: Operation[Request, Response], request: Request, on_progress: OnProgress
    ) -> Response:
        about: dict[str, Any] = {"plannerforge.operation": operation.name, "plannerforge.lane": operation.lane}
        failed: dict[str, str] = {}
        started = time.perf_counter()
        self._count(operation.lane, 1)
        try:
            with self._tracer.start_as_current_span(
                f"operation {operation.name}", kind=SpanKind.INTERNAL, attributes=about, record_exception=False
            ) as span:
                try:
                    return await executor.run(operation, request, on_progress=on_progress)
                except BaseException as raised:
                    code = raised.code if isinstance(raised, PlannerForgeError) else type(raised).__name__
                    failed = {"error.type": code}
                    span.set_attributes(failed)
                    raise
        finally:
            self._count(operation.lane, -1)
            self._operation_s.record(time.perf_counter() - started, about | failed)

    def _count(self, lane: Lane, change: int) -> None:
        with self._lock:
            self._under_way[lane] += change


class _WatchedExecutor(ExecutorAround):
    """An executor that reports its operations."""

    def __init__(self, inner: Executor, run: Callable[..., Awaitable[Any]]) -> None:
        super().__init__(inner)
        self._run = run

    async def run(
        self, operation: Operation[Request, Response], request: Request, *, on_progress: OnProgress = no_progress
    ) -> Response:
        """Run the operation in the wrapped executor."""
        response: Response = await self._run(self._inner, operation, request, on_progress)
        return response
