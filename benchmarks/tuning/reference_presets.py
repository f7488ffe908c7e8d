"""Measures the gain of Safety-Conservative in the public loop around Frenetix and in ours, on the same scenarios.

Either loop (started as in ``reference.py``) drives Default and Safety-Conservative twice: with its default prediction
(``guessed``: the reference a learned one, ours straight on) and with the recording itself (``known``). This shows
whether the gain comes from the prediction or from the loop.

Keys: ``reference_preset_scenarios``: attempted by both, the base of all others; for ``reference`` and ``own``,
prediction and preset (``default``, ``safety``): the shares ``_success``, ``_collisions``, ``_other``; for each
prediction ``_to_success``, ``_to_failure``: scenarios that change from Default to Safety-Conservative.
"""

import sys
from collections.abc import Mapping, Sequence

from ..harness import Figures, share
from .optimised import DEFAULT, SAFETY
from .reference import Ending, TuningBench, both_loops, drawn_scenarios

Key = tuple[str, str, str]
"""Loop, prediction and preset."""


def measure(bench: TuningBench) -> Figures:
    """Return the keys above; with a limit, on so many scenarios.

    Raises:
        LeftOut: no checkout or no interpreter was named.
    """
    endings: dict[Key, list[Ending]] = {}
    with both_loops(bench, "reference_presets") as loops:
        for path in drawn_scenarios(bench):
            ends: dict[Key, Ending] = {}
            for preset, config in (("default", DEFAULT), ("safety", SAFETY)):
                ends["own", "guessed", preset] = loops.ours(path, config, "constant_velocity").ending
                if ends["own", "guessed", preset] == "not attempted":
                    break
                ends["own", "known", preset] = loops.ours(path, config, "ground_truth").ending
                ends["reference", "guessed", preset] = loops.theirs(path, config, "walenet").ending
                ends["reference", "known", preset] = loops.theirs(path, config, "ground_truth").ending
            else:
                told = ", ".join(f"{'_'.join(key)} {end}" for key, end in ends.items())
                sys.stderr.write(f"{path.stem}: {told}\n")
                for key, end in ends.items():
                    endings.setdefault(key, []).append(end)
    return figures(endings)


def figures(endings: Mapping[Key, Sequence[Ending]]) -> dict[str, float | int | str]:
    """Return the keys of the module, of how the same scenarios end in the same order."""
    found: dict[str, float | int | str] = {"reference_preset_scenarios": max(map(len, endings.values()), default=0)}
    for key, ends in endings.items():
        begin = "_".join(key)
        found[f"{begin}_success"] = share(end == "goal reached" for end in ends)
        found[f"{begin}_collisions"] = share(end == "collision" for end in ends)
        found[f"{begin}_other"] = share(end not in ("goal reached", "collision") for end in ends)
    for loop, prediction, preset in endings:
        if preset == "safety":
            both = zip(endings[loop, prediction, "default"], endings[loop, prediction, preset], strict=True)
            reached = [(before == "goal reached", after == "goal reached") for before, after in both]
            found[f"{loop}_{prediction}_to_success"] = reached.count((False, True))
            found[f"{loop}_{prediction}_to_failure"] = reached.count((True, False))
    return found
