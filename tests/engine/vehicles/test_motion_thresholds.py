"""Thresholds of motion that decide results have one definition each, with a source or a reason."""

import ast
import re

from support.tree import CHECKOUT

HOME = CHECKOUT / "engine" / "vehicles" / "motion_thresholds.py"
SHARED_WORDS = re.compile(r"_?(STANDING_MPS|STANDS_MPS|STANDSTILL_MPS|REACTION_S|NEAR_M)")


def test_each_threshold_has_its_source_or_its_reason() -> None:
    body = ast.parse(HOME.read_text(encoding="utf-8")).body[1:]
    constants, reasons = body[::2], body[1::2]
    assert all(isinstance(node, ast.Assign) for node in constants)
    assert all(isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) for node in reasons)
    assert len(constants) == len(reasons) > 0


def test_no_other_module_of_the_engine_redefines_these_words() -> None:
    found = [
        f"{path.name}: {target.id}"
        for path in (CHECKOUT / "engine").rglob("*.py")
        if path != HOME and SHARED_WORDS.search(text := path.read_text(encoding="utf-8"))
        for node in ast.parse(text).body
        if isinstance(node, ast.Assign | ast.AnnAssign)
        for part in (node.targets if isinstance(node, ast.Assign) else [node.target])
        for target in (part.elts if isinstance(part, ast.Tuple) else [part])
        if isinstance(target, ast.Name) and SHARED_WORDS.fullmatch(target.id)
    ]
    assert found == [], "define it in engine/vehicles/motion_thresholds.py, or name what it is"
