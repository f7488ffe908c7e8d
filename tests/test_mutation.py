"""The mutants that ``make bench-mutation`` draws: changes of what functions do, never of how answers are worded."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

MUTANTS = Path(__file__).resolve().parent.parent / "scripts" / "mutation" / "mutants.py"


@pytest.fixture(scope="module")
def mutants() -> ModuleType:
    spec = importlib.util.spec_from_file_location("mutants", MUTANTS)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["mutants"] = module
    spec.loader.exec_module(module)
    return module


def changes(mutants: ModuleType, folder: Path, code: str) -> set[str]:
    (folder / "code.py").write_text(code)
    drawn, of = mutants.sample(folder, ["code.py"], 1000, seed=1)
    assert len(drawn) == of
    return {mutant.change for mutant in drawn}


def test_conditions_numbers_and_arguments_are_mutated(mutants: ModuleType, tmp_path: Path) -> None:
    found = changes(mutants, tmp_path, "def f(a, b):\n    return g(a, b) if a < 1 else 0\n")
    assert {"< 1  ->  <= 1", "1  ->  2", "g(a, b)  ->  g(None, b)", "g(a, b)  ->  g(b)"} <= found


@pytest.mark.parametrize(
    "line",
    [
        'raise ValueError(f"{a + 1} is too much", a)',
        'text: "int | None" = f"{a + 1}"',
        'report(0.3 + 0.1, "reading")',
        '"a text"',
        "isinstance(a, int)",
    ],
)
def test_wording_types_and_progress_are_left_alone(mutants: ModuleType, tmp_path: Path, line: str) -> None:
    assert changes(mutants, tmp_path, f"def f(a):\n    {line}\n") == set()


def test_what_runs_at_import_is_left_alone(mutants: ModuleType, tmp_path: Path) -> None:
    code = "NEAR_M = 20.0 + 1\n\n@cached(size=8)\nclass A:\n    x: int = field(default=1)\n"
    assert changes(mutants, tmp_path, code) == set()


def test_arguments_that_are_texts_stay_beside_others(mutants: ModuleType, tmp_path: Path) -> None:
    found = changes(mutants, tmp_path, 'def f(a, b):\n    g(a, "a text")\n    zip(a, b, strict=True)\n')
    assert found == {
        'g(a, "a text")  ->  g(None, "a text")',
        'g(a, "a text")  ->  g("a text")',
        "zip(a, b, strict=True)  ->  zip(None, b, strict=True)",
        "zip(a, b, strict=True)  ->  zip(a, None, strict=True)",
        "zip(a, b, strict=True)  ->  zip(b, strict=True)",
        "zip(a, b, strict=True)  ->  zip(a, strict=True)",
    }


def test_a_seed_draws_the_same_mutants_again(mutants: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "code.py").write_text("def f(a, b, c):\n    return g(a, b, c) + g(c, b, a) * 2\n")
    one, again, other = (
        [mutant.change for mutant in mutants.sample(tmp_path, ["code.py"], 5, seed)[0]] for seed in (1, 1, 2)
    )
    assert one == again != other


def test_a_mutant_differs_from_its_file_in_its_change_alone(mutants: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "code.py").write_text("# kept\ndef f(a):\n    b = a\n    return a > 1\n")
    drawn, _ = mutants.sample(tmp_path, ["code.py"], 100, seed=1)
    source = next(mutant.source for mutant in drawn if mutant.change == "> 1  ->  >= 1")
    assert source == "# kept\ndef f(a):\n    b = a\n    return a >= 1\n"
