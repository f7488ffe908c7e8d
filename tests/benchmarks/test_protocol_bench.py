"""The bench of the stepwise protocol: a fault is named, nothing is left, and both forms of a planner are asked."""

from pathlib import Path

from benchmarks.harness import SeededBench
from benchmarks.loop import protocol


def test_a_fault_is_named_and_a_step_has_its_cost(tmp_path: Path) -> None:
    figures = protocol.measure(SeededBench(tmp_path, tmp_path, limit=1))
    assert (figures["protocol_named"], figures["protocol_kinds"], figures["protocol_left"]) == (1.0, 1, 0)
    assert isinstance(figures["protocol_class_ms"], float)
    assert isinstance(figures["protocol_program_ms"], float)
    assert 0 < figures["protocol_class_ms"] < figures["protocol_program_ms"]


def test_there_are_at_least_the_required_kinds_of_faults() -> None:
    assert len(protocol.EXPECTED) >= 12
    assert {"timed_out", "flooded_output", "died", "not_json", "wrong_step"} <= set(protocol.EXPECTED.values())
