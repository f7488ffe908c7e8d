"""Two server processes import and search one workspace at the same time."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from support.builders import town_road
from support.server import StdioServer


def write_scenarios(folder: Path, *benchmark_ids: str, steps: int = 4) -> Path:
    folder.mkdir(exist_ok=True)
    for key in benchmark_ids:
        replace(town_road().cut(steps), benchmark_id=key).write(folder / f"{key}.xml")
    return folder


@pytest.fixture
def servers(tmp_path: Path) -> Iterator[list[StdioServer]]:
    started = [StdioServer(tmp_path, ("--workers", "1")) for _ in range(2)]
    yield started
    for server in started:
        server.kill()


def listed(answer: dict[str, Any]) -> set[str]:
    return {match["scenario_id"] for match in answer["matches"]}


def test_two_servers_import_at_once_and_one_searches_while_the_other_imports(
    servers: list[StdioServer], tmp_path: Path
) -> None:
    shared, both = ("ZAM_Both-1_1_T-1", "ZAM_Both-1_2_T-1"), []
    for place in (1, 2):
        folder = write_scenarios(tmp_path / str(place), *shared, f"ZAM_Own-{place}_1_T-1", f"ZAM_Own-{place}_2_T-1")
        both.append(write_scenarios(folder, "ZAM_Twice-1_1_T-1", steps=4 + place))
    with ThreadPoolExecutor(2) as threads:
        imported = list(
            threads.map(lambda server, folder: server.call("import_files", path=str(folder)), servers, both)
        )
        assert [answer["refused"] for answer in imported] == [0, 0], imported
        third = write_scenarios(tmp_path / "3", *(f"ZAM_Later-1_{index}_T-1" for index in range(1, 6)))
        searched = [servers[1].call("find_scenarios", text="a lorry in front", limit=50)]
        importing = threads.submit(servers[0].call, "import_files", path=str(third))
        while not importing.done():
            searched.append(servers[1].call("find_scenarios", text="a lorry in front", limit=50))
    assert importing.result()["added"] == 5
    assert all(isinstance(answer, dict) for answer in searched), searched
    seen = [
        listed(servers[0].call("find_scenarios", limit=50)),
        listed(servers[1].call("find_scenarios", text="a lorry in front", limit=50)),
    ]
    assert seen[0] == seen[1]
    assert len(seen[0]) == 2 + 4 + 1 + 5
    assert set(shared) <= seen[0]
