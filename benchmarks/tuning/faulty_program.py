"""A planner program that fails as its first argument says; standard library only.

``own_planners.py`` lists it in a settings file once for each kind of failure; ``drives`` goes straight on.
"""

import json
import math
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

_GIGABYTES = 5


def _straight_on(request: dict[str, Any]) -> dict[str, Any]:
    """Return an answer by docs/own_planner.md: the present course and speed, until after the goal's time."""
    ego, count = request["ego"], request["last_step"] - request["first_step"] + 20
    away = [ego["speed_mps"] * request["step_s"] * index for index in range(count)]
    return {
        "scenario_id": request["scenario_id"],
        "problem_id": request["problem_id"],
        "trajectory": {
            "x_m": [ego["x_m"] + math.cos(ego["heading_rad"]) * one for one in away],
            "y_m": [ego["y_m"] + math.sin(ego["heading_rad"]) * one for one in away],
            "heading_rad": [ego["heading_rad"]] * count,
            "speed_mps": [ego["speed_mps"]] * count,
        },
    }


def _main(behaviour: str) -> None:
    answer = _straight_on(json.loads(sys.stdin.readline()))
    if behaviour == "hangs":
        time.sleep(3600)
    while behaviour == "floods":
        sys.stdout.write("0" * 100_000)
    if behaviour == "writes":
        with Path("log.bin").open("wb") as log:
            log.writelines(b"\1" * 10**6 for _ in range(_GIGABYTES * 1000))
    if behaviour == "exits":
        sys.exit(3)
    if behaviour == "not_a_number":
        answer["trajectory"]["speed_mps"][3] = math.nan
    if behaviour == "other_scenario":
        answer["scenario_id"] = "ZAM_Elsewhere-1_1_T-1"
    if behaviour == "dies":
        os.kill(os.getpid(), signal.SIGSEGV)
    sys.stdout.write(json.dumps(answer) + "\n")


if __name__ == "__main__":
    _main(sys.argv[1])
