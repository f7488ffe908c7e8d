"""``plannerforge install HOST``: a host's file keeps what it holds, and has the server once."""

import json
import tomllib
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from plannerforge.schemas.errors import InvalidRequest, UnknownName
from plannerforge.server.command_line import application
from plannerforge.server.commands.hosts import BACKUP, HOSTS, install, named_host, start_command

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
def test_what_a_file_holds_is_kept_and_copied_before(name: str, tmp_path: Path) -> None:
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
    with pytest.raises(InvalidRequest, match="says otherwise"):
        install(HOSTS["codex"], start_command(["--roots", "/elsewhere"]), home=tmp_path)


def test_a_file_with_comments_is_left_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = HOSTS["zed"].file(tmp_path, "linux")
    path.parent.mkdir(parents=True)
    path.write_text('{\n  // mine\n  "theme": "x",\n}\n', encoding="utf-8")
    assert install(HOSTS["zed"], COMMAND, home=tmp_path) == 1
    assert path.read_text(encoding="utf-8") == '{\n  // mine\n  "theme": "x",\n}\n'
    said = capsys.readouterr()
    assert "left alone" in said.err
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


def test_printing_writes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    result = CliRunner().invoke(application, ["install", "Cursor", "--print"])
    assert json.loads(result.stdout)["mcpServers"]["plannerforge"]["args"] == ["serve"]
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_host_names_the_nearest() -> None:
    with pytest.raises(UnknownName) as refusal:
        named_host("cursr")
    assert refusal.value.valid[0] == "cursor"
