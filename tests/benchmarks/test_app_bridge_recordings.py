"""What the judge of pages shows where there are no public recordings.

These tests stand apart from those with a browser: Playwright keeps an event loop in its thread while a browser is open.
"""

from pathlib import Path

import pytest
from support.server import Connect

from benchmarks.serve import app_bridge
from plannerforge.server.settings import Settings


@pytest.mark.anyio
@pytest.mark.usefixtures("starter_ready")
async def test_starter_scenarios_replace_missing_recordings(
    connect: Connect, settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PLANNERFORGE_SHARED", str(tmp_path / "none"))
    async with connect(settings) as client:
        found = await app_bridge.recordings(client, tmp_path)
        for name in found:
            assert not (await client.call_tool("describe_scenario", {"scenario_id": name})).is_error
    assert len(set(found)) == 3
