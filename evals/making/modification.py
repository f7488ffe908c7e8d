"""Requests that edit scenarios; each feasible request was carried out once when it was made."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ...engine.commonroad import read_scenario
from ...engine.cosimulation import presets
from ...engine.edits import apply_edits
from ...engine.execution import silent
from ...engine.scene import Scene
from ...schemas.errors import PlannerForgeError
from ...schemas.modification import Edit, ModificationRequest
from ..ground_truth.modification import EditRequest, drawn_refusals, drawn_requests, edit_of
from .materials import STYLES, CorpusLine, Draw, KnownScenario, Materials, rounds, styled

LETTERS = ("T", "B", "P", "G", "composite")
_POSITIONS = {
    "beginning": "the beginning",
    "quarter": "a quarter",
    "middle": "the middle",
    "three_quarter": "three quarters",
    "final": "the end",
}
_PER_SCENARIO = 3
"""Refusals drawn per scenario, so that many scenarios have some (chosen)."""
Truth = Mapping[str, Any]


class PossibleEdits:
    """For each scenario, a successful edit of every letter; found on first use."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._found: dict[str, Mapping[str, tuple[Truth, ...]]] = {}
        self._refused: dict[str, list[tuple[str, EditRequest]]] = {}

    def of(self, one: KnownScenario) -> Mapping[str, tuple[Truth, ...]]:
        """Return the typed edits by letter; letters without a possible edit in the scenario are left out."""
        self._look_at(one)
        return self._found[one.name]

    def refusals(self, one: KnownScenario) -> Sequence[tuple[str, EditRequest]]:
        """Return requests that the scenario refuses, each with the reason's code."""
        self._look_at(one)
        return self._refused[one.name]

    def _look_at(self, one: KnownScenario) -> None:
        if one.name in self._found:
            return
        scene = Scene.of(read_scenario(one.path))
        found: dict[str, tuple[Truth, ...]] = {}
        for letter, requests in drawn_requests(scene, f"{self._seed}:{one.name}", presets()):
            first = next((request for request in requests if _is_possible(one.path, request.edits)), None)
            if first is not None:
                found[letter] = tuple(_whole(truth) for truth in first.truths)
        together = _together(found, len(self._found))
        if together and _is_possible(one.path, [edit_of(dict(truth)) for truth in together]):
            found["composite"] = together
        self._found[one.name] = found
        self._refused[one.name] = [(_code(requests), requests) for requests in drawn_refusals(scene) if _code(requests)]


_PAIRS = (("T", "B"), ("P", "G"), ("T", "P"), ("B", "P"), ("B", "G"), ("T", "G"))


def _together(found: Mapping[str, tuple[Truth, ...]], number: int) -> tuple[Truth, ...]:
    """Return two edits of a scenario, with alternating letters; neither concerns a vehicle that the other removes."""
    for first, second in (*_PAIRS[number % len(_PAIRS) :], *_PAIRS):
        if first in found and second in found:
            both = (*found[first], *found[second])
            removed = any(truth["op"] == "remove_vehicle" for truth in both)
            if not (removed and {first, second} != {"P", "G"}):
                return both
    return ()


def _whole(truth: Truth) -> Truth:
    """Return an edit's ground truth with every key that a corpus states for its operation.

    A missing optional key gets its default.
    """
    given = dict(truth)
    if given["op"] == "reroute":
        given |= {"match": "exact"}
    if given["op"] == "add_vehicle":
        given = {"speed_mps": None, "destination_lanelet": None, "depart_s": 0, **given}
    if given["op"] == "set_goal":
        given = {"rectangle": None, "time": None, **given}
    return given


def _is_possible(path: Path, edits: Sequence[Edit]) -> bool:
    with TemporaryDirectory() as folder:
        request = ModificationRequest(
            xml=path, edits=tuple(edits), benchmark_id="ZAM_Corpus-1_1_T-1", output=Path(folder)
        )
        try:
            apply_edits(request, silent)
        except PlannerForgeError:
            return False
    return True


def _code(request: EditRequest) -> str:
    """Return the code of the refusal of a drawn request; empty if corpora have no code for it."""
    edit, words = request.edits[0], " ".join(request.must_name)
    codes = {
        "no vehicle": "unknown_vehicle",
        "drives the ego": "ego_is_not_traffic",
        "'tram'": "unknown_class",
        "'furious'": "unknown_preset",
        "is not a lanelet": "unknown_lanelet",
        "cannot be reached by vehicle": "unreachable_target",
    }
    found = next((code for part, code in codes.items() if part in words), "")
    return found if edit.op != "set_goal" else ""


def modification_lines(
    letter: str, materials: Materials, possible: PossibleEdits, count: int, draw: Draw
) -> Iterator[CorpusLine]:
    """Yield requests: about four fifths are feasible, the rest must be refused or call for a clarifying question.

    Each scenario is in at most two requests, apart from the last, unclear request.
    """
    name = f"modification_{letter}"
    scenarios, styles = draw.sample(materials.scenarios, len(materials.scenarios)), rounds(STYLES, draw)
    clear = count - count // 5 - 1
    refused = 0
    for made, one in enumerate(_allowing(letter, scenarios, possible, clear)):
        style = next(styles)
        truths = possible.of(one)[letter]
        parts = [words_of(truth) for truth in truths]
        text = " and ".join(parts)
        phrased = styled(f"{text[0].upper()}{text[1:]}.", text, style, draw)
        category = "+".join(truth["op"] for truth in truths)
        yield CorpusLine(
            name, phrased, {"edits": list(truths)}, "ok", category, style, one.name, {"scenario": one.name}
        )
        if made % 4 == 3 and refused < count // 5:
            line = _refusal(letter, one, possible, refused)
            refused += line is not None
            if line is not None:
                yield line
    if scenarios:
        yield _unclear(letter, draw.choice(scenarios))


def _allowing(
    letter: str, scenarios: Sequence[KnownScenario], possible: PossibleEdits, count: int
) -> Iterator[KnownScenario]:
    found = 0
    for one in scenarios:
        if found == count:
            return
        if letter in possible.of(one):
            found += 1
            yield one


_OPERATIONS = {"T": "reroute", "B": "set_behaviour", "P": "_vehicle", "G": "set_goal", "composite": ""}


def _refusal(letter: str, one: KnownScenario, possible: PossibleEdits, number: int) -> CorpusLine | None:
    fitting = [pair for pair in possible.refusals(one) if _OPERATIONS[letter] in pair[1].edits[0].op]
    if not fitting:
        return None
    code, requests = fitting[number % len(fitting)]
    requested = _requested(requests.edits[0])
    words = words_of(requested)
    before = possible.of(one).get("B", ()) if letter == "composite" else ()
    parts = [*(words_of(truth) for truth in before), words]
    text = " and ".join(parts)
    truth = {"edits": [], "reason": code, "requested": [*before, requested], "failing_edit": len(before)}
    return CorpusLine(
        f"modification_{letter}",
        f"{text[0].upper()}{text[1:]}.",
        truth,
        "refuse",
        f"refuse_{code}",
        "normal",
        one.name,
        {"scenario": one.name},
    )


def _requested(edit: Edit) -> dict[str, Any]:
    """Return a drawn edit in the form of the ground truth."""
    named = [int(word) if word.isdecimal() else word for word in edit.vehicles]
    if edit.op == "reroute":
        return {"op": edit.op, "vehicle_id": named[0], "target_lanelets": [int(word) for word in edit.to]}
    if edit.op == "add_vehicle":
        at: dict[str, Any] = (
            {"lanelet": int(edit.at), "position": "middle"}
            if edit.at and edit.at.isdecimal()
            else {"relative_to": "ego", "lane": "same", "offset_m": 20.0}
        )
        return {"op": edit.op, "class": edit.vehicle_class, "count": 1, "where": at}
    selector = {"by": "ids", "ids": named}
    made: dict[str, Any] = {"op": edit.op, "selector": selector, "vehicle_ids": named}
    return made | ({"preset": edit.preset} if edit.preset else {})


def _unclear(letter: str, one: KnownScenario) -> CorpusLine:
    text, missing = {
        "T": ("Send the vehicle somewhere else.", "missing:target"),
        "B": ("Make one of them drive differently.", "missing:preset"),
        "P": ("Add a vehicle.", "missing:where"),
        "G": ("Change the goal.", "missing:lanelet"),
        "composite": ("Reroute one of them and change another.", "missing:vehicle"),
    }[letter]
    truth: dict[str, Any] = {"edits": [], "reason": missing}
    truth |= {"also_accept": ["ok"]} if letter == "P" else {}
    return CorpusLine(
        f"modification_{letter}", text, truth, "clarify", "clarify", "normal", one.name, {"scenario": one.name}
    )


def words_of(truth: Truth) -> str:
    """Return an edit as a person requests it."""
    if truth["op"] == "reroute":
        return f"send vehicle {truth['vehicle_id']} to lanelet {truth['target_lanelets'][0]}"
    if truth["op"] == "set_goal":
        return f"put the ego's goal at {_POSITIONS[truth['position']]} of lanelet {truth['lanelet']}"
    if truth["op"] == "add_vehicle":
        return f"add a {truth['class']} {_where(truth)}"
    who = _who(truth["selector"])
    if truth["op"] == "remove_vehicle":
        return f"remove {who}"
    return f"give {who} the {truth['preset']} behaviour" if "preset" in truth else f"change how {who} drives"


def _who(selector: Truth) -> str:
    if selector["by"] == "nearest_to_ego":
        return f"the {selector['n']} vehicles nearest to the ego"
    named = [str(key) for key in selector["ids"]]
    return "the ego" if named == ["ego"] else f"vehicle {' and '.join(named)}"


def _where(truth: Truth) -> str:
    where, later = truth["where"], f", {truth['depart_s']:g} s after the start" if truth.get("depart_s") else ""
    if "lanelet" in where:
        return f"at {_POSITIONS[where['position']]} of lanelet {where['lanelet']}{later}"
    side = "ahead of" if where["offset_m"] >= 0 else "behind"
    return f"{abs(where['offset_m']):g} m {side} the ego in its lane{later}"
