"""Finds one possible edit of each kind by trying: a dry run makes nothing, and a refusal says what is valid."""

from typing import Any

from plannerforge.agent.demo_session import DemoSession

MOST_TRIES = 12


async def one_edit_of_each_kind(session: DemoSession, described: dict[str, Any]) -> list[dict[str, Any]]:
    """Edits T, B, P and G of which each, and all together, pass a dry run; fewer where the scenario allows fewer."""
    accepted: list[dict[str, Any]] = []
    for kind, candidates in _candidates(described).items():
        edit = await _first_possible(session, described["scenario_id"], accepted, candidates)
        if edit is None:
            session.console.says(f"No {kind} is possible here after {min(len(candidates), MOST_TRIES)} tries.")
        else:
            accepted.append(edit)
    return accepted


async def _first_possible(
    session: DemoSession, scenario_id: str, before: list[dict[str, Any]], candidates: list[dict[str, Any]]
) -> dict[str, Any] | None:
    for candidate in candidates[:MOST_TRIES]:
        arguments = {"scenario_id": scenario_id, "edits": [*before, candidate], "dry_run": True}
        step = await session.ask("modify_scenario", arguments, quiet=True)
        if not step.refused:
            return candidate
        session.console.says(f"tried {candidate}: {step.text}")
    return None


def _candidates(described: dict[str, Any]) -> dict[str, list[dict[str, Any]]]:
    """What may be tried, kind by kind, the best first."""
    description = described["description"]
    moving = [str(vehicle["vehicle_id"]) for vehicle in description["vehicles"] if vehicle["moves"]]
    ego = description["ego"] or {"goal_lanelets": [], "route": []}
    goals = [*ego["goal_lanelets"], *reversed(ego["route"])]
    return {
        "reroute": [
            {"op": "reroute", "vehicles": [vehicle], "turn": turn}
            for vehicle in moving[:4]
            for turn in ("left", "right", "straight")
        ],
        "change of behaviour": [
            {"op": "set_behaviour", "vehicles": [which], "preset": "aggressive"}
            for which in ("lead", "nearest:1", *moving)
        ],
        "added vehicle": [
            {"op": "add_vehicle", "vehicle_class": kind, "at": "ego", "lane": lane, "offset_m": offset}
            for kind, lane, offset in (
                ("truck", "same", 35),
                ("car", "same", 25),
                ("car", "left", 15),
                ("car", "same", -20),
                ("car", "same", 60),
            )
        ],
        "new goal": [
            {"op": "set_goal", "to": [str(lanelet)], "position": position, "goal_time": "4..14s"}
            for lanelet in dict.fromkeys(goals)
            for position in ("final", "middle")
        ],
    }
