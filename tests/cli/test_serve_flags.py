"""Every setting is a flag of ``serve``, a flag wins over environment and file, and no secret is one."""

from pathlib import Path
from typing import Any

import pytest
import typer
from typer.main import get_command
from typer.testing import CliRunner, Result

from plannerforge.cli.flags import PANELS, SECRET, SettingsCommand, settings_of
from plannerforge.cli.program import application
from plannerforge.server.settings import Settings, settings_file

PLANNER = '{"mine": {"summary": "mine", "command": ["python3", "/mine.py"]}}'
WORDS: dict[str, tuple[list[str], Any]] = {
    "workspace": (["/w"], Path("/w")),
    "roots": (["/a", "/b:c"], (Path("/a"), Path("/b:c"))),
    "map_folders": (["/m"], (Path("/m"),)),
    "cluster": (["tcp://host:8786"], "tcp://host:8786"),
    "planners": ([PLANNER], {"mine"}),
    "operation_timeout_s": (["9.5"], 9.5),
    "worker_memory_mb": (["1024"], 1024),
    "embedding_model": (["intfloat/e5-small"], "intfloat/e5-small"),
    "maps_online": (["cache"], "cache"),
    "nominatim_url": (["https://names.example"], "https://names.example"),
    "overpass_urls": (["https://one.example", "https://two.example"], ("https://one.example", "https://two.example")),
    "maps_user_agent": (["somebody@example.org"], "somebody@example.org"),
    "tools": (["essential"], "essential"),
    "journal_redact": (["a,b", "[0-9]+"], ("a,b", "[0-9]+")),
    "http_host": (["::1"], "::1"),
    "http_url": (["https://forge.example/mcp"], "https://forge.example/mcp"),
    "http_hosts": (["one.example", "two.example"], ("one.example", "two.example")),
    "http_origins": (["https://one.example"], ("https://one.example",)),
    "http_token_file": (["/tokens"], Path("/tokens")),
    "http_proxies": (["192.0.2.1"], ("192.0.2.1",)),
    "oauth_issuer": (["https://who.example"], "https://who.example"),
    "oauth_keys_url": (["https://who.example/keys"], "https://who.example/keys"),
    "log_level": (["INFO"], "INFO"),
    "log_format": (["json"], "json"),
    "telemetry_endpoint": (["http://127.0.0.1:4318"], "http://127.0.0.1:4318"),
    "server_memory_mb": (["512"], 512),
}
"""Values for the flags of settings that are neither yes or no, nor a number that may be 7."""


def words_for(name: str) -> tuple[list[str], Any]:
    """What a command line says to give a setting a value that is not its default, and the value."""
    spelled, default = name.replace("_", "-"), Settings.model_fields[name].default
    if isinstance(default, bool):
        return [f"--no-{spelled}" if default else f"--{spelled}"], not default
    values, value = WORDS.get(name, (["7"], 7))
    return [word for one in values for word in (f"--{spelled}", one)], value


def settings_by(*words: str) -> tuple[Result, list[Settings]]:
    """What a command with all flags says to these words, and the settings that it has."""
    seen: list[Settings] = []
    program = typer.Typer()

    @program.command(cls=SettingsCommand)
    def show(context: typer.Context) -> None:
        seen.append(settings_of(context))

    return CliRunner().invoke(program, words), seen


def test_every_setting_is_under_one_heading_or_secret() -> None:
    headed = [name for names in PANELS.values() for name in names]
    assert sorted([*headed, *SECRET]) == sorted(Settings.model_fields)


def test_serve_has_a_flag_for_every_setting_that_is_not_secret() -> None:
    serve = get_command(application).commands["serve"]  # type: ignore[attr-defined]
    flags = {flag for option in serve.params for flag in option.opts}
    assert {f"--{name.replace('_', '-')}" for name in set(Settings.model_fields) - SECRET} <= flags
    assert {"--http", "--host", "--port", "--token-file"} <= flags
    assert not any("tokens" in flag for flag in flags)


@pytest.mark.parametrize("name", sorted(set(Settings.model_fields) - SECRET))
def test_a_flag_reaches_its_setting(name: str) -> None:
    words, expected = words_for(name)
    result, seen = settings_by(*words)
    assert result.exit_code == 0, result.output
    value = getattr(seen[0], name)
    assert (set(value) if name == "planners" else value) == expected
    assert value != getattr(Settings(), name)


def test_a_flag_wins_over_the_environment_and_that_over_the_file(monkeypatch: pytest.MonkeyPatch) -> None:
    settings_file().parent.mkdir(parents=True, exist_ok=True)
    settings_file().write_text("maps_delay_s = 3\nstarter = false\nhttp_hosts = ['file.example']\nmaps_km2 = 4\n")
    assert settings_by()[1][0].maps_delay_s == 3
    monkeypatch.setenv("PLANNERFORGE_MAPS_DELAY_S", "4")
    monkeypatch.setenv("PLANNERFORGE_HTTP_HOSTS", "variable.example")
    (by_variable,) = settings_by()[1]
    assert (by_variable.maps_delay_s, by_variable.http_hosts) == (4, ("variable.example",))
    (settings,) = settings_by("--maps-delay-s", "5", "--starter", "--http-hosts", "flag.example")[1]
    assert (settings.maps_delay_s, settings.starter, settings.http_hosts) == (5, True, ("flag.example",))
    assert settings.maps_km2 == 4


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--maps-delay-s", "-1"), "--maps-delay-s: "),
        (("--http-rate", "0"), "--http-rate: "),
        (("--planners", "{mine"), "--planners: "),
        (("--nominatim-url", "ftp://names.example"), "--nominatim-url: "),
    ],
)
def test_a_wrong_value_is_reported_with_its_flag(words: tuple[str, ...], told: str) -> None:
    result, seen = settings_by(*words)
    assert (result.exit_code, seen) == (2, [])
    assert result.stderr.startswith(f"plannerforge: {told}")
    assert result.stderr.count("\n") == 1


def test_help_shows_headings_defaults_and_brackets_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    told = CliRunner().invoke(application, ["serve", "--help"]).stdout
    for words in (*PANELS, "[default: 8765]", "NAME TOKEN [read-only]", "[planners.NAME]", "offline|cache|online"):
        assert words in told
