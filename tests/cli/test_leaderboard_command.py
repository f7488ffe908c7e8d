"""``plannerforge leaderboard``: a request that cannot be met exits with 2 and says what is valid."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from plannerforge.cli.main import application


@pytest.mark.parametrize(
    ("flags", "valid"), [(["--boundary", "cut_inn"], "cut_in"), (["--planner", "frenetixx"], "frenetix")]
)
def test_unknown_names_exit_with_2_and_the_valid_ones(tmp_path: Path, flags: list[str], valid: str) -> None:
    workspace = ["--workspace", str(tmp_path / "workspace")]
    result = CliRunner().invoke(application, ["leaderboard", str(tmp_path / "board"), *flags, *workspace])
    assert result.exit_code == 2, result.output
    assert valid in result.output
    assert not (tmp_path / "board").exists()
