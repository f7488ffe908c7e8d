"""The bench of findings: its drives are what they are meant to be, and a product that names nothing is found out."""

import random
from pathlib import Path

import pytest

from benchmarks.analysis.planted import findings_of, names
from plannerforge.engine.analysis import findings


def test_a_planted_cause_is_named_and_its_collisions_were_predicted_differently(tmp_path: Path) -> None:
    found = findings_of("blind", random.Random(1), tmp_path)
    assert names("blind", found)
    (unforeseen,) = (one for one in found if one.name == "unforeseen")
    assert len(unforeseen.run_ids) == 8


def test_a_weight_is_named_by_its_name(tmp_path: Path) -> None:
    found = findings_of("weight velocity_offset", random.Random(2), tmp_path)
    assert names("weight velocity_offset", found)
    assert not names("weight prediction", found)


def test_findings_that_name_no_cause_are_detected(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(findings, "FINDINGS", ())
    assert not names("class truck", findings_of("class truck", random.Random(3), tmp_path))


def test_a_leader_at_constant_speed_is_not_unforeseen(tmp_path: Path) -> None:
    found = findings_of("weight prediction", random.Random(6), tmp_path)
    assert names("weight prediction", found)
    assert "unforeseen" not in {one.name for one in found}
