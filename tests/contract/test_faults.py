"""A dead or unwanted worker costs one call, never the server."""

import os
import signal
from collections.abc import Callable
from typing import Any

import anyio
import psutil
import pytest
from support.server import Connect

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("starter_ready")]

of_no_era = pytest.mark.parametrize("era", ["auto"])
"""A worker's end has nothing to do with the protocol; only a cancellation travels in it."""
LONG_WORK: dict[str, Any] = {"density": "high", "duration_s": 120, "seed": 3}
LIGHT_WORK: dict[str, Any] = {"scenario_id": "ZAM_Fahrhausen-21_1_T-1"}
"""A scenario to describe, which a new worker does after few imports."""


@pytest.fixture
def warm_workers() -> None:
    """Each server has workers of its own here: they are counted and killed."""


class Strike:
    """Does something to the workers when the first progress of a call arrives."""

    def __init__(self, action: Any) -> None:
        self.action, self.struck = action, anyio.Event()

    async def __call__(self, progress: float, total: float | None, message: str | None) -> None:
        if not self.struck.is_set():
            self.struck.set()
            self.action()


@of_no_era
async def test_a_killed_worker_gives_an_error_and_the_next_call_works(
    connect: Connect, own_workers: Callable[[], set[psutil.Process]]
) -> None:
    def kill_all_workers() -> None:
        for process in own_workers():
            os.kill(process.pid, signal.SIGKILL)

    async with connect() as client:
        strike = Strike(kill_all_workers)
        result = await client.call_tool("generate_scenarios", LONG_WORK, progress_callback=strike)
        assert strike.struck.is_set()
        assert result.is_error
        assert "[worker_failure]" in result.content[0].text  # type: ignore[union-attr]
        again = await client.call_tool("describe_scenario", LIGHT_WORK)
        assert not again.is_error


async def test_a_cancelled_call_ends_its_worker_and_the_next_call_works(
    connect: Connect, own_workers: Callable[[], set[psutil.Process]]
) -> None:
    async with connect() as client:
        with anyio.CancelScope() as scope:
            await client.call_tool("generate_scenarios", LONG_WORK, progress_callback=Strike(scope.cancel))
        assert scope.cancelled_caught
        while own_workers():
            await anyio.sleep(0.05)
        again = await client.call_tool("describe_scenario", LIGHT_WORK)
        assert not again.is_error


@of_no_era
async def test_a_server_that_is_left_leaves_no_worker(
    connect: Connect, own_workers: Callable[[], set[psutil.Process]]
) -> None:
    async with connect() as client:
        await client.call_tool("describe_scenario", LIGHT_WORK)
        assert own_workers()
    assert not own_workers()
