"""Notifies subscribed clients of changes in the workspace: progress and ends of jobs, and new artifacts.

Several servers share one workspace, so changes are read from its database, not only from this server's own jobs.
Nothing is read while no client listens.
"""

import logging
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field

import anyio
from mcp.server.session import ServerSession
from mcp.server.subscriptions import InMemorySubscriptionBus, ResourcesListChanged, ResourceUpdated, ServerEvent

from ..engine.execution import CallThreads
from ..resources.templates import SCHEME
from ..schemas.errors import PlannerForgeError
from ..workflows.context import Services

logger = logging.getLogger(__name__)
_INTERVAL_S = 0.5
"""Interval of checks; chosen: as often as progress is reported."""
_MOST_FOLLOWED = 1_000
"""Maximum stored subscriptions of sessions; chosen: the oldest is removed first, because sessions may end silently."""


@dataclass(frozen=True)
class _Seen:
    """The state at the last check: the newest artifact, and running or recently ended jobs."""

    newest: int
    jobs: dict[str, object] = field(default_factory=dict)


class WorkspaceNews:
    """Notifies subscribers of changes.

    Clients subscribe with ``subscriptions/listen`` since protocol 2026-07-28, and ``resources/subscribe`` before that.
    """

    def __init__(self) -> None:
        self._bus = InMemorySubscriptionBus()
        self._listeners = 0
        self._followed: OrderedDict[tuple[str, str], ServerSession] = OrderedDict()
        self._wanted = anyio.Event()

    async def publish(self, event: ServerEvent) -> None:
        """Send an event to all listeners, and to the sessions that follow its resource."""
        await self._bus.publish(event)
        if isinstance(event, ResourceUpdated):
            for (_, uri), session in list(self._followed.items()):
                if uri == event.uri:
                    await session.send_resource_updated(uri)

    def subscribe(self, listener: Callable[[ServerEvent], None]) -> Callable[[], None]:
        """Register a listener for events; return the function that unregisters it."""
        unsubscribe = self._bus.subscribe(listener)
        self._listeners += 1
        self._wanted.set()
        ended = False

        def end() -> None:
            nonlocal ended
            self._listeners -= not ended
            ended = True
            unsubscribe()

        return end

    def follow(self, client: str, uri: str, session: ServerSession) -> None:
        """Notify a client's session of changes to a resource."""
        self._followed[client, uri] = session
        self._followed.move_to_end((client, uri))
        if len(self._followed) > _MOST_FOLLOWED:
            self._followed.popitem(last=False)
        self._wanted.set()

    def forget(self, client: str, uri: str) -> None:
        """Stop notifying a client about a resource."""
        self._followed.pop((client, uri), None)

    async def watch(self, services: Services, threads: CallThreads) -> None:
        """Check the workspace forever while a client listens, and report changes."""
        seen: _Seen | None = None
        while True:
            if not self._listeners and not self._followed:
                seen, self._wanted = None, anyio.Event()
                await self._wanted.wait()
            now: _Seen | None = seen
            try:
                now = await threads.run(_look, services)
            except PlannerForgeError as error:
                logger.warning("no news of the workspace: %s", error.text)
            for event in _changes(seen, now):
                await self.publish(event)
            seen = now
            await anyio.sleep(_INTERVAL_S)


async def _look(services: Services) -> _Seen:
    jobs = services.jobs.store.lately()
    return _Seen(
        services.workspace.newest_sequence(),
        {job.job_id: (job.state, job.share, job.message, job.results) for job in jobs},
    )


def _changes(before: _Seen | None, now: _Seen | None) -> list[ServerEvent]:
    if before is None or now is None:
        return []
    changed = [job_id for job_id, state in now.jobs.items() if before.jobs.get(job_id) != state]
    events: list[ServerEvent] = [ResourceUpdated(f"{SCHEME}job/{job_id}") for job_id in changed]
    return [*events, ResourcesListChanged()] if now.newest != before.newest else events
