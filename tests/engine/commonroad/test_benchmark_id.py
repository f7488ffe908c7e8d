"""What a benchmark id says, and which ids are taken."""

import pytest

from plannerforge.engine.commonroad.benchmark_id import parse_benchmark_id, without_blanks
from plannerforge.schemas.errors import UnsafeInput


@pytest.mark.parametrize(
    ("benchmark_id", "expected"),
    [
        ("DEU_A99-1_2_T-1", ("DEU", "A99")),
        ("C-DEU_B471-1_3_T-1", ("DEU", "B471")),
        ("ZAM_OpenDrive-1", ("ZAM", "OpenDrive")),
        ("ZAM_test_0-1", ("ZAM", "test_0")),
        ("DEU-Muc-1_1_T-1", ("DEU", "Muc")),
        ("USA_US101-1-1-T-1-2", ("USA", "US101")),
        ("lanker 1".replace(" ", "-"), ("ZAM", "lanker")),
    ],
)
def test_country_and_place_come_from_the_benchmark_id(benchmark_id: str, expected: tuple[str, str]) -> None:
    assert parse_benchmark_id(benchmark_id) == expected


@pytest.mark.parametrize("benchmark_id", ["", "../../etc/passwd", "DEU_../x-1_1_T-1", "DEU_" + "a" * 500, "x y"])
def test_ids_that_are_not_ordinary_file_names_are_refused(benchmark_id: str) -> None:
    with pytest.raises(UnsafeInput, match="naming"):
        parse_benchmark_id(benchmark_id)


def test_blanks_in_an_id_become_a_letter_that_names_of_files_may_have() -> None:
    assert without_blanks(" uncontrolled  intersection ") == "uncontrolled_intersection"
    assert parse_benchmark_id(without_blanks("uncontrolled intersection")) == ("ZAM", "uncontrolled")
    assert without_blanks("DEU_Test-1_1_T-1") == "DEU_Test-1_1_T-1"
