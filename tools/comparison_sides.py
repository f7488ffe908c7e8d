"""What is compared with what: runs, batches, or the configurations of one batch."""

from collections.abc import Sequence

from plannerforge.schemas.comparison import Side
from plannerforge.schemas.errors import InvalidRequest
from plannerforge.schemas.results import RunSource
from plannerforge.tools.result_choice import ChosenResult


def sides_of(chosen: Sequence[ChosenResult], runs: Sequence[RunSource]) -> tuple[Side, ...]:
    """The sides in the given order.

    A batch gives one side a configuration; single runs with several configurations are put together by configuration;
    two runs of one configuration stand against each other.

    Raises:
        InvalidRequest: there is only one side.
    """
    by_id = {run.record.run_id: run for run in runs}
    if all(found.kind == "run" for found in chosen) and len({run.record.config_id for run in runs}) > 1:
        groups = [("", list(by_id.values()))]
    else:
        groups = [(found.result_id, [by_id[run_id] for run_id in found.run_ids]) for found in chosen]
    sides = [side for label, members in groups for side in _by_config(label, members, alone=len(groups) == 1)]
    if len(sides) < 2:
        found = ", ".join(side.label for side in sides)
        raise InvalidRequest(
            f"only one side: {found}",
            valid=["two runs or batches", "one batch with several configurations"],
            next_step="run another configuration on the same scenarios with run_planner",
        )
    return tuple(sides)


def _by_config(label: str, members: Sequence[RunSource], *, alone: bool) -> list[Side]:
    groups: dict[str, list[RunSource]] = {}
    for member in members:
        groups.setdefault(member.record.config_id, []).append(member)
    names = [group[0].record.config_name for group in groups.values()]
    sides = []
    for config_id, group in groups.items():
        name = group[0].record.config_name
        words = name if names.count(name) == 1 else f"{name} {config_id}"
        sides.append(
            Side(
                label=words if alone else f"{words} ({label})",
                config_id=config_id,
                config_name=name,
                run_ids=tuple(member.record.run_id for member in group),
            )
        )
    return sides
