"""The robustness bench sees what it is there to see: shown on answers, files and a server that misbehave."""

import io
import json
import random
import subprocess
import sys
import zipfile
from collections.abc import Sequence
from itertools import islice
from pathlib import Path

import pytest

from benchmarks.robustness.arguments import Surface, hostile_arguments
from benchmarks.robustness.campaign import Campaign, Tally
from benchmarks.robustness.files import Seed, alias_bomb, hostile_files
from benchmarks.robustness.holes import hostile_holes
from benchmarks.robustness.inputs import INJECTED, Call, HostileInput, PlacedFile, keep, read_kept
from benchmarks.robustness.judges import CANARY_TEXT, Canary, faults_of, journal_faults, peak_memory_mb
from benchmarks.robustness.server_process import Folders, Program

SERVER = Path(__file__).resolve().parent.parent / "support" / "misbehaving_server.py"
SCENARIO = b"""<commonRoad timeStepSize="0.1" commonRoadVersion="2020a" benchmarkID="ZAM_A-1_1_T-1" author="a">
<lanelet id="1"><leftBound><point><x>0</x><y>1</y></point><point><x>9</x><y>1</y></point></leftBound></lanelet>
<planningProblem id="2"><initialState><velocity><exact>1.0</exact></velocity></initialState></planningProblem>
</commonRoad>"""
MAP = b"""<osm version="0.6"><node id="1" lat="48.0" lon="11.0"/><node id="2" lat="48.1" lon="11.0"/>
<way id="3"><nd ref="1"/><nd ref="2"/><tag k="highway" v="primary"/></way></osm>"""


def _archive() -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr(zipfile.ZipInfo("a.xml"), SCENARIO)
    return packed.getvalue()


SEEDS = {
    ending: [Seed(ending, content)]
    for ending, content in (
        (".xml", SCENARIO),
        (".osm", MAP),
        (".net.xml", b'<net><edge id="a"><lane speed="13.9"/></edge></net>'),
        (".yaml", b"cost_weights:\n  jerk: 1.0\nplanner: frenetix\n"),
        (".osm.gz", MAP),
        (".osm.bz2", MAP),
        (".zip", _archive()),
        (".osm.pbf", b"\x00\x00\x00\x0dOSMHeader" * 9),
    )
}
SURFACE = Surface(
    {
        "list_artifacts": {"properties": {"limit": {"type": "integer", "minimum": 1, "maximum": 50}}},
        "import_files": {"properties": {"path": {"type": "string"}}, "required": ["path"]},
        "modify_scenario": {
            "properties": {"edits": {"type": "array", "items": {"properties": {"op": {"type": "string"}}}}},
            "required": ["edits"],
        },
    },
    ["plannerforge://scenario/{id}/xml"],
    {"explain_a_run": ["run"]},
)


def _laws(text: str) -> list[str]:
    return [fault.law for fault in faults_of(text)]


@pytest.mark.parametrize(
    "end", ["\n", "\r", "\r\n", "\x0b", "\x0c", "\x1c", "\x85", "\u2028", "\u2029", "\n\t- ", "\n> "]
)
def test_a_text_on_its_own_line_is_forged(end: str) -> None:
    assert _laws(f"[unknown_name] there is no job 'x{end}{INJECTED}'. Next: list them.") == ["forged"]


def test_a_text_that_stays_within_its_line_is_not_forged() -> None:
    assert _laws(f"[unknown_name] there is no job 'x {INJECTED}'.\nNext: list_artifacts.") == []
    assert _laws(repr(f"x\n{INJECTED}")) == []


def test_unexpected_oversized_and_read_answers_are_reported() -> None:
    assert _laws("3 files, 1 refused:\n- a.xml: [unexpected] import failed (incident 00).") == ["unexpected"]
    assert _laws("[unknown_name] there is no job 'x'.") == ["unadvised"]
    assert _laws("x" * 20_001) == ["oversized"]
    assert _laws("x" * 20_000) == []
    assert _laws(f"<a>{CANARY_TEXT}</a>") == ["outside_read"]


def test_the_canary_reports_any_change_of_its_tree(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("1")
    (tmp_path / "b").write_text("1")
    (tmp_path / "c").write_text("1")
    canary = Canary(tmp_path)
    assert canary.changes() == []
    (tmp_path / "a").write_text("2")
    (tmp_path / "b").unlink()
    (tmp_path / "c").chmod(0o600)
    (tmp_path / "deep").mkdir()
    (tmp_path / "link").symlink_to("a")
    told = sorted(text.replace(str(tmp_path), "") for text in canary.changes())
    assert told == ["changed /a", "changed /c", "made /deep", "made /link", "removed /b"]
    assert canary.changes() == []


def test_a_journal_that_keeps_too_much_or_is_open_is_reported(tmp_path: Path) -> None:
    journal = tmp_path / "journal" / "calls.jsonl"
    journal.parent.mkdir()
    sound = {"arguments": {"text": "a" * 200 + "…", "list": [1, None]}, "error": "x" * 900}
    journal.write_text(json.dumps(sound) + "\n")
    journal.chmod(0o600)
    assert list(journal_faults(tmp_path)) == []
    bad = [{"arguments": {"a": ["b" * 300]}}, {"arguments": {"a\u2028b": 1}}, {"arguments": {"a": 10**300}}]
    journal.write_text("\n".join(json.dumps(line) for line in [sound, *bad]))
    assert [text.partition(": ")[0] for text in journal_faults(tmp_path)] == [f"calls.jsonl:{n}" for n in (2, 3, 4)]
    journal.chmod(0o644)
    assert next(journal_faults(tmp_path)).startswith("calls.jsonl may be read by others")


def test_peak_memory_is_that_of_the_process_alone() -> None:
    code = "x = bytearray(b'1') * 150_000_000; del x; input()"
    with subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE) as process:
        while peak_memory_mb(process.pid) < 140:
            assert process.poll() is None
        assert peak_memory_mb(process.pid) < 220
        process.communicate(b"\n")
    assert peak_memory_mb(process.pid) == 0.0


def test_an_input_is_kept_and_read_again_as_it_was(tmp_path: Path) -> None:
    files = (
        PlacedFile("in/a.xml", b"\x00\xff"),
        PlacedFile("in/b", link_to="{outside}/x"),
        PlacedFile("in/c", is_fifo=True),
    )
    hostile = HostileInput("files", "x: y", (Call("import_files", {"path": "{root}/in", "n": 2**70}),), files)
    assert read_kept(keep(tmp_path / "kept", 3, hostile, "late", "31 s")) == hostile


def test_files_are_placed_and_removed_with_their_folders(tmp_path: Path) -> None:
    root, outside = tmp_path / "root", tmp_path / "outside"
    root.mkdir()
    files = (PlacedFile("in/deep/a", b"x"), PlacedFile("in/b", link_to="{outside}/x"), PlacedFile("in/c", is_fifo=True))
    hostile = HostileInput("files", "x", (), files)
    hostile.place(root, outside)
    assert (root / "in/deep/a").read_bytes() == b"x"
    assert (root / "in/b").readlink() == outside / "x"
    assert (root / "in/c").is_fifo()
    hostile.remove(root)
    assert list(root.iterdir()) == []


def test_the_same_seed_makes_the_same_inputs_and_another_others() -> None:
    def made(seed: int) -> list[HostileInput]:
        return [
            *islice(hostile_arguments(SURFACE, "ZAM_A-1_1_T-1", random.Random(seed)), 200),
            *islice(hostile_files(SEEDS, random.Random(seed)), 100),
            *islice(hostile_holes(SEEDS, "ZAM_A-1_1_T-1", random.Random(seed)), 40),
        ]

    assert repr(made(1)) == repr(made(1))
    assert repr(made(1)) != repr(made(2))


def test_arguments_reach_every_tool_resource_and_prompt() -> None:
    inputs = list(islice(hostile_arguments(SURFACE, "ZAM_A-1_1_T-1", random.Random(3)), 1000))
    assert {call.method for hostile in inputs for call in hostile.calls} == {"tool", "resource", "prompt"}
    assert set(SURFACE.tools) <= {call.name for hostile in inputs for call in hostile.calls}


def test_mutants_are_of_every_kind_and_few_are_alike() -> None:
    inputs = list(islice(hostile_files(SEEDS, random.Random(4)), 400))
    alone = [file for hostile in inputs for file in hostile.files if hostile.cause != "folder"]
    assert {ending for ending in SEEDS for file in alone if file.path.endswith(ending)} == set(SEEDS)
    assert len({file.content for file in alone}) > 0.7 * len(alone)
    sound = {seed.content for seeds in SEEDS.values() for seed in seeds}
    assert sum(file.content in sound for file in alone) < 0.05 * len(alone)


def test_an_alias_bomb_is_small() -> None:
    bomb = alias_bomb(12, 10, random.Random(5))
    assert len(bomb) < 1000


def _misbehaving(folders: Folders) -> Sequence[str]:
    return [str(SERVER), str(folders.workspace)]


SLOW_S = 1.5
"""After which a refusal is late here (chosen: tests wait for it)."""
BY_BOTH = pytest.mark.parametrize("by_http", [False, True], ids=["stdio", "http"])


async def _campaign(tmp_path: Path, *calls: Call, by_http: bool) -> Tally:
    """What a campaign says of calls to the server that misbehaves."""
    template = Folders(tmp_path / "template").make()
    campaign = Campaign(template, tmp_path, Program(_misbehaving, by_http), SLOW_S)
    sound = [HostileInput("args", "sound", (Call("say", {"text": str(number)}),)) for number in range(8)]
    hostile = [HostileInput("args", f"{call.name}", (call,)) for call in calls]
    await campaign.send(iter([*sound, *hostile, *sound]))
    await campaign.replay_suspects()
    return campaign.tally


def _found(tally: Tally) -> set[tuple[str, str]]:
    return {(finding.hostile.cause, finding.fault.law) for finding in tally.findings}


@pytest.mark.anyio
@BY_BOTH
async def test_a_server_that_behaves_is_not_accused(tmp_path: Path, by_http: bool) -> None:
    tally = await _campaign(tmp_path, Call("wait", {"seconds": 0.5}), Call("eat", {"megabytes": 40}), by_http=by_http)
    assert _found(tally) == set()
    assert (tally.inputs, tally.deaths, tally.outside_writes) == (18, [], [])
    assert tally.blocked_ms < 100
    assert tally.memory_mb > 40


@pytest.mark.anyio
async def test_a_server_that_misbehaves_is_caught(tmp_path: Path) -> None:
    tally = await _campaign(
        tmp_path,
        Call("block", {"seconds": 0.5}),
        Call("wait", {"seconds": SLOW_S + 0.3}),
        Call("eat", {"megabytes": 450}),
        Call("say", {"text": f"x\n{INJECTED}"}),
        Call("defect"),
        Call("write", {"path": "{outside}/deep/new"}),
        by_http=True,
    )
    expected = {("block", "blocked"), ("wait", "late"), ("eat", "memory"), ("say", "forged"), ("defect", "unexpected")}
    expected |= {("write", "outside_write")}
    assert _found(tally) - {("eat", "blocked")} == expected  # to take so much memory may take more than 100 ms
    assert 400 < tally.blocked_ms < 900
    assert SLOW_S + 0.2 < tally.slowest_s < 15
    assert tally.memory_mb > 450
    assert [text.rpartition("/")[2] for text in tally.outside_writes] == ["new"]
    unexpected = next(finding.fault for finding in tally.findings if finding.fault.law == "unexpected")
    assert "engine/maps/osm.py:7: ValueError: too long" in unexpected.details


@pytest.mark.anyio
async def test_a_server_that_dies_is_replaced_and_the_cause_found(tmp_path: Path) -> None:
    tally = await _campaign(tmp_path, Call("die"), by_http=False)
    assert len(tally.deaths) == 1
    assert _found(tally) == {("die", "death")}
    assert tally.inputs == 17
