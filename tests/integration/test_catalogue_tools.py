"""Import, search and describe through a real client session."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from mcp import Client
from support.builders import Problem, town_road
from support.server import Connect

from plannerforge.server.settings import Settings
from plannerforge.server.tokens import count_tokens

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("starter_ready")]


async def call(client: Client, tool: str, **arguments: Any) -> tuple[bool, str, dict[str, Any]]:
    result = await client.call_tool(tool, arguments)
    return bool(result.is_error), str(result.content[0].text), result.structured_content or {}  # type: ignore[union-attr]


@pytest.fixture
def bare(settings: Settings, tmp_path: Path) -> Settings:
    """No starter catalogue."""
    return settings.model_copy(update={"starter": False, "workspace": tmp_path / "bare"})


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A good file, a broken one, and a link that leads outside the roots."""
    folder = tmp_path / "files"
    folder.mkdir()
    town_road().write(folder / "good.xml")
    (folder / "broken.xml").write_text("<commonRoad>", encoding="utf-8")
    (folder / "outside.xml").symlink_to("/etc/hostname")
    return folder


async def test_a_folder_is_imported_without_refused_files(connect: Connect, bare: Settings, folder: Path) -> None:
    async with connect(bare) as client:
        failed, text, first = await call(client, "import_files", path=str(folder))
        assert not failed, text
        assert (first["added"], first["refused"]) == (1, 2)
        reasons = {item["file"]: item["reason"] for item in first["refusals"]}
        assert "well-formed" in reasons["broken.xml"]
        assert "outside" in reasons["outside.xml"]
        _, _, second = await call(client, "import_files", path=str(folder))
        assert (second["added"], second["reused"]) == (0, 1)
        _, text, found = await call(client, "find_scenarios", city="builder", obstacles=["truck=1"])
        assert [match["scenario_id"] for match in found["matches"]] == ["ZAM_Builder-1_1_T-1"]
        assert "ZAM_Builder-1_1_T-1" in text
        failed, text, _ = await call(client, "describe_scenario", scenario_id="ZAM_Builder-1_1_T-1")
        assert not failed
        assert "30 m ahead, same lane" in text


async def test_a_changed_file_is_a_new_version_and_replaces_the_old_one(
    connect: Connect, bare: Settings, folder: Path
) -> None:
    async with connect(bare) as client:
        _, _, first = await call(client, "import_files", path=str(folder / "good.xml"))
        town_road().with_vehicles().write(folder / "good.xml")
        _, text, second = await call(client, "import_files", path=str(folder / "good.xml"))
        old, new = (answer["items"][0]["artifact_id"] for answer in (first, second))
        assert old != new
        assert f"new version of {old}" in text
        _, _, found = await call(client, "find_scenarios")
        assert [match["scenario_id"] for match in found["matches"]] == [new]
        _, _, again = await call(client, "import_files", path=str(folder / "good.xml"))
        assert (again["added"], again["items"][0]["artifact_id"]) == (0, new)
        failed, text, _ = await call(client, "describe_scenario", scenario_id=old)
        assert not failed, text


async def test_going_back_to_an_earlier_content_lists_it_again(connect: Connect, bare: Settings, folder: Path) -> None:
    async with connect(bare) as client:

        async def imported() -> dict[str, Any]:
            _, _, answer = await call(client, "import_files", path=str(folder / "good.xml"))
            _, _, found = await call(client, "find_scenarios")
            assert [match["scenario_id"] for match in found["matches"]] == [answer["items"][0]["artifact_id"]]
            return dict(answer["items"][0])

        town_road().write(folder / "good.xml")
        first = await imported()
        town_road().with_vehicles().write(folder / "good.xml")
        changed = await imported()
        town_road().write(folder / "good.xml")
        back = await imported()
        assert (back["artifact_id"], back["reused"]) == (first["artifact_id"], True)
        assert f"listed again instead of {changed['artifact_id']}" in back["summary"]
        assert "listed again" not in (await imported())["summary"]
        town_road().with_vehicles().write(folder / "good.xml")
        assert (await imported())["artifact_id"] == changed["artifact_id"]


async def test_duplicates_of_one_folder_are_refused_and_name_each_other(
    connect: Connect, bare: Settings, folder: Path
) -> None:
    town_road().write(folder / "same.xml")
    town_road().with_vehicles().write(folder / "same_id.xml")
    async with connect(bare) as client:
        _, _, answer = await call(client, "import_files", path=str(folder))
        reasons = {item["file"]: item["reason"] for item in answer["refusals"]}
        assert "same content as good.xml" in reasons["same.xml"]
        assert "good.xml also has the id" in reasons["same_id.xml"]
        assert answer["added"] == 1


async def test_every_planning_problem_is_an_entry(connect: Connect, bare: Settings, tmp_path: Path) -> None:
    problems = (Problem(), Problem(problem_id=200, start=(40.0, 3.5, 0.0, 25.0)))
    path = replace(town_road(), problems=problems).write(tmp_path / "two.xml")
    async with connect(bare) as client:
        await call(client, "import_files", path=str(path))
        _, _, found = await call(client, "find_scenarios", ego_speed="25m/s")
        assert [match["scenario_id"] for match in found["matches"]] == ["ZAM_Builder-1_1_T-1#200"]


async def test_measures_are_compared_and_sorted_by(connect: Connect, settings: Settings) -> None:
    async with connect(settings) as client:
        _, _, found = await call(client, "find_scenarios", features=["ttc<=20s"], sort="criticality", limit=50)
        assert 1 < found["total"] < found["catalogue"]
        times = [float(match["satisfied"][0].split()[1]) for match in found["matches"]]
        assert times == sorted(times)


async def test_a_diverse_choice_states_its_coverage(connect: Connect, settings: Settings) -> None:
    async with connect(settings) as client:
        _, text, found = await call(client, "find_scenarios", diverse=3)
        assert len(found["matches"]) == 3
        told = ("Only other matches", "The selection")
        assert len([line for line in text.splitlines() if line.startswith(told)]) == 1
        covered = {one["dimension"]: one["covered"] for one in found["coverage"]}
        assert len(covered["obstacles"]) >= 4


async def test_hostile_files_leave_the_catalogue_as_it_is(connect: Connect, bare: Settings, tmp_path: Path) -> None:
    good = town_road().write(tmp_path / "good.xml")
    hostile = tmp_path / "hostile"
    hostile.mkdir()
    text = good.read_text(encoding="utf-8")
    (hostile / "bomb.xml").write_text(f'<!DOCTYPE a [<!ENTITY b "c">]>{text.partition("?>")[2]}', encoding="utf-8")
    (hostile / "evil.xml").write_text(text.replace("ZAM_Builder-1_1_T-1", "../../evil"), encoding="utf-8")
    (hostile / "years.xml").write_text(
        text.replace("<exact>150</exact>", "<exact>9000000000</exact>"), encoding="utf-8"
    )
    with (hostile / "zeros.xml").open("wb") as stream:
        stream.truncate(500_000_000)
    with (hostile / "zeros.osm").open("wb") as stream:
        stream.truncate(500_000_000)
    async with connect(bare.model_copy(update={"file_mb": 50})) as client:
        await call(client, "import_files", path=str(good))
        before = await call(client, "find_scenarios")
        _, _, answer = await call(client, "import_files", path=str(hostile))
        reasons = {item["file"]: item["reason"] for item in answer["refusals"]}
        assert (answer["added"], len(reasons)) == (0, 5)
        assert "52,428,800" in reasons["zeros.xml"]
        assert "file_mb" in reasons["zeros.osm"]
        assert "naming" in reasons["evil.xml"]
        assert "document type" in reasons["bomb.xml"]
        assert "9,000,000,000" in reasons["years.xml"]
        assert await call(client, "find_scenarios") == before


async def test_a_weight_file_becomes_a_configuration(connect: Connect, bare: Settings, folder: Path) -> None:
    (folder / "weights.yaml").write_text("cost_weights:\n  lateral_jerk: 0.7\n", encoding="utf-8")
    (folder / "wrong.yaml").write_text("cost_weights:\n  lateral_jerk: .nan\n", encoding="utf-8")
    async with connect(bare) as client:
        _, _, made = await call(client, "import_files", path=str(folder), kind="config")
        assert made["items"][0]["artifact_id"].startswith("cfg_")
        assert "not a finite number" in made["refusals"][0]["reason"]


async def test_an_empty_result_gives_the_reason_and_keeps_its_fallback_apart(
    connect: Connect, settings: Settings
) -> None:
    async with connect(settings) as client:
        _, text, found = await call(client, "find_scenarios", tags=["race_track"], country="ZAM")
        assert found["matches"] == []
        assert found["emptied_by"]["conditions"] == ["race_track"]
        assert found["relaxations"][0]["drop"] == ["race_track"]
        assert all(scenario["unmet"] for scenario in found["fallback"])
        assert "unmet: " in text


async def test_a_search_is_refined_and_paged(connect: Connect, settings: Settings) -> None:
    async with connect(settings) as client:
        _, _, first = await call(client, "find_scenarios", tags=["urban"], limit=1)
        _, _, page = await call(client, "find_scenarios", tags=["urban"], limit=1, offset=1)
        assert first["search_id"] == page["search_id"]
        assert first["matches"] != page["matches"]
        _, _, refined = await call(client, "find_scenarios", within=first["search_id"], features=["roundabout"])
        assert refined["catalogue"] == first["total"]
        assert 0 < refined["total"] < first["total"]


async def test_the_facets_are_short(connect: Connect, settings: Settings) -> None:
    async with connect(settings) as client:
        _, text, found = await call(client, "describe_catalog")
        assert count_tokens(text) <= 600
        assert found["scenarios"] >= 12
        _, text, _ = await call(client, "describe_catalog", facet="tags")
        assert "race_track" in text


@pytest.mark.parametrize(
    ("tool", "arguments", "expected"),
    [
        ("find_scenarios", {"tags": ["tunnel"]}, "unknown_name"),
        ("find_scenarios", {"method": "bm25"}, "invalid_request"),
        ("find_scenarios", {"within": "search_nothing"}, "search_nothing"),
        ("describe_scenario", {"scenario_id": "DEU_Nowhere-1_1_T-1"}, "unknown_name"),
        ("import_files", {"path": "/etc/hostname"}, "outside_roots"),
    ],
)
async def test_bad_calls_are_refused(
    connect: Connect, settings: Settings, tool: str, arguments: dict[str, Any], expected: str
) -> None:
    async with connect(settings) as client:
        failed, text, _ = await call(client, tool, **arguments)
        assert failed
        assert expected in text


async def test_a_damaged_text_index_is_rebuilt_and_the_answer_says_so(
    connect: Connect, bare: Settings, folder: Path
) -> None:
    async with connect(bare) as client:
        await call(client, "import_files", path=str(folder / "good.xml"))
        assert not (await call(client, "find_scenarios", text="a truck"))[0]
        for file in (bare.workspace / "index").rglob("*.sqlite*"):
            file.write_bytes(b"no database at all" * 1000)
        town_road().with_vehicles().write(folder / "good.xml")
        _, _, second = await call(client, "import_files", path=str(folder / "good.xml"))
        failed, text, found = await call(client, "find_scenarios", text="a truck")
        assert not failed, text
        assert [match["scenario_id"] for match in found["matches"]] == [second["items"][0]["artifact_id"]]
        assert "The text index was damaged and has been rebuilt." in text
        assert "damaged" not in (await call(client, "find_scenarios", text="a truck"))[1]
