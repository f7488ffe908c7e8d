"""docs/generation.md says what the code does: arguments with defaults, sites, densities, classes, checks, limits."""

import re
from pathlib import Path

import pytest

from plannerforge.engine.generation.checks import LEAST_FEASIBLE, LEAST_ON_LANELETS
from plannerforge.engine.generation.sites import RADIUS_M
from plannerforge.engine.generation.traffic import MOST_STATES
from plannerforge.engine.maps.osm import LIMITS
from plannerforge.engine.maps.site_search.finder import MERGE_M, SIGNAL_REACH_M
from plannerforge.engine.maps.unpacking import LARGEST_BYTES, MAP_ENDINGS
from plannerforge.engine.traffic.simulation import WARM_UP_S
from plannerforge.engine.traffic.vehicle_counts import FEWEST, MOST, PAPER_TRIPS, VEHICLES_PER_LANE_KM
from plannerforge.engine.vehicles.classes import PEDESTRIAN, vehicle_classes
from plannerforge.schemas.generation import Checks, GenerateScenariosArguments
from plannerforge.workflows.generation.making import CHECK
from plannerforge.workflows.generation.record import verdicts
from plannerforge.workflows.generation.specification import MOST_VEHICLES

PAGE = (Path(__file__).resolve().parent.parent / "docs" / "generation.md").read_text(encoding="utf-8")


def table(heading: str) -> dict[str, list[str]]:
    """The cells of a table's rows, by the first one; the table is known by the first cell of its heading."""
    body = PAGE.split(f"\n\n| {heading} |", 1)[1].split("\n\n", 1)[0].splitlines()[2:]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in body]
    return {row[0].strip("`"): row[1:] for row in rows}


def test_every_argument_is_listed_with_its_default() -> None:
    rows = table("argument")
    fields = GenerateScenariosArguments.model_fields
    assert list(rows) == list(fields)
    for name, field in fields.items():
        if field.default in (None, []):
            assert re.match(r"none|`roads`", rows[name][0]), name
        else:
            assert rows[name][0].strip("`").lower() == str(field.default).lower(), name


@pytest.mark.parametrize("kind", RADIUS_M)
def test_every_type_of_site_is_listed_with_its_radius(kind: str) -> None:
    assert table("`scenario_type`")[kind][-1] == f"{RADIUS_M[kind]:g} m"  # type: ignore[index]


def test_the_densities_match_the_code() -> None:
    wanted = {name: [f"{VEHICLES_PER_LANE_KM[name]:g}", str(PAPER_TRIPS[name])] for name in VEHICLES_PER_LANE_KM}
    assert table("`density`") == wanted
    assert f"at least {FEWEST} and at most {MOST} on a site" in PAGE
    assert f"At most {MOST_VEHICLES} vehicles" in PAGE
    assert f"({MOST_STATES:,} states in one file)" in PAGE
    assert f"SUMO simulates {WARM_UP_S:g} s" in PAGE


def test_every_class_is_listed_with_its_type_and_size() -> None:
    classes = (*vehicle_classes().values(), PEDESTRIAN)
    wanted = {c.name: [c.commonroad_type, f"{c.length_m:g} × {c.width_m:g} m"] for c in classes}
    said = {name: [kind, size.partition(";")[0]] for name, (kind, size) in table("class").items()}
    assert said == wanted


def test_every_check_of_the_answer_is_listed() -> None:
    checks = Checks(
        schema_valid=True,
        goal_reachable=True,
        collisions_at_start=0,
        overlapping_pairs=0,
        recorded_ego_collision_free=True,
        centers_on_lanelets=1.0,
        feasible_share=1.0,
        infeasible_vehicles=(),
    )
    passed, failed = verdicts(checks)
    assert {*passed, *failed, CHECK} <= set(table("check"))
    assert f"below {LEAST_FEASIBLE:.0%} or {LEAST_ON_LANELETS:.1%}".replace("%", " %") in PAGE


def test_the_limits_match_the_code() -> None:
    rows = " ".join(table("file"))
    parts = re.findall(r"\.(?:osm\.pbf|osm|net\.xml|gz|bz2)", " ".join(MAP_ENDINGS))
    assert all(part in rows for part in parts)
    assert f"at most {LARGEST_BYTES / 1e6:g} MB" in PAGE
    assert f"more than {LIMITS.elements:,} elements" in PAGE
    assert f"within {MERGE_M:g} m are one" in PAGE
    assert f"or at most {SIGNAL_REACH_M:g} m after two or more signals" in PAGE
