"""All rules, in the order in which they are run and reported.

Adding one: its file with a ``RULE``, its name here, its defect in the tests, its line in ``docs/rules.md``.
"""

import importlib

from plannerforge.engine.network.rules.rule import Rule

NAMES: tuple[str, ...] = (
    "unequal_bounds",
    "too_few_points",
    "coordinate_not_finite",
    "repeated_points",
    "bound_crosses_itself",
    "bounds_cross",
    "bounds_swapped",
    "too_short",
    "too_narrow",
    "too_wide",
    "folds_back",
    "too_tight",
    "unknown_successor",
    "unknown_neighbour",
    "one_way_succession",
    "gap_at_join",
    "heading_jump",
    "follows_itself",
    "follows_and_lies_beside",
    "one_way_neighbour",
    "neighbour_direction",
    "neighbour_apart",
    "neighbour_on_both_sides",
    "overlapping_lanelets",
    "isolated_lanelet",
    "repeated_id",
    "unknown_sign",
    "unknown_light",
    "unused_sign",
    "unused_light",
    "sign_without_plate",
    "unknown_sign_number",
    "implausible_speed_limit",
    "light_without_cycle",
    "phase_without_duration",
    "light_never_green",
    "unknown_colour",
    "sign_far_away",
    "stop_line_misplaced",
    "stop_line_at_beginning",
    "unknown_lanelet_at_intersection",
    "intersection_without_incoming",
    "incoming_without_lanelet",
    "incoming_without_exit",
    "exit_not_behind_incoming",
    "lanelet_in_two_incomings",
    "unknown_lanelet_type",
    "unknown_user",
    "unknown_line_marking",
)


def all_rules() -> tuple[Rule, ...]:
    """The rules, loaded from their files."""
    return tuple(_load(name) for name in NAMES)


def _load(name: str) -> Rule:
    rule: Rule = importlib.import_module(f"{__package__}.{name}").RULE
    return rule
