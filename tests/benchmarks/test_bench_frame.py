"""The frame of benchmarks that consist of parts: what it measures, what it names, and its exit status."""

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

from benchmarks.harness import Figures, LeftOut, Parts, SeededBench


def honest(bench: SeededBench) -> Figures:
    return {"right": float(bench.seed), "cases": bench.limit or 0}


def owing(bench: SeededBench) -> Figures:
    return {"cases": bench.seed}


def failing(bench: SeededBench) -> Figures:
    raise ValueError(str(bench.seed))


def missing(bench: SeededBench) -> Figures:
    raise LeftOut(f"nothing in {bench.shared.name}")


def run(
    part: object, arguments: Sequence[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> tuple[int, Mapping[str, object], str]:
    monkeypatch.setattr(Parts, "find", lambda parts, name: part)
    monkeypatch.setattr(sys, "argv", ["made_bench", *arguments])
    parts: Parts[SeededBench] = Parts("made_bench", {"part": ("right",)})
    status = parts.run("Made", SeededBench.options(__doc__), SeededBench.of)
    said = capsys.readouterr()
    return status, json.loads(said.out.splitlines()[-1]), said.err


def test_the_last_line_contains_the_figures_of_the_parts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["--shared", str(tmp_path), "--seed", "7", "--limit", "3"]
    assert run(honest, given, monkeypatch, capsys)[:2] == (0, {"right": 7.0, "cases": 3})


@pytest.mark.parametrize("part", [owing, failing, missing, None])
def test_a_part_that_fails_or_owes_a_key_is_named_and_the_status_is_1(
    part: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    status, figures, told = run(part, ["--shared", str(tmp_path), "--json"], monkeypatch, capsys)
    assert status == 1
    assert "right" not in figures
    assert "part: " in told


def test_a_key_that_no_part_owes_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        run(honest, ["--shared", str(tmp_path), "--only", "wrong"], monkeypatch, capsys)
    assert ended.value.code == 2
    assert "valid are part, right" in capsys.readouterr().err
