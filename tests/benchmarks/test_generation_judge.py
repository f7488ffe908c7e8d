"""The judges of a generated scenario's place, vehicles and motion see what is right, and what is wrong."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.generation_bench import Road, made, mapped

from benchmarks.generation.motion import TOUCHING_M
from benchmarks.tracks import is_drivable, overlap_steps
from plannerforge.engine.commonroad.tracks import Track
from plannerforge.evals.scoring.made_files import has_vehicles, is_at_street, is_in_box
from plannerforge.evals.scoring.map_evidence import MapEvidence

SECONDARY = Road("road", "a", "b")


def test_the_middle_must_be_in_the_box() -> None:
    files = made([SECONDARY])
    assert is_in_box(files, (49.9, 9.9, 50.1, 10.1), 0.0)
    for box in ((50.01, 9.9, 50.1, 10.1), (49.9, 9.9, 49.99, 10.1), (49.9, 10.01, 50.1, 10.1), (49.9, 9.9, 50.1, 9.99)):
        assert not is_in_box(files, box, 0.0001)


@pytest.mark.parametrize(
    ("street", "right"),
    [
        ("High Street", True),
        ("A4", True),
        ("High Street, Redfield", True),
        ("Low Street", False),
        ("High Street, Whitefield", False),
        ("Far Lane", False),
    ],
)
def test_the_street_has_to_be_named_near_the_middle(street: str, *, right: bool) -> None:
    high = mapped((0, -400), (0, 400), highway="primary", name="Upper High Street", ref="B 2;A 4")
    far = mapped((900, 0), (900, 400), highway="primary", name="Far Lane")
    assert is_at_street(made([]), street, ["Redfield"], MapEvidence((high, far))) == right


@pytest.mark.parametrize(
    ("wished", "right"),
    [
        ({"car": (2, 2), "trailer": (1, None), "moped": (1, None)}, True),
        ({"car": (3, None)}, False),
        ({"car": (1, 1)}, False),
        ({"truck": (1, None)}, False),
        ({"motorcycle": (1, None)}, False),
    ],
)
def test_classes_are_recognised_by_type_and_length_and_counted(
    wished: dict[str, tuple[int, int | None]], *, right: bool
) -> None:
    obstacles = (("car", 4.5), ("car", 4.5), ("truck", 16.5), ("motorcycle", 2.1))
    assert has_vehicles(replace(made([]), obstacles=obstacles), wished) == right


def track(first_step: int = 0, offset: tuple[float, float] = (0.0, 0.0), aside_m: float = 0.0) -> Track:
    """A car at 10 m/s along x, which at step 10 may jump aside."""
    steps = np.arange(30)
    positions = np.stack([steps + offset[0], offset[1] + aside_m * (steps > 10)], axis=1)
    return Track(1, "car", 4.5, 1.8, first_step, positions, np.zeros(30), np.full(30, 10.0))


def test_overlaps_are_seen_at_the_same_time_only() -> None:
    assert overlap_steps(track(), track(offset=(4.0, 1.0)), TOUCHING_M) == list(range(30))
    for clear in (track(offset=(4.5, 0.0)), track(offset=(4.6, 0.0)), track(offset=(0.0, 1.9)), track(first_step=40)):
        assert overlap_steps(track(), clear, TOUCHING_M) == []
    assert overlap_steps(track(), track(offset=(0.0, 6.0), aside_m=-6.0), TOUCHING_M) == list(range(11, 30))
    assert overlap_steps(track(), track(first_step=5, offset=(5.0, 0.0)), TOUCHING_M) == list(range(5, 30))


def test_a_jump_cannot_be_driven() -> None:
    assert is_drivable(track(), 0.1)
    assert not is_drivable(track(aside_m=0.5), 0.1)


def test_evidence_is_read_from_the_file(tmp_path: Path) -> None:
    from plannerforge.evals.scoring.map_evidence import read_evidence

    path = tmp_path / "map.osm"
    path.write_text(
        '<osm><node id="1" lat="50" lon="10"/><node id="2" lat="50.0001" lon="10"/>'
        '<way id="3"><nd ref="1"/><nd ref="2"/><nd ref="9"/><tag k="highway" v="primary"/>'
        '<tag k="name" v="Rue de l\'Église"/><tag k="maxspeed" v="70"/></way></osm>',
        encoding="utf-8",
    )
    evidence = read_evidence(path)
    assert evidence.names_near("rue de l'eglise", 50.0, 10.001, 100.0)
    assert not evidence.names_near("rue de l'eglise", 50.0, 10.002, 100.0)
    assert evidence.limits_kmh(50.0, 10.0, 5.0) == [70.0]
