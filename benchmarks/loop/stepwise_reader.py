"""A planner that reads all its input and goes straight on: as a class in a process, and as a program.

Run by its path it uses the stepwise protocol; ``protocol.py`` compares the costs of both forms.
"""

import json
import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]
_STATES = 31


def smallest_distance_m(x_m: Values, y_m: Values, others: list[tuple[Values, Values]]) -> float:
    """Return the smallest distance between the ego's states and the predicted positions of others at the same steps."""
    least = [np.hypot(x - x_m[: len(x)], y - y_m[: len(y)]).min() for x, y in others]
    return float(min(least, default=1e6))


def straight_on(x_m: float, y_m: float, heading_rad: float, speed_mps: float, step_s: float) -> tuple[Values, Values]:
    """Return positions for three seconds at the present course and speed."""
    away = np.arange(_STATES) * step_s * speed_mps
    return x_m + away * np.cos(heading_rad), y_m + away * np.sin(heading_rad)


def answer(step: dict[str, Any], step_s: float) -> dict[str, Any]:
    """Return the program's answer to a step."""
    ego = step["ego"]
    x_m, y_m = straight_on(ego["x_m"], ego["y_m"], ego["heading_rad"], ego["speed_mps"], step_s)
    predicted = [other["predicted"] for other in step["others"]]
    others = [(np.array(one["x_m"])[:_STATES], np.array(one["y_m"])[:_STATES]) for one in predicted]
    return {
        "type": "plan",
        "step": step["step"],
        "trajectory": {
            "x_m": x_m.tolist(),
            "y_m": y_m.tolist(),
            "heading_rad": [ego["heading_rad"]] * _STATES,
            "speed_mps": [ego["speed_mps"]] * _STATES,
        },
        "debug": {"numbers": {"distance_m": smallest_distance_m(x_m, y_m, others)}},
    }


def main() -> None:
    """Run the protocol."""
    step_s = 0.1
    for line in sys.stdin.buffer:
        message = json.loads(line)
        if message["type"] == "start":
            step_s = message["step_s"]
            said = {"type": "ready", "protocol": 1}
        else:
            said = answer(message, step_s)
        sys.stdout.write(json.dumps(said) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
