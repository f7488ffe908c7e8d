"""Typed edits of a scenario: what ``modify_scenario`` takes, what its worker is asked, and what comes back."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, Literal, NamedTuple

from pydantic import Field

from .base import Answer, Arguments, Model, Result

EditOperation = Literal[
    "reroute",
    "change_lane",
    "set_speed",
    "shift_time",
    "set_behaviour",
    "add_vehicle",
    "remove_vehicle",
    "set_goal",
    "set_ego",
]
Letter = Literal["T", "B", "P", "G"]
"""The paper's kinds of edits: trajectory, behaviour, population, goal."""
TrafficAfterEdits = Literal["recorded", "reactive"]
"""Whether vehicles that no edit names stay as recorded, or are driven anew from their first state on."""
CheckedBy = Literal["closed_form", "drivability_checker"]
EditDetail = Literal["brief", "checks"]
"""``checks``: touched motions are judged by the drivability checker too, which takes up to a second each."""


class EditKind(NamedTuple):
    """What the tool knows of an operation: the paper's letter, and the arguments that belong to it."""

    letter: Letter
    arguments: tuple[str, ...]


EDITS: Final[dict[EditOperation, EditKind]] = {
    "reroute": EditKind("T", ("vehicles", "to", "via", "turn")),
    "change_lane": EditKind("T", ("vehicles", "lane", "time_s")),
    "set_speed": EditKind("T", ("vehicles", "speed", "time_s")),
    "shift_time": EditKind("T", ("vehicles", "time_s")),
    "set_behaviour": EditKind("B", ("vehicles", "preset", "params")),
    "add_vehicle": EditKind(
        "P",
        (
            *("vehicle_class", "count", "spacing_m", "at", "lane", "offset_m", "position", "speed", "time_s", "to"),
            *("preset", "params"),
        ),
    ),
    "remove_vehicle": EditKind("P", ("vehicles",)),
    "set_goal": EditKind("G", ("to", "position", "rectangle_m", "goal_time", "goal_speed")),
    "set_ego": EditKind("G", ("vehicles", "at", "lane", "offset_m", "position", "speed", "former_ego")),
}
"""All operations; any argument of another one is refused. The engine's function of an edit has the operation's name."""


class Edit(Arguments):
    """One change of the traffic or of the ego's goal."""

    op: EditOperation
    vehicles: list[str] = Field(
        default=[],
        description="ids, all (never the ego), one:truck ('the truck'), class:truck (all of them), nearest:3, "
        "farthest, lead, follow, fastest, slowest, standing, leftmost, rightmost, new:0 (added by edit 0); "
        "'!id' excludes",
    )
    to: list[str] = Field(
        default=[], description="lanelet or edge: goal, any end of a reroute, destination when adding; lanelet_of:lead"
    )
    via: list[str] = Field([], description="reroute through these in order")
    turn: Literal["left", "right", "straight"] | None = Field(None, description="at the next fork")
    preset: str | None = Field(None, description="aggressive, cautious, emergency (urgent), eco, balanced, speeder")
    params: list[str] = Field([], description="SUMO names: 'tau=0.7', 'minGap=1'")
    vehicle_class: str | None = None
    count: int | None = Field(None, ge=1, le=20)
    spacing_m: float | None = Field(None, gt=0)
    at: str | None = Field(None, description="where to put: lanelet, edge, ego, vehicle:ID")
    lane: Literal["same", "left", "right", "oncoming"] | None = None
    offset_m: float | None = Field(None, description="from at, between centres along the lane; - behind")
    position: str | None = Field(
        None,
        description="on the lanelet: beginning, quarter, middle, three_quarter, final (a goal's default), 0.66, '35m'",
    )
    speed: str | None = Field(None, description="'30km/h', '8m/s'")
    time_s: float | None = Field(None, description="from when on; shift_time: later by, - earlier")
    former_ego: Literal["vanish", "traffic"] | None = None
    rectangle_m: list[float] | None = Field(None, description="goal [length, width]")
    goal_time: str | None = Field(None, description="'8..12s', '<=90steps'")
    goal_speed: str | None = None

    @property
    def given(self) -> tuple[str, ...]:
        """Names of the arguments that were given beside ``op``."""
        return tuple(name for name in type(self).model_fields if name != "op" and getattr(self, name) not in (None, []))

    def numbered_after(self, earlier: int) -> "Edit":
        """The edit with every ``new:K`` counted from the first of ``earlier`` edits that it is appended to."""

        def counted(text: str) -> str:
            return re.sub(r"\bnew:(\d+)", lambda number: f"new:{int(number[1]) + earlier}", text)

        lists = {name: [counted(text) for text in getattr(self, name)] for name in ("vehicles", "to", "via")}
        return self.model_copy(update={**lists, "at": None if self.at is None else counted(self.at)})


class ModifyScenarioArguments(Arguments):
    """Change the traffic or the ego's goal: edits in the given order, all or none, one new scenario.

    Untouched vehicles stay exactly as recorded. The ego's own driving is configure_planner's.
    """

    scenario_id: str = "latest"
    edits: list[Edit] = Field(min_length=1, max_length=50)
    on_conflict: Literal["report", "refuse"] = "report"
    traffic: TrafficAfterEdits = Field("recorded", description="reactive: all vehicles driven anew")
    detail: EditDetail = "brief"
    dry_run: bool = False
    seed: int = 0


class VehicleRoute(Model):
    """Where a touched vehicle drives: lanelets in order, and whether it gets where the edit sends it.

    ``arrives`` is None where no target was named; ``reason`` says why it does not arrive.
    """

    vehicle_id: int
    lanelets: tuple[int, ...]
    arrives: bool | None = None
    reason: str = ""


class EditReport(Model):
    """What became of one edit."""

    index: int
    op: EditOperation
    letter: Letter
    done: bool
    what: str = Field(description="what was done, in one sentence with figures")
    vehicles: tuple[int, ...] = ()
    routes: tuple[VehicleRoute, ...] = ()


class EditCollision(Model):
    """Two road users overlap for the first time, which they did not do in the recording."""

    vehicles: tuple[int, int]
    time_s: float


class EgoDanger(Model):
    """The most critical figures of an ego that drives ordinarily; None where no road user is near, or met in 60 s.

    ``risk_score``: 0 collision, 1 extreme, 2 high, 3 medium, 4 low, 5 negligible (From Words to Collisions).
    ``most_critical_*``: the road user that it met when the score was lowest (the first collision, else the shortest
    time to one).
    """

    minimum_distance_m: float | None
    minimum_time_to_collision_s: float | None
    risk_score: int | None
    most_critical_id: int | None = None
    most_critical_time_s: float | None = None


class TouchedVehicle(Model):
    """A vehicle whose motion was computed anew, and whether a car can drive it (judged as ``checked_by`` says).

    ``handover_*``: differences between the recorded state at the hand-over and the first new step, beyond what the
    speed explains; None for vehicles that were not recorded.
    """

    vehicle_id: int
    cause: Literal["edited", "added", "shifted", "handed_over"]
    from_time_s: float
    until_time_s: float
    leaves_network: bool
    feasible: bool
    feasible_share: float
    handover_jump_m: float | None = None
    handover_speed_step_mps: float | None = None


class ModificationRequest(Model):
    """What the worker needs: the base file, the planning problem (None: the first), all edits, and where to write.

    ``earlier``: how many of the edits come from the scenario that is edited further; they are applied, not reported.
    """

    xml: Path
    edits: tuple[Edit, ...]
    benchmark_id: str
    output: Path
    problem_id: int | None = None
    earlier: int = 0
    on_conflict: Literal["report", "refuse"] = "report"
    traffic: TrafficAfterEdits = "recorded"
    detail: EditDetail = "brief"
    dry_run: bool = False
    keep_simulation: bool = Field(False, description="leave SUMO's vehicle types and driven routes in output too")
    seed: int = 0


class ModificationOutcome(Model):
    """Files (None for a dry run) and everything that the edits did."""

    xml: Path | None
    net: Path | None
    edits: tuple[EditReport, ...]
    touched: tuple[TouchedVehicle, ...] = ()
    removed: tuple[int, ...] = ()
    collisions: tuple[EditCollision, ...] = ()
    ego_before: EgoDanger | None = None
    ego_after: EgoDanger | None = None
    checked_by: CheckedBy = "closed_form"
    checkers_agree: int | None = Field(None, description="touched motions that both checks judge alike")
    untouched: int = Field(0, description="vehicles that stay exactly as recorded")
    warnings: tuple[str, ...] = ()

    @property
    def handed_over(self) -> tuple[int, ...]:
        """Vehicles that no edit names: they would have hit one that an edit moved, or all traffic reacts."""
        return tuple(vehicle.vehicle_id for vehicle in self.touched if vehicle.cause == "handed_over")


class ModifyScenarioResult(Result):
    """The new scenario and what the edits did; no id where nothing was stored."""

    scenario_id: str | None
    base_id: str
    reused: bool = False
    edits: tuple[EditReport, ...]
    touched: tuple[TouchedVehicle, ...]
    removed: tuple[int, ...]
    handed_over: tuple[int, ...]
    collisions: tuple[EditCollision, ...]
    ego_before: EgoDanger | None
    ego_after: EgoDanger | None
    checked_by: CheckedBy
    checkers_agree: int | None
    untouched: int
    warnings: tuple[str, ...]

    def answer(self) -> Answer:
        """All of it in a few lines; of long lists the first items, and how many more there are."""
        head = f"{self.scenario_id} (from {self.base_id})" if self.scenario_id else f"dry run on {self.base_id}"
        lines = [head + (", reused" if self.reused else ""), *_edits_text(self.edits)]
        lines += [_touched_text(vehicle) for vehicle in self.touched[:_MOST_TOUCHED]]
        if len(self.touched) > _MOST_TOUCHED:
            infeasible = [vehicle.vehicle_id for vehicle in self.touched if not vehicle.feasible]
            lines.append(f"{len(self.touched)} touched in all; infeasible steps in: {_ids(infeasible)}")
        lines.append(f"removed: {_ids(self.removed)}; handed over besides: {_ids(self.handed_over)}")
        lines.append(f"collisions caused: {_collisions_text(self.collisions)}")
        lines.append(f"{self.untouched} vehicles exactly as recorded")
        lines += _danger_text(self.ego_before, self.ego_after)
        if self.checkers_agree is not None:
            alike = f"{self.checkers_agree} of {len(self.touched)}"
            lines.append(f"judged by the drivability checker; the closed form agrees on {alike}")
        lines += [f"note: {note}" for note in _within(self.warnings[:_MOST_NOTES], _NOTES_CHARACTERS)]
        if len(self.warnings) > _MOST_NOTES:
            lines.append(f"… and {len(self.warnings) - _MOST_NOTES} more notes")
        return Answer(lines[0], lines[1:])


_MOST_EDITS, _MOST_TOUCHED, _MOST_COLLISIONS, _MOST_NOTES, _MOST_IDS = 10, 6, 6, 6, 12
_MOST_ROUTES, _MOST_LANELETS = 8, 8
_EDITS_CHARACTERS, _NOTES_CHARACTERS = 1200, 800
"""What the text shows of long lists, and characters of all its sentences together, beyond which each is cut to an even
share; chosen so that an answer stays below 1,500 tokens."""


def _edits_text(edits: Sequence[EditReport]) -> Iterator[str]:
    """Edits and routes; lanelets that were listed are not listed again, nor are their routes without a target."""
    shown: dict[int, tuple[int, ...]] = {}
    left = _MOST_ROUTES
    sentences = _within([edit.what for edit in edits[:_MOST_EDITS]], _EDITS_CHARACTERS)
    for edit, what in zip(edits, sentences, strict=False):
        yield f"edit {edit.index} {edit.op} ({edit.letter}): {'done' if edit.done else 'not done'}: {what}"
        routes = [
            route for route in edit.routes if route.arrives is not None or shown.get(route.vehicle_id) != route.lanelets
        ]
        routes.sort(key=lambda route: route.arrives is not False)
        first = routes[:left]
        yield from (f"  {_route_text(route, shown.get(route.vehicle_id))}" for route in first)
        if len(routes) > len(first):
            yield f"  … and {len(routes) - len(first)} more routes"
        shown.update((route.vehicle_id, route.lanelets) for route in routes)
        left -= len(first)
    more = edits[_MOST_EDITS:]
    if more:
        undone = [edit.index for edit in more if not edit.done]
        yield f"… and {len(more)} more edits, {len(more) - len(undone)} of them done; not done: {_ids(undone)}"


def _route_text(route: VehicleRoute, before: tuple[int, ...] | None) -> str:
    lanelets: list[object] = [*route.lanelets]
    if len(lanelets) > _MOST_LANELETS:
        lanelets[_MOST_LANELETS - 1 : -1] = "…"
    driven = "as above" if route.lanelets == before else f"lanelets {' → '.join(map(str, lanelets))}"
    arrives = {None: "", True: ", arrives", False: f", does not arrive: {route.reason}"}[route.arrives]
    return f"{route.vehicle_id}: {driven}{arrives}"


def _collisions_text(collisions: Sequence[EditCollision]) -> str:
    hits = [f"{hit.vehicles[0]} with {hit.vehicles[1]} at {hit.time_s:.1f} s" for hit in collisions[:_MOST_COLLISIONS]]
    more = f" and {len(collisions) - _MOST_COLLISIONS} more" if len(collisions) > _MOST_COLLISIONS else ""
    return "; ".join(hits) + more if hits else "none"


def _within(sentences: Sequence[str], characters: int) -> list[str]:
    """The sentences, together no longer than ``characters``: of long ones the beginning, and the end, which says why an
    edit is not done.
    """
    share = characters // max(len(sentences), 1)
    if sum(map(len, sentences)) <= characters:
        return list(sentences)
    return [text if len(text) <= share else f"{text[: share * 2 // 3]} … {text[-share // 3 :]}" for text in sentences]


def _danger_text(before: EgoDanger | None, after: EgoDanger | None) -> list[str]:
    if before is None or after is None:
        return []
    figures = [
        f"{name} {_figure(getattr(before, field), unit)} → {_figure(getattr(after, field), unit)}"
        for name, field, unit in (
            ("minimum distance", "minimum_distance_m", " m"),
            ("time to collision", "minimum_time_to_collision_s", " s"),
            ("risk score", "risk_score", ""),
        )
    ]
    ego = "to an ego that drives ordinarily, blind to edited traffic"
    return [f"{ego}: {', '.join(figures)} (0 collision … 5 negligible){_most_critical(after)}"]


def _most_critical(danger: EgoDanger) -> str:
    if danger.most_critical_id is None:
        return ""
    what = "collision with" if danger.risk_score == 0 else "most critical:"
    return f"; {what} {danger.most_critical_id} at {danger.most_critical_time_s:.1f} s"


def _figure(value: float | None, unit: str) -> str:
    return "none" if value is None else f"{value:.3g}{unit}"


def _touched_text(vehicle: TouchedVehicle) -> str:
    is_shifted = vehicle.cause == "shifted"
    is_driven = is_shifted and vehicle.handover_jump_m is not None
    verdict = "feasible" if vehicle.feasible else f"{vehicle.feasible_share:.1%} of the steps feasible"
    verdict += ", as in its recording" if is_shifted and not is_driven else ""
    cause = f"{vehicle.cause.replace('_', ' ')}{' and driven' if is_driven else ''}"
    end = "leaves the network" if vehicle.leaves_network else "there"
    return (
        f"{vehicle.vehicle_id} {cause} from {vehicle.from_time_s:.1f} s, "
        f"{end} at {vehicle.until_time_s:.1f} s, {verdict}"
    )


def _ids(keys: tuple[int, ...] | list[int]) -> str:
    more = f" and {len(keys) - _MOST_IDS} more" if len(keys) > _MOST_IDS else ""
    return ", ".join(map(str, keys[:_MOST_IDS])) + more or "none"
