"""``plannerforge catalog``: a folder goes in, and so does an archive whose hash is right, from a loopback server."""

import hashlib
import io
import threading
import zipfile
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import pytest
from support.builders import town_road
from typer.testing import CliRunner, Result

from plannerforge.cli.program import application

pytestmark = pytest.mark.usefixtures("warm_workers")


@pytest.fixture(autouse=True)
def _workspace_of_the_test(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PLANNERFORGE_WORKSPACE", str(tmp_path / "workspace"))
    monkeypatch.setenv("PLANNERFORGE_WORKERS", "1")
    monkeypatch.setenv("PLANNERFORGE_STARTER", "false")


def run(*arguments: str) -> Result:
    return CliRunner().invoke(application, ["catalog", *arguments])


def archive() -> bytes:
    """A zip with a good scenario, one whose name leads outside, and what is no scenario."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as opened:
        opened.writestr("corpus/good.xml", town_road().xml())
        opened.writestr("../../outside.xml", "<commonRoad>")
        opened.writestr("readme.txt", "nothing")
    return content.getvalue()


@pytest.fixture
def address() -> Iterator[str]:
    """A server on this machine that answers with the archive."""
    content = archive()

    class Answer(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, format: str, *args: object) -> None:  # noqa: A002
            """Stay silent."""

    server = HTTPServer(("127.0.0.1", 0), Answer)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}/corpus.zip"
    server.shutdown()
    thread.join()
    server.server_close()


def test_a_folder_is_imported_once_and_again_without_effect(tmp_path: Path) -> None:
    folder = tmp_path / "files"
    folder.mkdir()
    town_road().write(folder / "good.xml")
    first, second = run("add", str(folder)), run("add", str(folder))
    assert first.exit_code == second.exit_code == 0
    assert "1 added" in first.stdout
    assert "0 added, 1 already stored" in second.stdout


def test_an_archive_with_the_right_hash_is_imported_without_escaping_its_folder(tmp_path: Path, address: str) -> None:
    result = run("fetch", address, "--sha256", hashlib.sha256(archive()).hexdigest())
    assert result.exit_code == 0, result.output
    assert "1 added, 0 already stored, 1 refused" in result.stdout
    assert not list(tmp_path.rglob("outside.xml"))


def test_an_archive_with_another_hash_is_refused_and_not_kept(tmp_path: Path, address: str) -> None:
    result = run("fetch", address, "--sha256", "0" * 64)
    assert result.exit_code == 1
    assert "SHA-256" in result.output
    assert not list((tmp_path / "workspace" / "downloads").iterdir())


@pytest.mark.parametrize(("url", "sha256"), [("file:///etc/passwd", "0" * 64), ("https://example.org/x.zip", "abc")])
def test_invalid_addresses_and_hashes_are_refused(url: str, sha256: str) -> None:
    result = run("fetch", url, "--sha256", sha256)
    assert result.exit_code == 1
    assert "is no" in result.output
