"""Recipes: the same request has the same digest, on whichever day and in whichever process."""

import os
import subprocess
import sys

import pytest

from plannerforge.engine.workspace.recipe import Recipe, versions_of

PROGRAM = """
from plannerforge.engine.workspace.recipe import Recipe
tags = {"urban", "rural", "speed_limit", "größe", "intersection"}
arguments = {name: len(name) for name in tags} | {"tags": sorted(tags)}
print(Recipe(tool="find", arguments=arguments, parents=("a", "b"), seed=3, versions={"x": "1"}).digest)
"""


def digest_in_a_process_with(seed: str) -> str:
    environment = {**os.environ, "PYTHONHASHSEED": seed}
    return subprocess.run(
        [sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, check=True
    ).stdout


def test_digest_is_the_same_with_another_hash_seed() -> None:
    assert digest_in_a_process_with("1") == digest_in_a_process_with("4242")


def test_digest_ignores_the_order_of_keys() -> None:
    one = Recipe(tool="t", arguments={"a": 1, "b": {"c": 2, "d": 3}}, versions={"x": "1", "y": "2"})
    other = Recipe(tool="t", arguments={"b": {"d": 3, "c": 2}, "a": 1}, versions={"y": "2", "x": "1"})
    assert one.digest == other.digest


def test_digest_is_twelve_hexadecimal_characters_and_never_moves() -> None:
    assert Recipe(tool="generate_scenarios", arguments={"place": "Köln"}, seed=1).digest == "79aa784af7b5"


@pytest.mark.parametrize(
    "changed",
    [
        {"tool": "other"},
        {"arguments": {"a": 2}},
        {"arguments": {"a": [2, 1]}},
        {"parents": ("q", "p")},
        {"seed": 8},
        {"versions": {"sumo": "1.29"}},
    ],
)
def test_digest_tells_different_requests_apart(changed: dict[str, object]) -> None:
    base = Recipe(tool="t", arguments={"a": [1, 2]}, parents=("p", "q"), seed=7, versions={"sumo": "1.28"})
    assert base.model_copy(update=changed).digest != base.digest


def test_recipe_survives_being_stored() -> None:
    recipe = Recipe(tool="t", arguments={"a": [1, 2.5, None, "é"]}, parents=("p",), seed=7, versions={"sumo": "1.28"})
    assert Recipe.model_validate_json(recipe.model_dump_json()).digest == recipe.digest


def test_versions_are_sorted_and_name_our_own() -> None:
    versions = versions_of("pydantic", "anyio")
    assert list(versions) == ["anyio", "plannerforge-mcp", "pydantic"]
    assert all(versions.values())
