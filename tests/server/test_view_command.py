"""``plannerforge view``: a page is written and its path printed; a browser is opened only where there is a screen."""

import webbrowser
from pathlib import Path

import pytest
from typer.testing import CliRunner

from plannerforge.server import command_line
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


@pytest.mark.usefixtures("starter_ready")
def test_page_is_written_and_opened_where_there_is_a_screen(
    settings: Settings, opened: list[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    command = ["view", SCENARIO, "--workspace", str(settings.workspace)]
    first = CliRunner().invoke(command_line.application, command)
    assert first.exit_code == 0, first.output
    page = Path(first.stdout.strip())
    assert page.name == f"{SCENARIO}.html"
    assert SCENARIO in page.read_text(encoding="utf-8")
    assert opened == []
    monkeypatch.setenv("DISPLAY", ":0")
    elsewhere = tmp_path / "seen.html"
    CliRunner().invoke(command_line.application, [*command, "--no-open"])
    assert opened == []
    again = CliRunner().invoke(command_line.application, [*command, "--output", str(elsewhere)])
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
def test_what_cannot_be_seen_is_refused(
    settings: Settings, words: list[str], told: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["plannerforge", "view", *words, "--workspace", str(settings.workspace)])
    with pytest.raises(SystemExit, match="1"):
        command_line.run(command_line.application)
    assert told in capsys.readouterr().err
