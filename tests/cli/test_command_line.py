"""The command line: one call, the list of tools, and one clear line for what is wrong."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from plannerforge import __version__
from plannerforge.cli import program, ui
from plannerforge.cli.program import application
from plannerforge.engine import execution
from plannerforge.engine.workspace import Recipe, Workspace
from plannerforge.server import assembly
from plannerforge.server.http import serving
from plannerforge.server.settings import Settings, settings_file

pytestmark = pytest.mark.usefixtures("probe_tools")


@pytest.fixture(autouse=True)
def _workspace_of_the_test(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PLANNERFORGE_WORKSPACE", str(tmp_path / "workspace"))
    monkeypatch.setenv("COLUMNS", "200")


def run(*arguments: str) -> Result:
    return CliRunner().invoke(application, arguments)


def test_call_prints_the_text_of_the_answer(tmp_path: Path) -> None:
    result = run("call", "echo", '{"text": "hello", "tags": "a"}')
    assert result.exit_code == 0
    said, note = result.stdout.splitlines()
    assert json.loads(said)["text"] == "hello"
    assert note == 'Note: tags="a" is read as ["a"]'
    assert (tmp_path / "workspace" / "journal" / "calls.jsonl").is_file()


def test_a_shell_gets_paths_of_pictures_not_links(tmp_path: Path) -> None:
    result = run("call", "echo", '{"text": "see plannerforge://picture/a_12.png (9×9)"}')
    assert f"see {tmp_path / 'workspace' / 'pictures' / 'a_12.png'} (9" in json.loads(result.stdout)["text"]


def test_call_prints_the_structure_as_json() -> None:
    result = run("call", "echo", '{"text": "hello"}', "--json")
    assert result.exit_code == 0
    assert json.loads(result.stdout)["said"]["text"] == "hello"


def test_a_call_without_arguments_passes_an_empty_object() -> None:
    result = run("call", "list_artifacts")
    assert result.exit_code == 0
    assert "Next: " in result.stdout


@pytest.mark.parametrize(
    ("tool", "arguments", "expected"),
    [
        ("echo", '{"cuont": 1}', "there is no argument 'cuont'"),
        ("refuse", "{}", "[not_possible] the lane ends"),
        ("ech", "{}", "there is no tool 'ech'"),
        ("get_job", "{}", "there is no job yet"),
    ],
)
def test_a_refused_call_gives_its_reason_on_stderr_and_fails(tool: str, arguments: str, expected: str) -> None:
    for flags in ((), ("--json",)):
        result = run("call", tool, arguments, *flags)
        assert result.exit_code == 1
        assert result.stdout == ""
        assert expected in result.stderr
        assert "Traceback" not in result.stderr


@pytest.mark.parametrize(
    ("arguments", "expected"), [("{count: 2}", "not JSON"), ("[1]", "JSON object"), ('"x"', "JSON object")]
)
def test_arguments_that_are_not_a_json_object_are_refused(arguments: str, expected: str) -> None:
    result = run("call", "echo", arguments)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert expected in result.stderr


def test_the_version_is_reported() -> None:
    assert run("--version").stdout == f"plannerforge {__version__}\n"


def test_the_package_runs_as_a_module() -> None:
    command = [sys.executable, "-P", "-m", "plannerforge", "--version"]
    told = subprocess.run(command, capture_output=True, text=True, check=True)
    assert told.stdout == f"plannerforge {__version__}\n"


def test_tools_are_listed_with_their_cost() -> None:
    result = run("tools")
    assert result.exit_code == 0
    for words in ("list_artifacts", "Artifacts of this workspace", "echo", "Say the arguments again", "all"):
        assert words in result.stdout
    assert "list_artifacts" not in run("tools", "--essential").stdout


@pytest.mark.parametrize(
    ("flags", "named"),
    [
        (("--workers", "0"), "--workers: workers takes a whole number from 1 to 64, not 0"),
        (("--workers", "0", "--tools", "few"), "; --tools: tools cannot be 'few' (valid: essential, all)"),
        (("--log-level", "warn"), "log_level cannot be 'warn' (valid: WARNING, "),
        (("--log-format", "xml"), "--log-format: log_format cannot be 'xml' (valid: "),
    ],
)
def test_wrong_flag_is_one_line(flags: tuple[str, ...], named: str) -> None:
    result = run("serve", *flags)
    assert result.exit_code == 2
    assert result.stderr.startswith("plannerforge: ")
    assert named in result.stderr
    assert result.stderr.count("\n") == 1


def test_an_invalid_value_of_a_setting_is_reported_with_all_valid_values() -> None:
    said = run("serve", "--log-level", "LOUD").stderr
    assert all(word in said for word in ("DEBUG", "INFO", "WARNING", "ERROR"))


@pytest.mark.parametrize("text", ["wrokers = 3", "workers ="])
def test_wrong_settings_file_is_one_line(text: str) -> None:
    settings_file().parent.mkdir(parents=True)
    settings_file().write_text(text)
    result = run("tools")
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert str(settings_file()) in result.stderr
    assert "wrokers" not in text or "there is no setting 'wrokers' (valid: workers" in result.stderr


def test_an_unknown_flag_or_no_command_lists_the_commands() -> None:
    assert run("serve", "--wrokers", "3").exit_code == 2
    assert "serve" in run().output


def test_prompts_are_listed_with_their_cost_and_printed() -> None:
    assert "cp_icl_cot" in run("prompts").stdout
    assert "configure_planner" in run("prompts", "tuning", "--condition", "baseline").stdout
    refused = run("prompts", "cooking")
    assert refused.exit_code == 1
    assert "there is no task 'cooking'" in refused.stderr


def test_an_impossible_workspace_of_a_server_is_reported_in_one_line(tmp_path: Path) -> None:
    """In a process of its own: `serve` takes over standard input and output, which a test's process needs."""
    file = tmp_path / "file"
    file.touch()
    words = [sys.executable, "-m", "plannerforge", "serve", "--workspace", str(file)]
    ended = subprocess.run(words, capture_output=True, text=True, stdin=subprocess.DEVNULL, check=False)
    assert ended.returncode == 1
    assert ended.stdout == ""
    assert f"workspace database {file} cannot be used" in ended.stderr
    assert "Traceback" not in ended.stderr


def test_an_impossible_workspace_of_a_command_is_reported_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "file"
    file.touch()
    monkeypatch.setattr("sys.argv", ["plannerforge", "maps", "list", "--workspace", str(file)])
    with pytest.raises(SystemExit, match="1"):
        program.run(application)
    said = capsys.readouterr()
    assert said.out == ""
    assert f"workspace database {file} cannot be used" in said.err
    assert "Traceback" not in said.err


@pytest.mark.parametrize("words", [["serve"], ["serve", "--http"], ["ui", "--no-open"]])
def test_serving_commands_share_their_heaps_before_starting_threads(
    words: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[str] = []

    class Made:
        def finish_journal(self) -> None:
            """Nothing was called."""

        def run(self, transport: str) -> None:
            begun.append(transport)

    monkeypatch.setattr(execution, "limit_memory", lambda size_bytes: None)  # it would bound the tests
    monkeypatch.setattr(execution, "share_heaps", lambda: begun.append("shared"))
    monkeypatch.setattr(ui, "share_heaps", lambda: begun.append("shared"))
    for place in (assembly, ui):
        monkeypatch.setattr(place, "create_server", lambda settings: Made())
    for place in (serving, ui):
        monkeypatch.setattr(place, "serve_http", lambda *given: begun.append("http"))
    monkeypatch.setattr(signal, "signal", lambda number, handler: None)
    assert CliRunner().invoke(application, words).exit_code == 0
    assert begun[0] == "shared"
    assert begun[1:] in (["stdio"], ["http"])


def test_pages_leave_out_origins_that_the_settings_accept_with_a_token(
    monkeypatch: pytest.MonkeyPatch, settings: Settings
) -> None:
    served: list[Settings] = []
    for name in ("share_heaps", "hide_environment", "create_server"):
        monkeypatch.setattr(ui, name, lambda *given: None)
    monkeypatch.setattr(ui, "serve_http", lambda server, own, *given: served.append(own))
    let_in = {"http_origins": ("https://page.example",), "http_hosts": ("forge.example",), "http_proxies": ("::1",)}
    ui.serve_pages(settings.model_copy(update=let_in), open_it=False)
    assert {name: getattr(served[0], name) for name in let_in} == dict.fromkeys(let_in, ())


def completed(words: str, typed: str) -> list[str]:
    """What bash is given at a TAB behind these words."""
    environment = {
        "_PLANNERFORGE_COMPLETE": "complete_bash",
        "COMP_WORDS": f"{words} {typed}",
        "COMP_CWORD": str(len(words.split())),
    }
    return CliRunner().invoke(application, [], prog_name="plannerforge", env=environment).stdout.split()


def test_a_shell_completes_hosts_and_tools() -> None:
    assert completed("plannerforge install", "c") == ["claude-desktop", "claude-code", "cursor", "codex"]
    assert completed("plannerforge call", "list_") == ["list_planners", "list_artifacts"]
    assert completed("plannerforge call", "nothing") == []


def test_a_shell_completes_ids_that_are_shown_and_makes_no_workspace(tmp_path: Path) -> None:
    assert completed("plannerforge view", "run_") == []
    assert not (tmp_path / "workspace").exists()
    for root in (tmp_path / "workspace", tmp_path / "other"):
        workspace = Workspace(root)
        for kind, artifact_id in (("run", f"run_{root.name}"), ("config", "cfg_1")):
            recipe = Recipe(tool="run_planner", arguments={"id": artifact_id})
            workspace.put(kind, artifact_id, recipe=recipe, record=Recipe(tool="none", arguments={}), files={})  # type: ignore[arg-type]
        workspace.close()
    assert completed("plannerforge view", "") == ["run_workspace"]
    assert completed(f"plannerforge view --workspace {tmp_path / 'other'}", "run_") == ["run_other"]
    (tmp_path / "workspace" / "workspace.sqlite").write_bytes(b"no database at all" * 500)
    assert completed("plannerforge view", "run_") == []
