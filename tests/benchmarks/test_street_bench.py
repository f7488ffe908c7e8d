"""``make bench-hostile`` on the street: what its parts forge, and that their judges notice faults."""

import asyncio
import base64
import hashlib
import io
import json
import random
import subprocess
import sys
import zipfile
from itertools import islice
from pathlib import Path

import pytest

from benchmarks.robustness.__main__ import merged
from benchmarks.robustness.street import answers, kills, knocks, secrets, spy
from benchmarks.robustness.street.archive_grammar import PRODUCTIONS, forged_archives

RUN = {
    "kind": "run",
    "artifact_id": "run_1",
    "name": "",
    "recipe": {"tool": "run_planner", "arguments": {}},
    "record": {"run_id": "run_1", "reason": "reached the goal", "outcome": "goal_reached", "metrics": {}},
    "made_at": "2026-01-01T00:00:00Z",
    "files": ["steps.json"],
}


def exported() -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("workspace.json", json.dumps({"artifacts": 2}))
        archive.writestr("records.jsonl", "\n".join(json.dumps({**RUN, "artifact_id": name}) for name in ("a", "b")))
        archive.writestr("files/runs/a/steps.json", "{}")
        archive.writestr("files/runs/b/steps.json", "{}")
        archive.writestr("SHA256SUMS", "")
    return buffer.getvalue()


def test_forged_archives_have_right_digests_and_are_the_same_for_a_seed() -> None:
    made = [list(islice(forged_archives(exported(), random.Random(5)), 200)) for _ in range(2)]
    assert [one.productions for one in made[0]] == [one.productions for one in made[1]]
    used = {name for one in made[0] for name in one.productions}
    assert used == {production.__name__.strip("_") for production in PRODUCTIONS}
    for forged in made[0]:
        with zipfile.ZipFile(io.BytesIO(forged.content)) as archive:
            sums = dict(line.split("  ", 1)[::-1] for line in archive.read("SHA256SUMS").decode().splitlines())
            assert sums == {
                name: hashlib.sha256(archive.read(name)).hexdigest()
                for name in archive.namelist()
                if name != "SHA256SUMS"
            }


@pytest.mark.parametrize(("kind", "sound"), [("search", answers.sound_places("A")), ("map", answers.sound_map())])
def test_sound_answers_are_documented_and_most_forged_ones_are_not(kind: str, sound: object) -> None:
    chance = random.Random(6)
    made = [answers.forged(sound, chance) for _ in range(200)]
    assert answers.is_documented(json.dumps(sound).encode(), kind)
    assert 20 < sum(not answers.is_documented(content, kind) for content in made) < 200


@pytest.mark.parametrize(
    "content",
    [
        b'[{"lat": "nan", "lon": "1", "boundingbox": ["1", "1", "1", "1"], "display_name": "A"}]',
        b"[null]",
        b"[" * 200_000,
        b'{"elements": []}',
    ],
)
def test_an_answer_in_another_form_is_recognised(content: bytes) -> None:
    assert not answers.is_documented(content, "search")


def test_a_missing_changed_or_partial_artifact_after_a_kill_is_lost() -> None:
    before = {"record run a": "1", "file runs/a/steps.json": "2"}
    piece = kills._Piece("import", (), 0.0, 1.0, artifacts=2)
    assert kills._missing(piece, before, {**before, "record run b": "3"}) == []
    assert len(kills._missing(piece, before, {"record run a": "other"})) == 3


def test_secret_is_found_as_it_is_and_in_base64() -> None:
    secret = "s3cr3t" * 8
    for shift in range(3):
        header = base64.b64encode(b"u" * shift + secret.encode() + b":x")
        assert any(form in header for form in secrets._forms(secret))
    assert any(form in b"x=" + secret.encode() for form in secrets._forms(secret))


def test_the_spy_sees_the_content_of_its_environment(tmp_path: Path) -> None:
    seen = tmp_path / "seen"
    subprocess.run(
        [sys.executable, "-S", str(Path(spy.__file__)), str(seen)],
        input=b"{}\n",
        env={"SECRET": "of-the-test"},
        check=True,
        capture_output=True,
    )
    contents = [bytes.fromhex(line.partition(" ")[2]) for line in seen.read_text().splitlines()]
    assert any(b"of-the-test" in content for content in contents)


def test_keys_that_two_parts_count_are_summed() -> None:
    assert merged({"unexpected": 2, "lost": 1}, {"unexpected": 3, "lost": 4}) == {"unexpected": 5, "lost": 4}


def test_stranger_notes_how_it_was_answered() -> None:
    async def refuse(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.read(65_536)  # all of a short request: a connection that leaves some unread is reset
        writer.write(b"HTTP/1.1 401 Unauthorized\r\n\r\n")
        writer.close()

    async def knock() -> dict[str, dict[str, int]]:
        server = await asyncio.start_server(refuse, "127.0.0.1", 0)
        async with server:
            port = server.sockets[0].getsockname()[1]
            stranger = knocks.Stranger("127.0.0.1", port, 0.2, random.Random(1))
            await stranger.knock()
        return {name: dict(counted) for name, counted in stranger.seen.items()}

    seen = asyncio.run(knock())
    assert "401" in {status for counted in seen.values() for status in counted}
    assert {*knocks.KINDS} <= {*seen}
