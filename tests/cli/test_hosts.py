"""``plannerforge install HOST``: a host's file keeps what it holds, and has the server once."""

import json
import tomllib
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from plannerforge.cli import hosts
from plannerforge.cli.hosts import BACKUP, HOSTS, install, may_vanish, named_host, start_command
from plannerforge.cli.program import application
from plannerforge.schemas.errors import InvalidRequest, UnknownName

COMMAND = start_command(["--roots", "/data"])


def servers(path: Path, key: str) -> Any:
    text = path.read_text(encoding="utf-8")
    return (tomllib.loads(text) if path.suffix == ".toml" else json.loads(text))[key]


@pytest.mark.parametrize("name", HOSTS)
@pytest.mark.parametrize("platform", ["linux", "darwin"])
def test_the_server_is_written_once(name: str, platform: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", platform)
    host = named_host(name)
    path = host.file(tmp_path, platform)
    assert install(host, COMMAND, home=tmp_path) == 0
    written = path.read_bytes()
    entry = servers(path, host.key)["plannerforge"]
    assert [entry["command"], *entry["args"]] == list(COMMAND)
    assert Path(entry["command"]).is_absolute()
    assert install(host, COMMAND, home=tmp_path) == 0
    assert path.read_bytes() == written
    assert [file.name for file in path.parent.iterdir()] == [path.name]


@pytest.mark.parametrize("name", sorted(set(HOSTS) - {"codex"}))
def test_a_file_s_other_content_is_kept_and_backed_up(name: str, tmp_path: Path) -> None:
    host = HOSTS[name]
    path = host.file(tmp_path, "linux")
    path.parent.mkdir(parents=True, exist_ok=True)
    before = {
        "theme": "dark",
        host.key: {"other": {"command": "x"}, "plannerforge": {"command": "old", "env": {"A": "1"}}},
    }
    path.write_text(json.dumps(before), encoding="utf-8")
    for copy in ("", "-2"):
        assert install(host, COMMAND, home=tmp_path) == 0
        whole = json.loads(path.read_text(encoding="utf-8"))
        assert (whole["theme"], whole[host.key]["other"]) == ("dark", {"command": "x"})
        assert whole[host.key]["plannerforge"]["env"] == {"A": "1"}
        assert json.loads(path.with_name(path.name + BACKUP + copy).read_text(encoding="utf-8")) == before
        path.write_text(json.dumps(before), encoding="utf-8")


def test_a_toml_file_keeps_its_bytes_and_is_added_to(tmp_path: Path) -> None:
    path = HOSTS["codex"].file(tmp_path, "linux")
    path.parent.mkdir(parents=True)
    path.write_text('# mine\nmodel = "x"\n', encoding="utf-8")
    assert install(HOSTS["codex"], COMMAND, home=tmp_path) == 0
    assert path.read_text(encoding="utf-8").startswith('# mine\nmodel = "x"\n')
    with pytest.raises(InvalidRequest, match="with other values"):
        install(HOSTS["codex"], start_command(["--roots", "/elsewhere"]), home=tmp_path)


def test_a_file_with_comments_is_left_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = HOSTS["zed"].file(tmp_path, "linux")
    path.parent.mkdir(parents=True)
    path.write_text('{\n  // mine\n  "theme": "x",\n}\n', encoding="utf-8")
    assert install(HOSTS["zed"], COMMAND, home=tmp_path) == 1
    assert path.read_text(encoding="utf-8") == '{\n  // mine\n  "theme": "x",\n}\n'
    said = capsys.readouterr()
    assert "stays unchanged" in said.err
    assert json.loads(said.out)["context_servers"]["plannerforge"]["args"][0] == "serve"


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    kept = tmp_path / "dotfiles" / "mcp.json"
    kept.parent.mkdir()
    kept.write_text("{}", encoding="utf-8")
    path = HOSTS["cursor"].file(tmp_path, "linux")
    path.parent.mkdir()
    path.symlink_to(kept)
    assert install(HOSTS["cursor"], COMMAND, home=tmp_path) == 0
    assert path.is_symlink()
    assert "plannerforge" in kept.read_text(encoding="utf-8")


def test_printing_does_not_write_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    result = CliRunner().invoke(application, ["install", "Cursor", "--print"])
    assert json.loads(result.stdout)["mcpServers"]["plannerforge"]["args"] == ["serve"]
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_host_names_the_nearest() -> None:
    with pytest.raises(UnknownName) as refusal:
        named_host("cursr")
    assert refusal.value.valid[0] == "cursor"


@pytest.mark.parametrize("name", sorted(set(HOSTS) - {"codex"}))
@pytest.mark.parametrize("key", ["url", "serverUrl", "httpUrl"])
def test_an_entry_by_http_is_replaced_completely_by_a_program(name: str, key: str, tmp_path: Path) -> None:
    host = HOSTS[name]
    path = host.file(tmp_path, "linux")
    path.parent.mkdir(parents=True, exist_ok=True)
    by_http = {"type": "http", key: "http://127.0.0.1:8765/mcp", "headers": {"A": "1"}}
    path.write_text(json.dumps({host.key: {"plannerforge": by_http}}), encoding="utf-8")
    assert install(host, COMMAND, home=tmp_path) == 0
    assert servers(path, host.key)["plannerforge"] == host.entry(COMMAND)
    assert servers(path.with_name(path.name + BACKUP), host.key)["plannerforge"] == by_http


def test_an_entry_with_an_address_and_this_program_does_not_count_as_correct(tmp_path: Path) -> None:
    path = HOSTS["cursor"].file(tmp_path, "linux")
    path.parent.mkdir(parents=True)
    both = {"url": "http://127.0.0.1:8765/mcp", **HOSTS["cursor"].entry(COMMAND)}
    path.write_text(json.dumps({"mcpServers": {"plannerforge": both}}), encoding="utf-8")
    assert install(HOSTS["cursor"], COMMAND, home=tmp_path) == 0
    assert "url" not in servers(path, "mcpServers")["plannerforge"]


@pytest.fixture
def passing(tmp_path: Path) -> Path:
    """An environment as ``uvx`` makes it: a link in uv's cache to an unpacked one."""
    cache = tmp_path / "uv"
    kept = cache / "archive-v0" / "Xy1"
    kept.mkdir(parents=True)
    (cache / "CACHEDIR.TAG").touch()
    (cache / "environments-v2").mkdir()
    link = cache / "environments-v2" / "plannerforge-mcp-1"
    link.symlink_to(kept)
    return link


def test_an_environment_in_uvs_cache_may_vanish_and_others_stay(passing: Path, tmp_path: Path) -> None:
    assert may_vanish(passing)
    own = tmp_path / "project" / ".venv"
    own.mkdir(parents=True)
    (own / "CACHEDIR.TAG").touch()  # uv marks every environment so
    assert not may_vanish(own)
    (tmp_path / "archive-v0" / "mine").mkdir(parents=True)
    assert not may_vanish(tmp_path / "archive-v0" / "mine")


def test_a_program_that_may_vanish_is_started_by_uvx(passing: Path) -> None:
    program, *words = start_command(["--roots", "/data"], passing)
    assert Path(program).name == "uvx"
    assert words[-4:] == ["plannerforge-mcp", "serve", "--roots", "/data"]
    assert str(passing) not in words


@pytest.mark.parametrize(
    ("told", "source"),
    [
        (None, []),
        ({"url": "file:///data/my%20wheels/p.whl", "archive_info": {}}, ["--from", "/data/my wheels/p.whl"]),
        ({"url": "https://forge.example/p.whl", "archive_info": {}}, ["--from", "https://forge.example/p.whl"]),
        (
            {"url": "https://forge.example/p", "vcs_info": {"vcs": "git", "commit_id": "ab12"}},
            ["--from", "plannerforge-mcp @ git+https://forge.example/p@ab12"],
        ),
    ],
)
def test_uvx_takes_the_package_from_its_source(
    told: dict[str, Any] | None, source: list[str], passing: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Installed:
        def read_text(self, name: str) -> str | None:
            assert name == "direct_url.json"
            return None if told is None else json.dumps(told)

    monkeypatch.setattr(hosts, "distribution", lambda name: Installed())
    assert list(start_command([], passing))[1:] == [*source, "plannerforge-mcp", "serve"]


def test_installing_from_uv_s_cache_reports_that_the_host_uses_uvx(
    passing: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.prefix", str(passing))
    result = CliRunner().invoke(application, ["install", "cursor", "--print"])
    assert "uv tool install" in result.stderr
    assert Path(json.loads(result.stdout)["mcpServers"]["plannerforge"]["command"]).name == "uvx"
    monkeypatch.undo()
    assert CliRunner().invoke(application, ["install", "cursor", "--print"]).stderr == ""
