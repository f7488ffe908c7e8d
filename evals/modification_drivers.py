"""Judges of the edit B, by the vehicle types that SUMO drove with."""

from plannerforge.evals.modification_written import Truth, Written

RELATIVE_TOLERANCE, SIZE_TOLERANCE_M = 1e-3, 0.01
LEAST_M = 0.5, 0.3

SUMO_CLASSES = {
    "car": "passenger",
    "taxi": "taxi",
    "truck": "truck",
    "bus": "bus",
    "motorcycle": "motorcycle",
    "bicycle": "bicycle",
    "priorityVehicle": "emergency",
}
"""SUMO's vehicle class for a CommonRoad obstacle type; ``passenger`` for all others."""

OWN_GAPS_M = {"motorcycle": 2.0, "bicycle": 0.5}
"""The gap that two-wheelers keep when standing, whatever the preset, unless a parameter sets it."""


def behaviour_checks(written: Written, index: int) -> dict[str, bool]:
    """Every vehicle that is meant drove in SUMO by the asked parameters, and is of the class and size it was of."""
    truth = written.truths[index]
    meant = sorted(written.meant_by(index) - written.meant_to_go())
    named = written.meant_by(index) == set(written.outcome.edits[index].vehicles)
    return {
        "tgt": bool(meant) and named and all(key in written.new for key in meant),
        "B_preset": bool(meant) and all(_has_parameters(written, truth, key) for key in meant),
        "vClass": all(is_of_its_class(written, key) for key in meant),
    }


def is_of_its_class(written: Written, key: int) -> bool:
    """Whether SUMO drove a vehicle as what the file says that it is, and a recorded one is what it was."""
    track, kind, old = written.new.get(key), written.sumo.types.get(key), written.old.get(key)
    if track is None or kind is None:
        return False
    if old is not None and (old.kind, old.length_m, old.width_m) != (track.kind, track.length_m, track.width_m):
        return False
    sizes = zip((track.length_m, track.width_m), (kind["length"], kind["width"]), LEAST_M, strict=True)
    same = all(abs(float(driven) - max(size, least)) <= SIZE_TOLERANCE_M for size, driven, least in sizes)
    return same and kind["vClass"] == SUMO_CLASSES.get(track.kind, "passenger")


def _has_parameters(written: Written, truth: Truth, key: int) -> bool:
    track, kind = written.new.get(key), written.sumo.types.get(key)
    if track is None or kind is None:
        return False
    own_gap_m = OWN_GAPS_M.get(track.kind)
    keeps_gap = own_gap_m is not None and "minGap" not in truth.get("params", {}) and truth.get("preset")
    wanted = {**truth["expected_params"], **({"minGap": own_gap_m} if keeps_gap else {})}
    return all(
        abs(float(kind[name]) - value) <= RELATIVE_TOLERANCE * max(abs(value), 1e-9) for name, value in wanted.items()
    )
