"""Typed edits of a scenario: the arguments of ``modify_scenario``, the worker's request, and the result."""

import re
from collections import Counter
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Final, Literal, NamedTuple, TypeVar

from pydantic import Field

from .base import DRIVEN_OTHERWISE, Answer, Arguments, Model, Result, first_of
from .text import RISK_SCALE, counted

EditOperation = Literal[
    "reroute",
    "change_lane",
    "set_speed",
    "stop_at",
    "shift_time",
    "set_behaviour",
    "add_vehicle",
    "remove_vehicle",
    "set_goal",
    "set_ego",
    "cut_in",
    "swerve",
    "wrong_way",
    "run_red_light",
    "move",
    "replace",
    "close_lane",
    "set_light",
    "set_weather",
    "crop",
    "mirror",
]
Letter = Literal["T", "B", "P", "G", "S"]
"""The paper's kinds of edits (trajectory, behaviour, population, goal), and S for the scene itself."""
TrafficAfterEdits = Literal["recorded", "reactive"]
"""Whether vehicles that no edit names keep their recording or are simulated from their first state."""
CheckedBy = Literal["closed_form", "drivability_checker"]
EditDetail = Literal["brief", "checks"]
"""``checks`` also runs the drivability checker on touched motions, which takes up to a second each."""


AMBIGUOUS_VEHICLE: Final = "which_vehicle"
"""The first word of the reason if a selector matches several vehicles and is refused; the selector follows it."""


class EditKind(NamedTuple):
    """The definition of an operation: the paper's letter for it, and its arguments."""

    letter: Letter
    arguments: tuple[str, ...]


EDITS: Final[dict[EditOperation, EditKind]] = {
    "reroute": EditKind("T", ("vehicles", "to", "via", "turn")),
    "change_lane": EditKind("T", ("vehicles", "lane", "time_s", "lateral_s", "when", "dodge")),
    "set_speed": EditKind("T", ("vehicles", "speed", "time_s", "rate_mps2", "when", "dodge")),
    "stop_at": EditKind("T", ("vehicles", "at", "lane", "offset_m", "position", "duration_s", "time_s")),
    "shift_time": EditKind("T", ("vehicles", "time_s")),
    "set_behaviour": EditKind("B", ("vehicles", "preset", "params")),
    "add_vehicle": EditKind(
        "P",
        (
            *("vehicle_class", "count", "spacing_m", "at", "lane", "offset_m", "position", "speed", "time_s", "to"),
            *("preset", "params", "gap_s", "side", "when", "dodge", "duration_s"),
        ),
    ),
    "remove_vehicle": EditKind("P", ("vehicles",)),
    "set_goal": EditKind("G", ("to", "turn", "position", "rectangle_m", "goal_time", "goal_speed")),
    "set_ego": EditKind(
        "G", ("vehicles", "vehicle_class", "at", "lane", "offset_m", "position", "speed", "former_ego")
    ),
    "cut_in": EditKind("T", ("vehicles", "at", "gap_s", "lateral_s", "time_s", "speed", "dodge")),
    "swerve": EditKind("T", ("vehicles", "side", "offset_m", "lateral_s", "duration_s", "time_s", "when", "dodge")),
    "wrong_way": EditKind(
        "T",
        (
            *("vehicles", "time_s", "when", "lateral_s", "vehicle_class", "at", "lane", "offset_m", "position"),
            *("speed", "dodge"),
        ),
    ),
    "run_red_light": EditKind("T", ("vehicles", "speed")),
    "move": EditKind("P", ("vehicles", "at", "lane", "offset_m", "position", "gap_s")),
    "replace": EditKind("P", ("vehicles", "vehicle_class")),
    "close_lane": EditKind("S", ("to", "position", "time_s", "duration_s")),
    "set_light": EditKind("S", ("to", "params")),
    "set_weather": EditKind("S", ("params",)),
    "crop": EditKind("S", ("time_s", "duration_s", "at", "rectangle_m")),
    "mirror": EditKind("S", ()),
}
"""All operations. Arguments that belong to another operation are refused. The engine's function for an edit has the
same name."""


class Edit(Arguments):
    """One change of the traffic or of the ego's goal."""

    op: EditOperation
    """The operation. Each takes only its own arguments."""
    vehicles: list[str] = Field(
        default=[],
        description="ids, all (never the ego), one:truck ('the truck'), class:truck, nearest:3, "
        "farthest, lead, follow, fastest, slowest, standing, leftmost, rightmost, new:0 (added by edit 0); "
        "'!id' excludes",
    )
    to: list[str] = Field(
        default=[], description="lanelet or edge: goal, any end of a reroute, destination when adding; lanelet_of:lead"
    )
    via: list[str] = Field([], description="reroute through")
    turn: Literal["left", "right", "straight"] | None = Field(None, description="at the next fork")
    preset: str | None = Field(None, description="aggressive, cautious, emergency (urgent), eco, balanced, speeder")
    params: list[str] = Field(
        [], description="SUMO's 'tau=0.7'; set_light: 'red=10s'; set_weather: 'rain', 'friction=0.3'"
    )
    vehicle_class: str | None = Field(None, description="added, or the ego's")
    """The class of the added vehicle, or `pedestrian`; with `set_ego`, the ego's class: `truck`, `bus`, `motorcycle` …
    """
    count: int | None = Field(None, ge=1, le=20)
    """How many to add, one behind the other."""
    spacing_m: float | None = Field(None, ge=0)
    """The distance between several added vehicles, in m."""
    at: str | None = Field(None, description="lanelet, edge, ego, vehicle:ID")
    lane: Literal["same", "left", "right", "oncoming"] | None = None
    """The side of `at`, if that is the ego or a vehicle."""
    offset_m: float | None = Field(None, description="from at, between centres along the lane; - behind")
    position: str | None = Field(
        None, description="on the lanelet: beginning, quarter, middle, three_quarter, final, 0.66, '35m'"
    )
    speed: str | None = Field(None, description="'30km/h', '8m/s', '+10%'")
    time_s: float | None = Field(None, description="start; shift_time: later by, - earlier")
    gap_s: float | None = Field(None, description="time gap bumper to bumper: cut_in; in place of offset_m")
    lateral_s: float | None = Field(None, ge=0.5, description="lateral duration; prescribed")
    rate_mps2: float | None = Field(None, ge=0.1, description="prescribed acceleration or braking")
    when: str | None = Field(None, description="trigger: 'ego@LANELET:35m', 'gap<=2s'; prescribed")
    dodge: bool | None = Field(None, description="brakes for the ego")
    duration_s: float | None = Field(None, ge=0.1)
    """The duration of a stop, swerve, lane closure or cut-out scenario; how long an added pedestrian stands first."""
    side: Literal["left", "right"] | None = Field(None, description="swerve to, pedestrian from, parked at this kerb")
    former_ego: Literal["vanish", "traffic"] | None = None
    """What happens to the old ego if a recorded car takes its place."""
    rectangle_m: list[float] | None = Field(None, description="goal or crop [length, width]")
    goal_time: str | None = Field(None, description="'8..12s', '<=90steps'")
    goal_speed: str | None = None
    """The speed at the goal, such as `'5..10m/s'`."""

    @property
    def given(self) -> tuple[str, ...]:
        """The names of the given arguments, without ``op``."""
        return tuple(name for name in type(self).model_fields if name != "op" and getattr(self, name) not in (None, []))

    def in_words(self) -> str:
        """Return the edit in one line: the operation, its vehicles, and its other arguments."""
        vehicles = f" {' '.join(self.vehicles)}" if self.vehicles else ""
        rest = ", ".join(f"{name} {_as_written(getattr(self, name))}" for name in self.given if name != "vehicles")
        return f"{self.op}{vehicles} ({rest})" if rest else f"{self.op}{vehicles}"

    @property
    def names_added(self) -> bool:
        """Whether the edit refers to a vehicle that another edit adds (``new:K``)."""
        words = [*self.vehicles, *self.to, *self.via, *([] if self.at is None else [self.at])]
        return any(re.search(r"\bnew:\d", word) for word in words)

    def numbered_after(self, earlier: int) -> "Edit":
        """Return the edit with each ``new:K`` renumbered for a position after ``earlier`` edits."""

        def counted(text: str) -> str:
            return re.sub(r"\bnew:(\d+)", lambda number: f"new:{int(number[1]) + earlier}", text)

        lists = {name: [counted(text) for text in getattr(self, name)] for name in ("vehicles", "to", "via")}
        return self.model_copy(update={**lists, "at": None if self.at is None else counted(self.at)})


def _as_written(value: object) -> str:
    if isinstance(value, list):
        return " ".join(map(_as_written, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


class ModifyScenarioArguments(Arguments):
    """Change the traffic or the ego's goal: edits in the given order, all or none, one new scenario.

    Untouched vehicles stay as recorded. The ego's own driving is configure_planner's.
    """

    examples: ClassVar[Mapping[str, Any]] = {"edits": [{"op": "set_speed", "vehicles": ["lead"], "speed": "30km/h"}]}

    scenario_id: str = "latest"
    """The scenario to edit. It stays unchanged."""
    edits: list[Edit] = Field(min_length=1, max_length=50)
    """The edits, in the order in which they are applied."""
    on_conflict: Literal["report", "refuse"] = "report"
    """What to do if edits end in a collision between others: report it, or refuse all edits."""
    traffic: TrafficAfterEdits = Field("recorded", description="reactive: all vehicles simulated")
    detail: EditDetail = "brief"
    """Whether the text of the answer includes the checks."""
    dry_run: bool = False
    """Report what the edits would do, and store nothing."""
    seed: int = 0
    """The seed of the simulation that drives the touched vehicles."""


class VehicleRoute(Model):
    """The route of a touched vehicle, and whether it arrives where the edit sends it.

    ``arrives`` is None if there is no target. ``reason`` says why it does not arrive, and ``advice`` how it could.
    """

    vehicle_id: int
    lanelets: tuple[int, ...] = Field(description="ids of the lanelets in their order")
    arrives: bool | None = Field(None, description="whether it reaches its target; null without one")
    reason: str = Field("", description="why it does not arrive")
    advice: str = Field("", description="advice on how it could arrive")


class Achieved(Model):
    """The result for one quantity that an edit requests, measured on the written motion."""

    vehicle_id: int
    quantity: str = Field(description="the quantity requested: speed, gap, lateral_duration …")
    asked: float | None = Field(None, description="the value requested; null if the edit leaves it open")
    value: float = Field(description="the value achieved")
    unit: str
    reached: bool = Field(True, description="whether the value is the one requested")
    reason: str = Field("", description="why the requested motion did not happen")

    @property
    def failed(self) -> bool:
        """Whether the requested motion did not happen at all, so there is no value to compare."""
        return self.asked is None and not self.reached


class EditReport(Model):
    """The result of one edit; ``meant`` lists the vehicles that its selectors chose."""

    index: int = Field(description="number of the edit in the call, from 0")
    op: EditOperation = Field(description="the operation")
    letter: Letter = Field(description="kind of edit: T trajectory, B behaviour, P population, G goal")
    done: bool = Field(description="whether it was done")
    what: str = Field(description="one sentence on what was done, with figures")
    vehicles: tuple[int, ...] = Field((), description="ids of the vehicles that it edited or added")
    routes: tuple[VehicleRoute, ...] = Field((), description="their new routes")
    achieved: tuple[Achieved, ...] = Field((), description="the values achieved")
    meant: str = ""

    @property
    def verdict(self) -> str:
        """The verdict: ``done``, ``without effect``, or how many vehicles reach what the edit requests."""
        if not self.done:
            return "off target" if any(one.failed for one in self.achieved) else "without effect"
        missing = {route.vehicle_id for route in self.routes if route.arrives is False}
        missing |= {one.vehicle_id for one in self.achieved if not one.reached}
        targeted = {route.vehicle_id for route in self.routes if route.arrives is not None}
        targeted |= {one.vehicle_id for one in self.achieved}
        missed, sent = len(missing), len(targeted)
        return "done" if not missed else "off target" if missed == sent else f"on target for {sent - missed} of {sent}"


class EditCollision(Model):
    """The first overlap of two road users that did not overlap in the recording."""

    vehicles: tuple[int, int] = Field(description="ids of the two")
    time_s: float = Field(description="time of the first overlap")


class EgoDanger(Model):
    """The most critical figures of an ego with an ordinary driver; None if no road user is near or would be met within
    60 s.

    ``risk_score`` ranges from 0 (collision) through 1 (extreme), 2 (high), 3 (medium) and 4 (low) to 5 (negligible)
    (From Words to Collisions). ``most_critical_*`` describe the road user at the lowest score: the first collision,
    otherwise the shortest time to collision. ``left_out`` lists those that are not counted because they hit the ego
    from behind while following their recording.
    """

    minimum_distance_m: float | None = Field(description="smallest distance to another road user")
    minimum_time_to_collision_s: float | None = Field(description="smallest time to collision")
    risk_score: int | None
    most_critical_id: int | None = Field(None, description="id of the most critical road user")
    most_critical_time_s: float | None = Field(None, description="time of that")
    left_out: tuple[int, ...] = ()


class TouchedVehicle(Model):
    """A vehicle with a newly computed motion, and whether a car can drive it (judged by ``checked_by``).

    ``reason`` states which vehicle it would have hit, and when, if no edit selects it. ``handover_*`` are the jumps
    between the recorded state at the hand-over and the first new step, beyond those explained by speed. ``moved_m`` is
    the largest distance from its recorded position at the same time. The jumps and ``moved_m`` are None for vehicles
    without a recording.
    """

    vehicle_id: int
    cause: Literal["edited", "added", "shifted", "handed_over"] = Field(description="why its motion changed")
    from_time_s: float = Field(description="start of its new motion")
    until_time_s: float = Field(description="end of its new motion")
    leaves_network: bool = Field(description="whether it leaves the network before the end")
    feasible: bool = Field(description="whether a vehicle of its class can drive it")
    feasible_share: float = Field(description="share of its steps that are drivable, from 0 to 1")
    handover_jump_m: float | None = Field(
        None, description="jump of its position at the hand-over, beyond what its speed explains"
    )
    handover_speed_step_mps: float | None = Field(None, description="jump of its speed at the hand-over")
    moved_m: float | None = None
    stood_until_s: float | None = Field(None, description="until when it stood in the recording, if it moves now")
    reason: str = ""


class ModificationRequest(Model):
    """The worker's request: the base file, the planning problem (None: the first), all edits, and the output path.

    ``earlier`` counts the edits that the scenario already had. They are applied, but not reported: the outcome compares
    with ``given``, the file with these edits (None if there are none).
    """

    xml: Path
    edits: tuple[Edit, ...]
    benchmark_id: str
    output: Path
    problem_id: int | None = None
    earlier: int = 0
    given: Path | None = None
    on_conflict: Literal["report", "refuse"] = "report"
    traffic: TrafficAfterEdits = "recorded"
    detail: EditDetail = "brief"
    dry_run: bool = False
    keep_simulation: bool = Field(False, description="also write SUMO's vehicle types and driven routes to output")
    seed: int = 0


class ModificationOutcome(Model):
    """The files (None for a dry run) and all effects of the edits."""

    xml: Path | None
    net: Path | None
    edits: tuple[EditReport, ...]
    touched: tuple[TouchedVehicle, ...] = ()
    removed: tuple[int, ...] = ()
    collisions: tuple[EditCollision, ...] = ()
    ego_before: EgoDanger | None = None
    ego_after: EgoDanger | None = None
    checked_by: CheckedBy = "closed_form"
    checkers_agree: int | None = Field(None, description="touched motions on which both checks agree")
    untouched: int = Field(0, description="vehicles that the edits leave unchanged")
    weather: str = Field("", description="bad weather that the edits wrote to the file; empty if they did not")
    planners_refuse: str = ""
    warnings: tuple[str, ...] = ()

    @property
    def handed_over(self) -> tuple[int, ...]:
        """The vehicles that no edit names, but that would have hit an edited vehicle or react with all traffic."""
        return tuple(vehicle.vehicle_id for vehicle in self.touched if vehicle.cause == "handed_over")


class ModifyScenarioResult(Result):
    """The new scenario and the effects of the edits; without an id if nothing was stored.

    ``traffic`` states whether all others react or keep their recording. ``detail`` sets the length of the text.
    """

    scenario_id: str | None = Field(description="id of the new scenario; null if nothing was stored")
    base_id: str = Field(description="id of the scenario that was edited")
    root_id: str = Field(
        "",
        exclude_if=lambda root: not root,
        description="id of the scenario that all edits start from, if that is another one",
    )
    earlier: int = Field(0, exclude_if=lambda count: count == 0, description="edits that this scenario already had")
    reused: bool = Field(False, description="whether the same edits had created it already")
    traffic: TrafficAfterEdits = "recorded"
    detail: EditDetail = "brief"
    edits: tuple[EditReport, ...] = Field(description="the result of each edit")
    touched: tuple[TouchedVehicle, ...] = Field(description="vehicles with a newly computed motion")
    removed: tuple[int, ...] = Field(description="ids of removed vehicles")
    handed_over: tuple[int, ...] = Field(
        description="ids of vehicles that no edit names, simulated so that they do not collide"
    )
    collisions: tuple[EditCollision, ...] = Field(description="overlaps of road users that are new")
    ego_before: EgoDanger | None = Field(
        description="criticality before, for an ego that SUMO drives; null without a planning problem"
    )
    ego_after: EgoDanger | None = Field(description="criticality now")
    checked_by: CheckedBy = Field(description="which check judged drivability")
    checkers_agree: int | None = Field(
        description="motions on which closed form and drivability checker agree; null if only one was used"
    )
    untouched: int = Field(description="vehicles that the edits leave unchanged")
    planners_refuse: str = Field("", description="why the built-in planners refuse this ego; empty if they drive it")
    warnings: tuple[str, ...] = Field(description="warnings, one sentence each")

    def answer(self) -> Answer:
        """Return what was done and reached, which vehicles react, and what changes for the ego."""
        root = f", an edit of {self.root_id}" if self.root_id not in ("", self.base_id) else ""
        before = f"{root} with {counted(self.earlier, 'earlier edit')}" if self.earlier else ""
        stored = f"{self.scenario_id} (from {self.base_id}{before}{', already stored' if self.reused else ''})"
        head = stored if self.scenario_id else f"Dry run on {self.base_id}, nothing stored"
        hits = [f"{hit.vehicles[0]} hits {hit.vehicles[1]} at {hit.time_s:.1f} s" for hit in self.collisions]
        shown = "; ".join(first_of(hits, *self._most(_MOST_COLLISIONS)))
        collisions = [f"new collision of road users: {shown}"] if hits else []
        infeasible = [
            f"{1 - share:.1%} of the motion of vehicle{'s' * (len(keys) > 1)} {_ids(keys)} is infeasible"
            f"{', as in the recording' * is_recorded}"
            for (share, is_recorded), keys in _grouped(
                (vehicle.vehicle_id, (vehicle.feasible_share, _is_recording(vehicle)))
                for vehicle in self.touched
                if not vehicle.feasible
            )
        ]
        warnings = [*collisions, *infeasible[:_MOST_INFEASIBLE], *self._shortened(self.warnings, _NOTES_CHARACTERS)]
        refusal = [self.planners_refuse] if self.planners_refuse else []
        warnings = [*refusal, *warnings]
        ready = DRIVEN_OTHERWISE if refusal else "run_planner"
        following = ready if self.scenario_id else "repeat without dry_run"
        advice = next((route.advice for edit in self.edits for route in edit.routes if route.advice), following)
        return Answer(
            headline=f"{head}: {_verdicts(self.edits)}.",
            decided=[*self._edit_lines(), *self._others()],
            figures=[*_danger_text(self.ego_before, self.ego_after, blind=bool(self.touched)), *self._judged()],
            warnings=first_of(warnings, *self._most(_MOST_NOTES)),
            next_step=advice,
        )

    def _most(self, brief: int) -> tuple[int, str]:
        """Return how many items of a list to show, and the call that shows the remaining items."""
        if self.detail == "brief":
            return brief, "modify_scenario with detail=checks"
        return _MOST_IN_DETAIL, "the structured answer has all"

    def _shortened(self, sentences: Sequence[str], characters: int) -> list[str]:
        return _within(sentences, characters * (3 if self.detail == "checks" else 1))

    def _edit_lines(self) -> Iterator[str]:
        """Yield one line per edit with its verdict, and the routes of all vehicles or only of those that it sends
        somewhere.
        """
        most, rest = self._most(_MOST_EDITS)
        sentences = self._shortened([edit.what for edit in self.edits[:most]], _EDITS_CHARACTERS)
        for edit, what in zip(self.edits, sentences, strict=False):
            number = f"{edit.index} " if len(self.edits) > 1 else ""
            # What was not done, or not by all, must not read as if it had happened.
            verdict = f", {edit.verdict}; requested" if edit.verdict != "done" else ""
            selected = f" ({edit.meant})" if edit.meant else ""
            yield f"{number}{edit.op}{verdict}: {what}{selected}"
            routes = [route for route in edit.routes if route.arrives is not None or self.detail == "checks"]
            grouped = _grouped((route.vehicle_id, _route_text(route)) for route in routes)
            lines = [f"  {_ids(keys)}: {text}" for text, keys in grouped]
            shown, others = self._most(_MOST_ROUTES)
            yield from first_of(lines, max(shown // len(self.edits), _MOST_ROUTES), others)
        undone = [edit.index for edit in self.edits[most:] if edit.verdict != "done"]
        if self.edits[most:]:
            yield f"… {len(self.edits) - most} more edits (not done or off target: {_ids(undone)}): {rest}"

    def _others(self) -> list[str]:
        """Return lines on which other vehicles react, with the reason, and on how many keep their recording."""
        reacting = [vehicle for vehicle in self.touched if vehicle.cause == "handed_over"]
        lines = []
        if self.traffic == "reactive":
            others = f", {counted(len(reacting), 'unedited vehicle')} too" if reacting else ""
            lines.append(f"All {'drivable ' if self.untouched else ''}traffic reacts{others}.")
        elif reacting:
            labels = [f"{vehicle.vehicle_id}{f' ({vehicle.reason})' * bool(vehicle.reason)}" for vehicle in reacting]
            most, _ = self._most(_MOST_TOUCHED)
            more = f" and {len(labels) - most} more" if len(labels) > most else ""
            lines.append(f"Simulated instead of recorded, to avoid collisions: {', '.join(labels[:most])}{more}.")
        lines += [*self._moved(), *self._previously_standing()]
        if self.detail == "checks":
            lines += first_of([_touched_text(vehicle) for vehicle in self.touched], *self._most(0))
        kept = counted(self.untouched, "vehicle") if self.untouched else "No vehicle"
        is_mirrored = sum(edit.op == "mirror" for edit in self.edits) % 2 == 1
        how = f"as {'before' if self.earlier else 'recorded'}"
        unchanged = f"{how}, but mirrored" if is_mirrored else f"exactly {how}"
        return [*lines, f"{kept} {'stays' if self.untouched < 2 else 'stay'} {unchanged}."]

    def _moved(self) -> list[str]:
        """Return the largest displacements of the edited vehicles, largest first."""
        moved = sorted(
            (one for one in self.touched if one.cause == "edited" and (one.moved_m or 0.0) >= _SEEN_MOVED_M),
            key=lambda vehicle: (-(vehicle.moved_m or 0.0), vehicle.vehicle_id),
        )
        most, _ = self._most(_MOST_TOUCHED)
        distances = ", ".join(f"{vehicle.vehicle_id} ({vehicle.moved_m:.3g} m)" for vehicle in moved[:most])
        least = f"; {len(moved) - most} others deviate less" if len(moved) > most else ""
        many = "s" * (len(moved) > 1)
        return [f"Largest deviation{many} from the recording: vehicle{many} {distances}{least}."] if moved else []

    def _previously_standing(self) -> list[str]:
        """Return a sentence on the vehicles that stood in the recording, perhaps at a light missing from the file, but
        now move.
        """
        stood = [(one.vehicle_id, one.stood_until_s) for one in self.touched if one.stood_until_s is not None]
        most, _ = self._most(_MOST_TOUCHED)
        vehicles = "; ".join(f"until {until_s:.1f} s: {_ids(keys)}" for until_s, keys in _grouped(stood[:most]))
        more = f"; {len(stood) - most} more" if len(stood) > most else ""
        return [f"Now driving, though stationary in the recording {vehicles}{more}."] if stood else []

    def _judged(self) -> list[str]:
        if self.checkers_agree is None or not self.touched:
            return []
        alike = f"{self.checkers_agree} of {len(self.touched)}"
        return [f"The drivability checker judged the motions; the closed-form check agrees on {alike}."]


_MOST_EDITS, _MOST_TOUCHED, _MOST_COLLISIONS, _MOST_NOTES, _MOST_IDS, _MOST_INFEASIBLE = 6, 4, 3, 3, 8, 2
_MOST_ROUTES, _MOST_LANELETS, _MOST_IN_DETAIL = 3, 8, 20
_EDITS_CHARACTERS, _NOTES_CHARACTERS = 900, 450
"""How much of long lists the text shows, and the characters of all its sentences together. Beyond that, each sentence
is cut to an equal share. Chosen so that a brief answer to an ordinary request stays below 250 tokens."""
Key = TypeVar("Key", bound=Hashable)


def _verdicts(edits: Sequence[EditReport]) -> str:
    """Return how many edits were done, reached, or had no effect."""
    counts = Counter(edit.verdict for edit in edits)
    if len(counts) == 1:
        return f"{counted(len(edits), 'edit')} {edits[0].verdict}"
    return f"{len(edits)} edits: " + ", ".join(f"{count} {verdict}" for verdict, count in counts.items())


def _grouped(items: Iterable[tuple[int, Key]]) -> list[tuple[Key, list[int]]]:
    """Return each shared property once, with the ids of its vehicles."""
    groups: dict[Key, list[int]] = {}
    for key, value in items:
        groups.setdefault(value, []).append(key)
    return list(groups.items())


def _route_text(route: VehicleRoute) -> str:
    lanelets: list[object] = [*route.lanelets]
    if len(lanelets) > _MOST_LANELETS:
        lanelets[_MOST_LANELETS - 1 : -1] = "…"
    driven = f"lanelet{'s' * (len(lanelets) > 1)} {' → '.join(map(str, lanelets))}"
    if route.arrives is False:
        return f"target not reached: {route.reason} ({driven})"
    return f"target reached, {driven}" if route.arrives else driven


def _within(sentences: Sequence[str], characters: int) -> list[str]:
    """Return the sentences, shortened to a total length if necessary; a long sentence loses its middle.

    Its end is kept because it says why an edit was not made.
    """
    share = characters // max(len(sentences), 1)
    if sum(map(len, sentences)) <= characters:
        return list(sentences)
    return [text if len(text) <= share else f"{text[: share * 2 // 3]} … {text[-share // 3 :]}" for text in sentences]


def _danger_text(before: EgoDanger | None, after: EgoDanger | None, *, blind: bool) -> list[str]:
    """Return lines on what changes for an ordinarily driving ego; undefined figures have a reason."""
    if before is None or after is None:
        return ["Ego's risk: unknown, because an ordinary driver cannot be simulated as the ego here."]
    was, now, scale = _danger_figures(before), _danger_figures(after), f" ({RISK_SCALE})"
    new = [
        (f"{word} {was[word]} → {now[word]}" if word in was else f"{_NEW.get(word, word)} {now[word]}")
        + (scale if word == _RISK else "")
        for word in now
        if was.get(word) != now[word]
    ]
    if not new:
        return [f"Unchanged risk for an ordinary driver as the ego: {_RISK} {now[_RISK]}{scale}."]
    driver = "who ignores the edits" if blind else "as the ego"
    return [f"Change for an ordinary driver {driver}: {', '.join(new)}."]


_RISK = "risk score"
_SEEN_MOVED_M = 0.005
"""Smaller displacements are not stated."""
_NEW = {"collision": "new collision"}


def _danger_figures(risk: EgoDanger) -> dict[str, str]:
    """Return the figures as text, by name."""
    figures = {
        "minimum distance": _figure(risk.minimum_distance_m, " m"),
        "shortest time to collision": _figure(risk.minimum_time_to_collision_s, " s"),
        _RISK: _figure(risk.risk_score, ""),
    }
    if risk.most_critical_id is None:
        return figures
    met = f"{risk.most_critical_id} at {risk.most_critical_time_s:.1f} s"
    critical = {"collision": f"with road user {met}"} if risk.risk_score == 0 else {"most critical road user": met}
    return figures | critical


def _figure(value: float | None, unit: str) -> str:
    if value is None:
        return {" s": "none within 60 s", "": "undefined"}.get(unit, "none nearby")
    return f"{value:.3g}{unit}"


def _is_recording(vehicle: TouchedVehicle) -> bool:
    """Return whether the motion is the recorded motion, only shifted in time."""
    return vehicle.cause == "shifted" and vehicle.handover_jump_m is None


_CAUSES: Final = {
    "edited": "edited",
    "added": "added",
    "shifted": "shifted in time",
    "handed_over": "simulated, not edited,",
}


def _touched_text(vehicle: TouchedVehicle) -> str:
    verdict = "feasible" if vehicle.feasible else f"{vehicle.feasible_share:.1%} of the steps feasible"
    verdict += ", as in its recording" if _is_recording(vehicle) else ""
    is_driven = vehicle.cause == "shifted" and not _is_recording(vehicle)
    cause = f"{_CAUSES[vehicle.cause]}{' and driven' if is_driven else ''}"
    times = f"from {vehicle.from_time_s:.1f} to {vehicle.until_time_s:.1f} s"
    end = " when it leaves the map" if vehicle.leaves_network else ""
    return f"{vehicle.vehicle_id} {cause} {times}{end}, {verdict}"


def _ids(keys: Sequence[int]) -> str:
    more = f" and {len(keys) - _MOST_IDS} more" if len(keys) > _MOST_IDS else ""
    return ", ".join(map(str, keys[:_MOST_IDS])) + more or "none"
