"""``plannerforge view``: a page is written and its path printed; a browser is opened only where there is a screen."""

import json
import shutil
import sys
import webbrowser
from pathlib import Path

import pytest
from typer.testing import CliRunner

from benchmarks.loop import stepwise_program
from plannerforge.cli import program
from plannerforge.server.settings import Settings

SCENARIO = "ZAM_Fahrhausen-4_1_T-1"


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The addresses that a browser was asked to open."""
    asked: list[str] = []
    monkeypatch.setattr(webbrowser, "open", asked.append)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    return asked


@pytest.mark.usefixtures("starter_ready", "warm_workers")
def test_a_page_is_written_and_opened_if_there_is_a_screen(
    settings: Settings, opened: list[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    command = ["view", SCENARIO, "--workspace", str(settings.workspace)]
    first = CliRunner().invoke(program.application, command)
    assert first.exit_code == 0, first.output
    page = Path(first.stdout.strip())
    assert page.name == f"{SCENARIO}.html"
    assert SCENARIO in page.read_text(encoding="utf-8")
    assert opened == []
    monkeypatch.setenv("DISPLAY", ":0")
    elsewhere = tmp_path / "seen.html"
    CliRunner().invoke(program.application, [*command, "--no-open"])
    assert opened == []
    again = CliRunner().invoke(program.application, [*command, "--output", str(elsewhere)])
    assert again.exit_code == 0, again.output
    assert opened == [elsewhere.as_uri()]
    assert elsewhere.read_bytes() == page.read_bytes()


@pytest.mark.usefixtures("starter_ready", "opened")
@pytest.mark.parametrize(
    ("words", "told"),
    [
        ([SCENARIO] * 3, "two of them, side by side"),
        (["ZAM_Nowhere-1_1_T-1"], "unknown_name"),
        (["current"], "no view shows"),
    ],
)
def test_artifacts_without_a_view_are_refused(
    settings: Settings, words: list[str], told: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["plannerforge", "view", *words, "--workspace", str(settings.workspace)])
    with pytest.raises(SystemExit, match="1"):
        program.run(program.application)
    assert told in capsys.readouterr().err


@pytest.mark.usefixtures("starter_ready", "opened")
def test_plans_of_a_stepwise_program_are_shown_until_it_is_edited(settings: Settings, tmp_path: Path) -> None:
    stepper = tmp_path / "program.py"
    stepper.write_bytes(Path(stepwise_program.__file__).read_bytes())
    section = {"summary": "drives on", "command": [sys.executable, str(stepper), "drives"], "protocol": "stepwise"}
    page = tmp_path / "page.html"

    def invoke(*words: str) -> str:
        known = {"PLANNERFORGE_PLANNERS": json.dumps({"stepper": section})}
        done = CliRunner().invoke(program.application, [*words, "--workspace", str(settings.workspace)], env=known)
        assert done.exit_code == 0, done.output
        return done.stdout

    asked = json.dumps({"scenarios": [SCENARIO], "configs": ["stepper"], "wait_s": 50})
    run_id = json.loads(invoke("call", "run_planner", asked, "--json"))["runs"][0]["run_id"]
    invoke("view", run_id, "--output", str(page))
    assert '"plans":[{"step":0,' in page.read_text(encoding="utf-8")
    stepper.write_text(stepper.read_text(encoding="utf-8") + "# edited\n", encoding="utf-8")
    shutil.rmtree(settings.workspace / "views")  # what was made before the edit stays right
    invoke("view", run_id, "--output", str(page))
    edited = page.read_text(encoding="utf-8")
    assert '"plans":[]' in edited
    assert "stepper was edited since this run" in edited
