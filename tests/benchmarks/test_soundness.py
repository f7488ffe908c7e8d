"""``make bench-robust``: which parts are measured again, and what is said of unknown ones."""

import json
import subprocess
import sys
from pathlib import Path


def soundness(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "benchmarks.robustness.soundness", "--seeds", "7", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_a_part_with_the_same_arguments_is_not_measured_again(tmp_path: Path) -> None:
    kept = {"arguments": ["modification.drivable"], "figures": {"drivable_share": 0.75, "files": 3}}
    (tmp_path / "drivable.json").write_text(json.dumps(kept))
    done = soundness("--parts", "drivable", "--record", str(tmp_path))
    assert done.returncode == 0
    assert json.loads(done.stdout.splitlines()[-1]) == {"drivable_share": 0.75}


def test_a_figure_that_a_part_does_not_report_fails_the_whole(tmp_path: Path) -> None:
    (tmp_path / "drivable.json").write_text(
        json.dumps({"arguments": ["modification.drivable"], "figures": {"files": 3}})
    )
    done = soundness("--parts", "drivable", "--record", str(tmp_path))
    assert done.returncode == 1
    assert "not measured: drivable" in done.stderr


def test_an_unknown_part_is_refused_with_the_known_ones(tmp_path: Path) -> None:
    done = soundness("--parts", "drivabel", "--record", str(tmp_path))
    assert done.returncode == 2
    assert "drivabel" in done.stderr
    assert "symmetries" in done.stderr
