"""Times of generated scenarios: what counts, and where it goes."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from benchmarks import harness
from benchmarks.generation.cases import Session
from benchmarks.generation.figures import READING, Stages
from benchmarks.harness import Spent
from plannerforge.evals.scoring.map_evidence import BenchMaps


def measured(*, first_read: bool) -> Stages:
    return Stages(first_read, {READING: Spent(3.0, 2.0), "running netconvert": Spent(0.5, 0.25)})


def test_only_the_first_reading_of_a_map_is_left_out() -> None:
    assert measured(first_read=True).counted == Spent(0.5, 0.25)
    assert measured(first_read=False).counted == Spent(3.5, 2.25)


def test_waiting_counts_on_the_clock_and_netconvert_for_the_processor(monkeypatch: pytest.MonkeyPatch) -> None:
    def clock(wall_s: float, own_s: float, children_s: float) -> None:
        times = SimpleNamespace(user=own_s, system=0.0, children_user=children_s, children_system=0.0)
        monkeypatch.setattr(harness, "time", SimpleNamespace(perf_counter=lambda: wall_s))
        monkeypatch.setattr(harness, "os", SimpleNamespace(times=lambda: times))

    stages = Stages()
    clock(100.0, 7.0, 1.0)
    stages(0.0, "waiting")
    clock(105.0, 7.0, 1.0)
    stages(0.5, "running netconvert")
    clock(108.0, 7.5, 3.0)
    stages(1.0)
    assert stages.spent == {"waiting": Spent(5.0, 0.0), "running netconvert": Spent(3.0, 2.5)}
    assert stages.counted == Spent(8.0, 2.5)


def test_a_session_knows_the_first_reading_of_every_map() -> None:
    session = Session(BenchMaps((), {}, {}, {}))
    assert [session.reads(name) for name in ("a.osm", Path("b.osm"), "a.osm", "b.osm")] == [True, True, False, False]
